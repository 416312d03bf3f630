//! `gough check`: whether a problem means what it should.

use super::dispatch::Ending;
use super::error::CliError;
use super::progress::with_spinner;
use crate::check::offsets::offsets;
use crate::check::{Correction, Finding, Reading, expected, misfits, repeats, search};
use crate::files::{DataPlaces, Output, ProblemFile, read_problem};
use crate::model::{Joint, mobility};
use crate::statistics::median;
use nalgebra::Vector3;
use std::fmt::Write;
use std::path::PathBuf;

/// Misfit, in terms of the largest that tolerances explain, above which something is wrong.
const SUSPICIOUS: f64 = 2.0;
/// Part of the machine's size that counts as explained where no tolerances are stated.
const UNSTATED: f64 = 0.01;
/// Postures listed.
const WORST: usize = 3;
/// Standard errors by which repeated postures may differ from the stated noise.
const SURPRISE: f64 = 4.0;

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Exit status: 0 where nothing looks wrong, 1 where something does, 2 for a file that cannot be read."
)]
pub struct Args {
    /// Problem file
    problem: PathBuf,
    /// Further folder in which data files are looked for
    #[arg(long, value_name = "DIR")]
    data_dir: Option<PathBuf>,
}

/// Prints what the file says, and what in it looks wrong.
pub fn run(args: &Args) -> Result<Ending, CliError> {
    let problem = read_problem(&args.problem, &DataPlaces::from_environment(args.data_dir.clone()))?;
    let posture = mobility::check(&problem.mechanism, &problem.mechanism.nominal())
        .map_err(|why| CliError::Mobility { file: problem.file.clone(), why })?;
    let mut text = machine(&problem, posture.regularity());
    let data = readings(&problem);
    let mut suspicious = false;
    if data.is_empty() {
        text.push_str("\nno measured pose or position of the tool point itself to compare with\n");
    } else {
        actuators(&problem, &data, &mut text);
        suspicious |= noise(&problem, &data, &mut text);
        suspicious |=
            with_spinner(format!("checking {}", problem.name), || residuals(&problem, &data, &mut text));
        if !suspicious {
            text.push_str("\nnothing suspicious\n");
        }
    }
    Output::Stdout.write(text.as_bytes())?;
    Ok(if suspicious { Ending::Suspicious } else { Ending::Done })
}

fn machine(problem: &ProblemFile, regularity: f64) -> String {
    let mechanism = &problem.mechanism;
    let (r, p) = mechanism.joint_counts();
    let mut text = format!(
        "{}: {} limbs, {r} angular and {p} prismatic joints, {} actuated\n",
        problem.name,
        mechanism.limbs.len(),
        mechanism.actuator_count()
    );
    for (limb, drawn) in mechanism.limbs.iter().zip(&problem.drawing.mechanism.limbs) {
        let joints: Vec<String> = drawn
            .joints
            .iter()
            .enumerate()
            .map(|(j, joint)| {
                let name = joint.name.clone().unwrap_or_else(|| format!("j{}", j + 1));
                let driven = if joint.actuated.is_some() { ", actuated" } else { "" };
                format!("{name} ({}{driven})", joint.kind)
            })
            .collect();
        let _ = writeln!(text, "  {}: {}", limb.name, joints.join(", "));
    }
    let wrenches = "six independent wrenches hold the platform at home";
    let _ = match mechanism.limbs.as_slice() {
        [limb] if limb.passive_count() == 0 => {
            writeln!(text, "mobility: a serial chain, every joint actuated")
        }
        _ => writeln!(
            text,
            "mobility: {wrenches}; they are {regularity:.3} from a singularity (0) to square (1)"
        ),
    };
    text
}

