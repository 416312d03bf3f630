//! What `gough check` says of how far the drawing is from the data.

use super::check_stated::Stated;
use super::wording::{counted, listed};
use crate::calibration::Sample;
use crate::check::comparison::POSITION;
use crate::check::correction::actuated;
use crate::check::{
    Compared, Correction, Finding, Fit, Reading, Verdict, compared, corrected, expected, has_free_links,
    misfits, search,
};
use crate::files::{Kind, ProblemFile, Units};
use crate::identify::registration::FreeEnds;
use crate::measure::Point;
use crate::model::{Mechanism, Prior};
use crate::statistics::median;
use std::fmt::Write;

/// Part of the machine's size that counts as explained where no tolerances are stated.
const UNSTATED: f64 = 0.01;
/// Postures listed.
const WORST: usize = 3;
/// Misfit, in terms of the median posture's, above which a posture stands out if tolerances do not explain it.
const OUTSTANDING: f64 = 3.0;
/// Postures below which none can stand out.
const FEW: usize = 4;
/// Size of a fit of the data as they are up to which noise or tolerances may be what is stated wrongly.
const MODEST: f64 = 100.0;
/// Tolerance that stands in where none is stated, rad and machine sizes.
const USUAL: f64 = 3e-3;
/// Error in machine sizes or rad above which something is wrong, whatever the tolerances: of the median reading that is
/// less than a pose, and of poses where free links explain any misfit.
const FAR: f64 = 0.05;

/// The machine whose fit tells what tolerances explain: where none are stated, with some that machines have.
fn with_tolerances(problem: &ProblemFile) -> Mechanism {
    let mut mechanism = problem.mechanism.clone();
    if problem.require_tolerances().is_err() {
        let length = USUAL * mechanism.characteristic_length();
        for link in mechanism.limbs.iter_mut().flat_map(|limb| &mut limb.links) {
            for (prior, usual) in [(&mut link.tolerance.angle, USUAL), (&mut link.tolerance.length, length)] {
                if *prior == Prior::Held {
                    *prior = Prior::Sigma(usual);
                }
            }
        }
    }
    mechanism
}

/// Whether the noise and the tolerances that are stated explain what `finding` found, once they are restated.
///
/// A story that brings the data within them as they stand needs no others; one that does not is none where these do.
fn explained_by<'a>(finding: &Finding, stated: &dyn Fn() -> Option<&'a Stated>) -> bool {
    let within = |fit: &Fit| fit.size() <= 1.0 + 5.0 / (2.0 * fit.rows.max(1) as f64).sqrt();
    let told = finding.verdict == Verdict::Named && finding.fits[1].as_ref().is_some_and(within);
    !told && stated().is_some_and(|stated| stated.explains)
}

/// How far the drawing is from poses and positions, and which mistake would explain it; whether there is one. `stated` is
/// what an identification says of noise and tolerances.
pub(super) fn misfit<'a>(
    problem: &ProblemFile,
    data: &[Reading],
    stated: &dyn Fn() -> Option<&'a Stated>,
    text: &mut String,
) -> bool {
    let mechanism = &with_tolerances(problem);
    let drawn = problem.require_tolerances().is_ok();
    let position_only = data.iter().all(|reading| reading.rotation.is_none());
    let explained = expected(mechanism, problem.data.noise.as_ref(), position_only);
    let size = mechanism.characteristic_length();
    let free = has_free_links(mechanism);
    let limit = match (drawn, free) {
        (false, _) => UNSTATED * size,
        (true, true) => explained.median.max(FAR * size),
        (true, false) => explained.median,
    };
    let single = if drawn { explained.single.max(limit) } else { OUTSTANDING * limit };
    let shown = |metres: f64| length_in(problem.units, metres);
    let finding = search(mechanism, data, limit, drawn && problem.data.has_noise());
    // As the median is: with free ends where the data place them.
    let all = corrected(mechanism, data, &[])
        .map_or_else(|| misfits(mechanism, data), |(mechanism, data)| misfits(&mechanism, &data));
    let _ = writeln!(
        text,
        "\ndrawing against {}: median {}; {} {} (rotations count with the machine's size, {})",
        if position_only { "positions" } else { "poses" },
        shown(finding.before),
        match (drawn, free) {
            (false, _) => "no tolerances are stated; 1 % of the size would explain up to",
            (true, true) => "\"free\" links explain any misfit of theirs; mistakes are sought above",
            (true, false) => "tolerances and noise explain up to",
        },
        shown(limit),
        shown(size)
    );
    let by_size = |all: &[f64]| {
        let mut order: Vec<usize> = (0..data.len()).collect();
        order.sort_by(|a, b| all[*b].total_cmp(&all[*a]));
        order
    };
    let worst = by_size(&all);
    let worst = worst.iter().take(WORST).map(|&k| format!("{} {}", data[k].name, shown(all[k])));
    let placed = match FreeEnds::of(mechanism) {
        FreeEnds { base: false, tool: false } => "worst as drawn",
        _ => "worst, with free ends where the data place them",
    };
    let _ = writeln!(text, "  {placed}: {}", worst.collect::<Vec<_>>().join(", "));
    let mistaken = finding.verdict != Verdict::Explained;
    let modest = finding.fits[0].as_ref().is_some_and(|fit| fit.size() <= MODEST);
    if mistaken && modest && explained_by(&finding, stated) {
        return stated().is_some_and(|stated| stated.say(text));
    }
    if mistaken {
        text.push('\n');
        words(problem, &finding, text);
    }
    // What stands out does so from the others as they are once the mistake is mended; of data that are not explained
    // nothing can be said.
    if matches!(finding.verdict, Verdict::Unknown | Verdict::Unplaced) {
        return mistaken;
    }
    let mended = corrected(mechanism, data, &finding.corrections);
    let all = mended.map_or(all, |(mechanism, data)| misfits(&mechanism, &data));
    let threshold = single.max(OUTSTANDING * median(all.iter().copied()).unwrap_or(f64::INFINITY));
    let far: Vec<String> = by_size(&all)
        .into_iter()
        .filter(|k| all[*k] > threshold)
        .map(|k| format!("{} ({})", data[k].name, shown(all[k])))
        .collect();
    if far.is_empty() || all.len() < FEW || !threshold.is_finite() {
        return mistaken;
    }
    let (number, verb) = (counted(far.len(), "posture"), if far.len() == 1 { "stands" } else { "stand" });
    let _ = writeln!(text, "\nsuspicious: {number} {verb} out from the others: {}", listed(&far));
    true
}

