//! `gough check`: whether a problem means what it should.

use super::check_misfit::{misfit, others};
use super::check_stated::Stated;
use super::dispatch::Ending;
use super::elsewhere::words;
use super::error::CliError;
use super::progress::with_spinner;
use super::warnings::doubtful_size;
use super::wording::counted;
use crate::calibration::Sample;
use crate::check::correction::actuated;
use crate::check::{Reading, repeats};
use crate::files::noise::assumed_noise;
use crate::files::values::OneOrEach;
use crate::files::{DataPlaces, Output, ProblemFile, read_problem};
use crate::identify::drawn_elsewhere;
use crate::measure::{Clue, Point};
use crate::model::mobility;
use crate::model::mobility::near_singular_home;
use nalgebra::{Matrix6, Vector3};
use std::cell::OnceCell;
use std::fmt::Write;
use std::path::PathBuf;

/// Standard errors by which repeated postures may differ from the stated noise.
const SURPRISE: f64 = 4.0;
/// Stated noise, in terms of what repeats show, above which the ratio says nothing.
const MOST: f64 = 1e3;

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
    let mut suspicious = home(&problem, &mut text);
    if problem.data.is_empty() {
        text.push_str("\nno measurements to compare the drawing with");
        if !problem.data.unused.is_empty() {
            let _ = write!(text, ": {} of weight 0", counted(problem.data.unused.len(), "sample"));
        }
        text.push('\n');
    } else {
        let all: Vec<Reading> = problem.data.samples.iter().map(|sample| bare(&problem, sample)).collect();
        actuators(&problem, &all, &mut text);
        suspicious |= size(&problem, &mut text);
        suspicious |= with_spinner(format!("checking {}", problem.name), || {
            let once = OnceCell::new();
            let stated = || once.get_or_init(|| Stated::of(&problem)).as_ref();
            let poses = !data.is_empty()
                && (noise(&problem, &data, &mut text) | misfit(&problem, &data, &stated, &mut text));
            let others = others(&problem, &data, &mut text);
            // Mistakes of the drawing spoil what an identification would say.
            poses | others
                || modes(&problem, &mut text) | stated().is_some_and(|stated| stated.say(&mut text))
        });
    }
    if !suspicious {
        text.push_str("\nnothing suspicious\n");
    }
    Output::Stdout.write(text.as_bytes())?;
    Ok(if suspicious { Ending::Suspicious } else { Ending::Done })
}