/// Positions and poses that were measured wholly.
fn readings(problem: &ProblemFile) -> Vec<Reading> {
    let joints: Vec<&Joint> = joints(problem);
    let data = &problem.data;
    let mut found = Vec::with_capacity(data.samples.len());
    for ((sample, measured), written) in data.samples.iter().zip(&data.measured).zip(&data.written) {
        if measured.position != [true; 3] {
            continue;
        }
        let rotation = measured.rotation.then_some(measured.pose.r);
        let vector = written.rotation.and_then(|[x, y, z]| Some(Vector3::new(x?, y?, z?)));
        found.push(Reading {
            name: sample.name.clone(),
            actuators: sample.actuators.iter().zip(&joints).map(|(q, joint)| q + joint.home).collect(),
            position: measured.pose.p,
            rotation,
            vector: vector.filter(|_| rotation.is_some()).map(|w| w.map(|v| problem.units.to_radians(v))),
            quaternion: written.quaternion.is_some(),
        });
    }
    // One kind at a time: poses where there are any.
    if found.iter().any(|reading| reading.rotation.is_some()) {
        found.retain(|reading| reading.rotation.is_some());
    }
    found
}

fn joints(problem: &ProblemFile) -> Vec<&Joint> {
    problem.mechanism.limbs.iter().flat_map(|limb| &limb.joints).filter(|joint| joint.actuated).collect()
}

fn actuators(problem: &ProblemFile, data: &[Reading], text: &mut String) {
    let names = problem.mechanism.actuator_names();
    let width = names.iter().map(String::len).max().unwrap_or_default();
    let _ = writeln!(text, "\n{:width$}  {:>12} {:>12}   stated range", "actuator", "lowest", "highest");
    for (i, (name, joint)) in names.iter().zip(joints(problem)).enumerate() {
        let used = data.iter().filter_map(|reading| reading.actuators.get(i).copied());
        let low = used.clone().fold(f64::INFINITY, f64::min);
        let high = used.fold(f64::NEG_INFINITY, f64::max);
        let shown = |v: f64| problem.units.from_joint(joint.motion, v);
        let unit = if joint.motion.is_angular() {
            problem.units.angle_symbol()
        } else {
            problem.units.length_symbol()
        };
        let range = match joint.range {
            None => "none".to_owned(),
            Some((from, to)) => {
                let slack = 0.1 * (to - from);
                let outside = low < from - slack || high > to + slack;
                let remark = if outside { "  left: are units, home and order right?" } else { "" };
                format!("{:.6} to {:.6}{remark}", shown(from), shown(to))
            }
        };
        let _ = writeln!(text, "{name:width$}  {:12.6} {:12.6} {unit:3} {range}", shown(low), shown(high));
    }
}

/// What repeated postures say of the noise; whether that contradicts what is stated.
fn noise(problem: &ProblemFile, data: &[Reading], text: &mut String) -> bool {
    let Some(found) = repeats(data) else { return false };
    let (length, angle) = (problem.units.length_symbol(), problem.units.angle_symbol());
    let _ = write!(
        text,
        "\n{} postures were measured more than once, {} times in all: noise {:.3e} {length}",
        found.groups,
        found.samples,
        problem.units.from_metres(found.length)
    );
    if let Some(sigma) = found.angle {
        let _ = write!(text, ", {:.3e} {angle}", problem.units.from_radians(sigma));
    }
    text.push_str(" per component\n");
    let Some(stated) = problem.data.noise else { return false };
    let sigma = |from: usize| ((from..from + 3).map(|i| stated[(i, i)]).sum::<f64>() / 3.0).sqrt();
    let mut surprising = false;
    for (what, found_sigma, stated) in
        [("length", Some(found.length), sigma(3)), ("angle", found.angle, sigma(0))]
    {
        let Some(value) = found_sigma else { continue };
        if found.surprise(value, stated).abs() > SURPRISE {
            let _ = writeln!(
                text,
                "  the stated noise in {what} is {:.2} of that: correct data.noise",
                stated / value
            );
            surprising = true;
        }
    }
    surprising
}