fn length_in(units: Units, metres: f64) -> String {
    match metres.is_finite() {
        true => format!("{:.4} {}", units.from_metres(metres), units.length_symbol()),
        false => "no closed posture".to_owned(),
    }
}

fn words(problem: &ProblemFile, finding: &Finding, text: &mut String) {
    let mechanism = &problem.mechanism;
    let target = |point: &Point| target_name(problem, point);
    match finding.verdict {
        Verdict::Unplaced => text.push_str(
            "suspicious: the data do not fit the drawing, and they do not tell where its free base stands: the tool hardly \
             turns, and all positions lie on a line; nothing is said of mistakes. Measure other postures, or state where \
             base and tool are\n",
        ),
        Verdict::Named => {
            let one = if finding.alternatives.is_empty() { "" } else { "one of several that the data do not tell apart: " };
            for correction in &finding.corrections {
                let _ = writeln!(text, "suspicious: {one}{}", correction.words(mechanism, &target));
                homes(problem, correction, text);
            }
            for other in &finding.alternatives {
                let all: Vec<String> = other.iter().map(|c| c.words(mechanism, &target)).collect();
                let _ = writeln!(text, "  or: {}", all.join("; and "));
                other.iter().for_each(|correction| homes(problem, correction, text));
            }
        }
        _ => {
            text.push_str(
                "suspicious: the data do not fit the drawing, and no usual mistake (units, signs, order of actuators, \
                 of axes or of quaternions, angles in place of rotation vectors, inverted rotations or poses, coupled \
                 joints, home, base and tool elsewhere) explains why better than every other; check the drawing, or the \
                 tolerances\n",
            );
        }
    }
    let shown = |metres: f64| length_in(problem.units, metres);
    if finding.verdict == Verdict::Named {
        let _ = writeln!(text, "  residual {} -> {}", shown(finding.before), shown(finding.after));
    }
    let size = |fit: &Option<Fit>| match fit {
        Some(fit) => format!("{:.2} times", fit.size()),
        None => "no posture closes, or".to_owned(),
    };
    let noise =
        if problem.data.has_noise() { "noise and tolerances" } else { "tolerances and a noise of 1e-4" };
    match &finding.fits {
        [none, Some(fit)] => {
            let _ = writeln!(
                text,
                "  fitted within the tolerances: {} -> {:.2} times what {noise} explain; positions, which spread over {}, \
                 are then {} off",
                size(none),
                fit.size(),
                shown(fit.spread),
                fit.position.map_or_else(|| "-".to_owned(), shown)
            );
        }
        [Some(none), None] => {
            let _ = writeln!(
                text,
                "  fitted within the tolerances it is {:.2} times what {noise} explain; positions, which spread over {}, \
                 are then {} off",
                none.size(),
                shown(none.spread),
                none.position.map_or_else(|| "-".to_owned(), shown)
            );
        }
        [None, None] => {}
    }
}

/// What the file calls a target.
fn target_name(problem: &ProblemFile, point: &Point) -> String {
    let instrument = problem.drawing.data.as_ref().and_then(|data| data.instrument.as_ref());
    let is = |offset: &[f64; 3]| {
        let at = offset.map(|v| problem.units.to_metres(v));
        at.iter().zip(point.nominal.iter()).all(|(a, b)| (a - b).abs() <= 1e-12 * (a.abs() + b.abs()))
    };
    let targets = instrument.into_iter().flat_map(|instrument| &instrument.targets);
    let mut named = targets.filter(|(_, target)| target.offset.as_ref().is_some_and(is));
    named.next().map_or_else(|| "?".to_owned(), |(name, _)| name.clone())
}