fn machine(problem: &ProblemFile, regularity: f64) -> String {
    let mechanism = &problem.mechanism;
    let (r, p) = mechanism.joint_counts();
    let mut text = format!(
        "{}: {}, {r} angular and {p} prismatic joints, {} actuated\n",
        problem.name,
        counted(mechanism.limbs.len(), "limb"),
        mechanism.actuator_count()
    );
    for (limb, drawn) in mechanism.limbs.iter().zip(&problem.drawing.mechanism.limbs) {
        let joints: Vec<String> = drawn
            .joints
            .iter()
            .enumerate()
            .map(|(j, joint)| {
                let name = joint.name.clone().unwrap_or_else(|| format!("j{}", j + 1));
                let is_driven = joint.actuated.as_ref().is_some_and(|driven| match driven {
                    OneOrEach::One(driven) => *driven,
                    OneOrEach::Each(axes) => axes.contains(&true),
                });
                let driven = if is_driven { ", actuated" } else { "" };
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
            "mobility: {wrenches}; they are {} from a singularity (0) to square (1)",
            if regularity < 0.01 { format!("{regularity:.1e}") } else { format!("{regularity:.3}") }
        ),
    };
    text
}

/// Whether home is nearly singular.
fn home(problem: &ProblemFile, text: &mut String) -> bool {
    let doubt = near_singular_home(&problem.mechanism, &problem.mechanism.nominal());
    if let Some(doubt) = &doubt {
        let _ = writeln!(text, "\nsuspicious: {doubt}");
    }
    doubt.is_some()
}

/// Whether postures were measured where the path from home does not lead.
fn modes(problem: &ProblemFile, text: &mut String) -> bool {
    let samples = &problem.data.samples;
    let elsewhere = drawn_elsewhere(&problem.mechanism, samples);
    if !elsewhere.is_empty() {
        let words = words(&elsewhere, samples.len(), "sample", problem.units);
        let _ = writeln!(text, "\nsuspicious: {words}");
    }
    !elsewhere.is_empty()
}

/// Whether the machine is of a size that nobody builds.
fn size(problem: &ProblemFile, text: &mut String) -> bool {
    let doubt = doubtful_size(problem);
    if let Some(doubt) = &doubt {
        let _ = writeln!(text, "\nsuspicious: {doubt}");
    }
    doubt.is_some()
}

/// The readings of a sample alone.
fn bare(problem: &ProblemFile, sample: &Sample) -> Reading {
    let joints = actuated(&problem.mechanism);
    Reading {
        name: sample.name.clone(),
        actuators: sample.actuators.iter().zip(&joints).map(|(q, joint)| q + joint.home).collect(),
        position: Vector3::zeros(),
        rotation: None,
        vector: None,
        quaternion: false,
        target: Point::default(),
        noise: Box::new(Matrix6::identity()),
    }
}

/// Covariance of what a sample shares with the others of its posture, at its target where it has one.
fn common_noise(sample: &Sample) -> Matrix6<f64> {
    let common = sample.measurement.posture_noise().unwrap_or_default();
    let lever = match sample.measurement.clue() {
        Clue::Position { target, .. } => target.nominal.norm(),
        _ => 0.0,
    };
    let turned = (common.angle * lever).powi(2);
    let mut variances = common.variances();
    variances.iter_mut().skip(3).for_each(|variance| *variance += turned);
    Matrix6::from_diagonal(&variances)
}

/// Positions, of targets too, and poses that were measured wholly.
fn readings(problem: &ProblemFile) -> Vec<Reading> {
    let mut found = Vec::with_capacity(problem.data.samples.len());
    for set in problem.data.parts() {
        let stated = set.noise.unwrap_or_else(|| assumed_noise(&problem.mechanism));
        for ((sample, measured), written) in set.samples.iter().zip(&set.measured).zip(&set.written) {
            let own = measured.noise.as_deref().unwrap_or(&stated) / sample.measurement.weight();
            let noise = own + common_noise(sample);
            let reading = Reading { noise: Box::new(noise), ..bare(problem, sample) };
            if measured.position == [true; 3] {
                let rotation = measured.rotation.then_some(measured.pose.r);
                let vector = written.rotation.and_then(|[x, y, z]| Some(Vector3::new(x?, y?, z?)));
                found.push(Reading {
                    position: measured.pose.p,
                    rotation,
                    vector: vector
                        .filter(|_| rotation.is_some())
                        .map(|w| w.map(|v| problem.units.to_radians(v))),
                    quaternion: written.quaternion.is_some(),
                    ..reading
                });
            } else if let Clue::Position { target, at } = sample.measurement.clue()
                && target != Point::default()
            {
                found.push(Reading { position: at, target, ..reading });
            }
        }
    }
    // One kind at a time: poses where there are any.
    if found.iter().any(|reading| reading.rotation.is_some()) {
        found.retain(|reading| reading.rotation.is_some());
    }
    found
}

fn actuators(problem: &ProblemFile, data: &[Reading], text: &mut String) {
    let names = problem.mechanism.actuator_names();
    let width = names.iter().map(String::len).max().unwrap_or_default();
    let _ = writeln!(text, "\n{:width$}  {:>12} {:>12}   stated range", "actuator", "lowest", "highest");
    for (i, (name, joint)) in names.iter().zip(actuated(&problem.mechanism)).enumerate() {
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
        "\n{} measured more than once, {} times in all: noise {:.3e} {length}",
        if found.groups == 1 {
            "1 posture was".to_owned()
        } else {
            format!("{} postures were", found.groups)
        },
        found.samples,
        problem.units.from_metres(found.length)
    );
    if let Some(sigma) = found.angle {
        let _ = write!(text, ", {:.3e} {angle}", problem.units.from_radians(sigma));
    }
    text.push_str(" per component\n");
    let Some(stated) = problem.data.noise else { return false };
    let sigma = |from: usize| ((from..from + 3).map(|i| stated[(i, i)]).sum::<f64>() / 3.0).sqrt();
    if found.are_copies(sigma(3), sigma(0)) {
        text.push_str(
            "suspicious: these repeats are identical; a reading that is copied is no repeat and tells nothing of the noise: \
             leave the copies out, or measure again\n",
        );
        return true;
    }
    let mut surprising = false;
    for (what, found_sigma, stated) in
        [("length", Some(found.length), sigma(3)), ("angle", found.angle, sigma(0))]
    {
        let Some(value) = found_sigma else { continue };
        if found.surprise(value, stated).abs() > SURPRISE {
            let _ = match stated / value {
                ratio if ratio < MOST => {
                    writeln!(text, "  the stated noise in {what} is {ratio:.2} of that: correct data.noise")
                }
                _ => writeln!(
                    text,
                    "  the repeats agree in {what} far beyond the stated noise: are they copies?"
                ),
            };
            surprising = true;
        }
    }
    surprising
}
