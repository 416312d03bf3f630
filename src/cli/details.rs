//! The details of a summary: errors of single kinds of measurement, constants of the instrument, largest deviations.

use super::summary::Summary;
use super::wording::counted;
use crate::files::summary::{Deviation, MountResult};
use crate::identify::score::Spread;
use crate::identify::{Fit, Mount, Mounts, Variance};
use crate::model::Quantity;

/// Deviations shown, and postures and bounds of a kind.
pub(super) const SHOWN: usize = 5;
/// Relative difference up to which two deviations of a limb are the same.
const SAME: f64 = 1e-6;

/// Four significant digits, as summaries show numbers.
pub(super) fn digits(value: f64) -> String {
    crate::render::text::digits(value, 4)
}

/// Samples of weight 0: what the result makes of them.
pub(super) fn unused(of: &Summary<'_>) -> String {
    let units = of.problem.units;
    let line = |(name, fit): &(String, Option<Fit>)| {
        let Some(fit) = fit else { return format!("  {name}: its loops do not close\n") };
        let metres =
            |spread: Spread| format!("{} {}", digits(units.from_metres(spread.rms)), units.length_symbol());
        let radians =
            |spread: Spread| format!("{} {}", digits(units.from_radians(spread.rms)), units.angle_symbol());
        let lengths = [fit.position, fit.distance, fit.plane, fit.joint_length].map(|part| part.map(metres));
        let angles = [fit.rotation, fit.joint_angle].map(|part| part.map(radians));
        let parts: Vec<String> = lengths.into_iter().chain(angles).flatten().collect();
        format!("  {name}: off by {}, {} in noise\n", parts.join(", "), digits(fit.weighted_rms))
    };
    if of.unused.is_empty() {
        return String::new();
    }
    let lines: String = of.unused.iter().map(line).collect();
    format!("\n{} of weight 0, not used:\n{lines}", counted(of.unused.len(), "sample"))
}

/// Errors of what is neither a position nor a rotation, a line each: before and after, and of what was left out.
pub(super) fn other_errors(of: &Summary<'_>) -> String {
    type Part = fn(&Fit) -> Option<Spread>;
    let units = of.problem.units;
    let (length, angle) = (units.length_symbol(), units.angle_symbol());
    let parts: [(&str, Part, bool); 4] = [
        ("distance", |fit| fit.distance, false),
        ("plane", |fit| fit.plane, false),
        ("joint angle", |fit| fit.joint_angle, true),
        ("joint length", |fit| fit.joint_length, false),
    ];
    let mut text = String::new();
    for (name, part, angular) in parts {
        let shown = |v: f64| digits(if angular { units.from_radians(v) } else { units.from_metres(v) });
        let unit = if angular { angle } else { length };
        for (set, (before, after)) in
            [("training", of.reached(of.found.fit)), ("hold-out", of.reached(of.holdout))]
        {
            let (Some(before), Some(after)) = (before.as_ref().and_then(part), after.as_ref().and_then(part))
            else {
                continue;
            };
            text.push_str(&format!(
                "{name:13} {set:9} rms {} -> {}, max {} -> {} {unit}\n",
                shown(before.rms),
                shown(after.rms),
                shown(before.max),
                shown(after.max),
            ));
        }
        if let Some(left) = of.cross_validation.and_then(|cross| part(&cross.fit)) {
            text.push_str(&format!(
                "{name:13} {:9} rms {}, max {} {unit}\n",
                "left out",
                shown(left.rms),
                shown(left.max)
            ));
        }
    }
    text
}