/// What actuators should read at home, where these are offset.
fn homes(problem: &ProblemFile, correction: &Correction, text: &mut String) {
    let Correction::Offsets(offsets) = correction else { return };
    let (names, joints) = (problem.mechanism.actuator_names(), actuated(&problem.mechanism));
    for (i, offset) in offsets {
        if let (Some(name), Some(joint)) = (names.get(*i), joints.get(*i)) {
            let shown = |v: f64| problem.units.from_joint(joint.motion, v);
            let (home, stated) = (shown(joint.home - offset), shown(joint.home));
            let _ = writeln!(text, "  {name}: \"home\": {home:.6} instead of {stated:.6}");
        }
    }
}

/// What is neither a whole pose nor a position of the tool point: compared. All but positions of targets was not searched
/// for mistakes.
pub(super) fn others(problem: &ProblemFile, data: &[Reading], text: &mut String) -> bool {
    let of_tool = |reading: &&Reading| reading.target == Point::default();
    let names: std::collections::BTreeSet<&str> =
        data.iter().filter(of_tool).map(|reading| reading.name.as_str()).collect();
    let searched = names.len() < data.len();
    let samples: Vec<Sample> =
        problem.data.samples.iter().filter(|s| !names.contains(s.name.as_str())).cloned().collect();
    if samples.is_empty() {
        return false;
    }
    let units = problem.units;
    let kinds: Vec<&str> = problem.data.parts().iter().map(|set| set.kind).map(Kind::name).collect();
    let _ = writeln!(
        text,
        "\n{} less than a pose of the tool (kinds: {}): compared with the drawing, but{} not searched for mistakes of \
         units, signs and order",
        if samples.len() == 1 { "1 sample is".to_owned() } else { format!("{} samples are", samples.len()) },
        kinds.join(", "),
        if searched { ", positions apart," } else { "" }
    );
    let (kinds, open) = compared(&problem.mechanism, &samples);
    let size = problem.mechanism.characteristic_length();
    let mut suspicious = false;
    for kind in &kinds {
        let shown = |v: f64| error_in(units, kind.angular, v);
        let worst = kind.errors.iter().take(WORST).map(|(name, error)| format!("{name} {}", shown(*error)));
        let worst = worst.collect::<Vec<_>>().join(", ");
        let _ = writeln!(text, "  {}: median error {}; worst {worst}", kind.what, shown(kind.median()));
        let whole = if kind.angular { 1.0 } else { size };
        if searched && kind.what == POSITION {
            // What is wrong with them was said.
            continue;
        }
        if kind.median() > FAR * whole {
            suspicious = true;
            let what = kind.what;
            let _ = writeln!(
                text,
                "suspicious: the readings of kind {what} are far from what the drawing predicts; check their units and \
                 signs, the order of the actuators, and what they refer to"
            );
        } else {
            let explained = match (problem.require_tolerances().is_ok(), has_free_links(&problem.mechanism)) {
                (false, _) => OUTSTANDING * UNSTATED * whole,
                (true, true) => kind.explained.max(FAR * whole),
                (true, false) => kind.explained,
            };
            suspicious |= outstanding(kind, explained, units, text);
        }
    }
    if !open.is_empty() && (!searched || !kinds.is_empty()) {
        let number = counted(open.len(), "sample");
        let _ = writeln!(text, "  {number} whose loops do not close as drawn: {}", listed(&open));
        if 2 * open.len() > samples.len() {
            suspicious = true;
            text.push_str(
                "suspicious: most postures do not close; check the units and the order of the actuators\n",
            );
        }
    }
    suspicious
}

/// An error in rad or m as it is shown.
fn error_in(units: Units, angular: bool, value: f64) -> String {
    match angular {
        true => format!("{:.6} {}", units.from_radians(value), units.angle_symbol()),
        false => format!("{:.6} {}", units.from_metres(value), units.length_symbol()),
    }
}

/// Names the samples whose error is far beyond the median and beyond `explained` (rad or m); whether there are any.
fn outstanding(kind: &Compared, explained: f64, units: Units, text: &mut String) -> bool {
    let threshold = explained.max(OUTSTANDING * kind.median());
    let far: Vec<String> = (kind.errors.iter().filter(|(_, error)| *error > threshold))
        .map(|(name, error)| format!("{name} ({})", error_in(units, kind.angular, *error)))
        .collect();
    if far.is_empty() || kind.errors.len() < FEW {
        return false;
    }
    let (number, verb) = (counted(far.len(), "sample"), if far.len() == 1 { "stands" } else { "stand" });
    let _ = writeln!(
        text,
        "suspicious: {number} of kind {} {verb} out from the others ({} is explained): {}; check what they refer to and \
         what was read",
        kind.what,
        error_in(units, kind.angular, explained),
        listed(&far)
    );
    true
}