/// How far the drawing is from the data, and which mistake would explain it; whether there is one.
fn residuals(problem: &ProblemFile, data: &[Reading], text: &mut String) -> bool {
    let mechanism = &problem.mechanism;
    let stated = problem.require_tolerances().is_ok();
    let position_only = data.iter().all(|reading| reading.rotation.is_none());
    let explained = expected(mechanism, problem.data.noise.as_ref(), position_only);
    let size = mechanism.characteristic_length();
    let limit = if stated { SUSPICIOUS * explained } else { UNSTATED * size };
    let shown = |metres: f64| {
        if metres.is_finite() {
            format!("{:.4} {}", problem.units.from_metres(metres), problem.units.length_symbol())
        } else {
            "no closed posture".to_owned()
        }
    };
    let finding = search(mechanism, data, limit);
    let all = misfits(mechanism, data);
    let _ = writeln!(
        text,
        "\ndrawing against data: median {}; {} explain up to {} (rotations count with the machine's size, {})",
        shown(finding.before),
        if stated { "tolerances and noise" } else { "no tolerances are stated; 1 % of the size would" },
        shown(if stated { explained } else { limit }),
        shown(size)
    );
    let mut order: Vec<usize> = (0..data.len()).collect();
    order.sort_by(|a, b| all[*b].total_cmp(&all[*a]));
    let worst = order.iter().take(WORST).map(|&k| format!("{} {}", data[k].name, shown(all[k])));
    let _ = writeln!(text, "  worst as drawn: {}", worst.collect::<Vec<_>>().join(", "));
    if finding.before <= limit {
        let far_off = 5.0 * limit.max(median(all.iter().copied()).unwrap_or(f64::INFINITY));
        let far: Vec<&str> =
            order.iter().filter(|k| all[**k] > far_off).map(|k| data[*k].name.as_str()).collect();
        if far.is_empty() || all.len() < 4 {
            return false;
        }
        let _ = writeln!(
            text,
            "\nsuspicious: {} postures are far from the others: {}",
            far.len(),
            far.join(", ")
        );
        return true;
    }
    text.push('\n');
    words(problem, data, &finding, limit, text);
    true
}

fn words(problem: &ProblemFile, data: &[Reading], finding: &Finding, limit: f64, text: &mut String) {
    let mechanism = &problem.mechanism;
    let units = problem.units;
    let length = units.length_symbol();
    if finding.corrections.is_empty() {
        let _ = writeln!(
            text,
            "suspicious: the data do not fit the drawing, and no usual mistake (units, signs, order of actuators, \
             of axes or of quaternions, inverted rotations or poses, home, base and tool elsewhere) explains why; \
             check the drawing, or the tolerances"
        );
        return;
    }
    let mut machine = (mechanism.clone(), data.to_vec());
    for correction in &finding.corrections {
        let _ = writeln!(text, "suspicious: {}", correction.words(mechanism));
        if *correction == Correction::Offsets
            && let Some(found) = offsets(&machine.0, &machine.1)
        {
            for ((name, joint), offset) in mechanism.actuator_names().iter().zip(joints(problem)).zip(found) {
                let least =
                    if joint.motion.is_angular() { limit / mechanism.characteristic_length() } else { limit };
                if offset.abs() > least {
                    let home = units.from_joint(joint.motion, joint.home - offset);
                    let _ = writeln!(
                        text,
                        "  {name}: \"home\": {home:.6} instead of {:.6}",
                        units.from_joint(joint.motion, joint.home)
                    );
                }
            }
        }
        if let Some(next) = correction.apply(&machine.0, &machine.1) {
            machine = next;
        }
    }
    for other in &finding.alternatives {
        let _ = writeln!(text, "  or: {}", other.words(mechanism));
    }
    let before = if finding.before.is_finite() {
        format!("{:.4} {length}", units.from_metres(finding.before))
    } else {
        "no closed posture".to_owned()
    };
    let _ = writeln!(text, "  residual {before} -> {:.4} {length}", units.from_metres(finding.after));
}