/// Where free ends were found, with their standard errors.
pub(super) fn mounts(of: &Summary<'_>) -> String {
    let units = of.problem.units;
    let triple = |v: [f64; 3]| v.map(digits).join(", ");
    let line = |name: &str, mount: &Option<Mount>| {
        let Some(mount) = mount else { return String::new() };
        let found = MountResult::of(&mount.pose, mount.std.as_ref(), units);
        let error = |of: fn(&Deviation) -> [f64; 3]| {
            found.std.as_ref().map_or(String::new(), |std| format!(" +- [{}]", triple(of(std))))
        };
        format!(
            "{name:13}position [{}]{} {}; rotation [{}]{} {}\n",
            triple(found.position),
            error(|std| std.translation),
            units.length_symbol(),
            triple(found.rotation),
            error(|std| std.rotation),
            units.angle_symbol()
        )
    };
    let Mounts { placement, tool_mounting } = &of.mounts;
    let text = line("placement", placement) + &line("tool mounted", tool_mounting);
    if text.is_empty() { text } else { format!("\n{text}") }
}

/// The instrument's constants.
pub(super) fn instrument(of: &Summary<'_>) -> String {
    let constants = of.instrument();
    if constants.is_empty() {
        return String::new();
    }
    let mut text = "\nconstants of the instrument\n".to_owned();
    for (found, constant) in constants.iter().zip(&of.problem.mechanism.instrument) {
        let unit = match constant.quantity {
            Quantity::Angle => of.problem.units.angle_symbol(),
            Quantity::Length => of.problem.units.length_symbol(),
            Quantity::Ratio => "",
        };
        let error = found.std.map_or(String::new(), |std| format!(" +- {}", digits(std)));
        text.push_str(&format!("  {:24} {}{error} {unit}\n", found.name, digits(found.value)));
    }
    text
}

/// The largest deviations in tolerances, with their standard errors.
pub(super) fn largest(of: &Summary<'_>) -> String {
    let (found, units) = (of.found, of.problem.units);
    let mut components = of.components();
    components.sort_by(|a, b| b.0.abs().total_cmp(&a.0.abs()).then(a.2.cmp(&b.2)));
    components.retain(|c| c.0.is_finite() && c.0 != 0.0);
    if components.is_empty() {
        return "\n".into();
    }
    let mut text = "\nlargest deviations, each link in the frame of the joint that it carries\n".to_owned();
    let mut shown_sizes: Vec<(f64, &str)> = Vec::new();
    let mut distinct = Vec::new();
    for component in &components {
        // What neighbouring links share by redundancy is one finding, not two.
        let limb = component.4.split('.').next().unwrap_or_default();
        let twin = |(size, of): &(f64, &str)| *of == limb && (component.1.abs() - size).abs() <= SAME * size;
        if !shown_sizes.iter().any(twin) {
            shown_sizes.push((component.1.abs(), limb));
            distinct.push(component);
        }
        if distinct.len() == SHOWN {
            break;
        }
    }
    for &(ratio, d, index, i, ref name) in distinct {
        let (kind, symbol) = match i {
            0..3 => ("rotation", units.angle_symbol()),
            _ => ("translation", units.length_symbol()),
        };
        let shown = |v: f64| digits(if i < 3 { units.from_radians(v) } else { units.from_metres(v) });
        let variance = found.variances.as_ref().and_then(|all| all.get(index));
        let beside = of.mounts.links().find(|beside| beside.link == index / 6);
        let std = match beside {
            Some(beside) => beside.std.map(|std| std[i]),
            None => variance.map(|v| v.total.sqrt()),
        };
        let error = std.map_or(String::new(), |std| format!(" +- {}", shown(std)));
        let source = match variance.map(Variance::prior_share) {
            Some(share) if share > 0.9 => ", error: tolerance",
            Some(share) if share > 0.1 => ", error: tolerance and data",
            Some(_) => ", error: data",
            None => "",
        };
        text.push_str(&format!(
            "  {:24} {:11} {}  {}{error} {symbol}  ({ratio:+.2} tolerances{source})\n",
            name,
            kind,
            ["x", "y", "z"][i % 3],
            shown(d),
        ));
    }
    text.push('\n');
    text
}
