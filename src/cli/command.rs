//! `gough command`: actuator readings for wanted poses.

use super::details::digits;
use super::dispatch::Ending;
use super::elsewhere::warn_of_modes;
use super::error::CliError;
use super::progress::with_spinner;
use super::ranges::warn_unless_converged;
use super::wording::not_reached;
use crate::files::{
    CommandedPose, Model, Output, PosesFormat, commands_text, read_model, read_wanted, readings,
};
use crate::model::Mechanism;
use crate::model::command::{beyond_range, command};
use crate::model::mobility;
use rayon::prelude::*;
use std::path::PathBuf;

/// Components of a pose, in the order of errors: as turned, and as moved.
const COMPONENTS: [&str; 6] = ["rx", "ry", "rz", "tx", "ty", "tz"];
/// Poses named in one message.
const NAMED: usize = 8;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Problem or result file: its machine is brought to the poses
    model: PathBuf,
    /// Wanted poses: CSV with x, y, z and a rotation, or JSON with samples (positions alone with --free rx,ry,rz);
    /// actuator readings beside a pose say where to begin (home where there are none)
    #[arg(long, value_name = "FILE")]
    poses: PathBuf,
    /// Components, of tx, ty, tz, rx, ry, rz along and about the axes of {S}, that need not be followed
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    free: Vec<String>,
    /// Write readings outside the drawn range, too
    #[arg(long)]
    beyond_range: bool,
    /// Where to write the readings (.csv, or .json with the residual of every pose; CSV on standard output if left out)
    #[arg(short, long, value_name = "ACTUATORS")]
    output: Option<PathBuf>,
}

/// Finds the readings for every pose, on home's assembly branch.
pub fn run(args: &Args) -> Result<Ending, CliError> {
    let output = Output::named(args.output.as_deref());
    output.check()?;
    let followed = followed(&args.free)?;
    let model = read_model(&args.model)?;
    warn_unless_converged(&model);
    warn_of_modes(&model.file, model.elsewhere);
    let (mechanism, geometry) = (&model.mechanism, model.mechanism.nominal());
    mobility::check(mechanism, &geometry)
        .map_err(|why| CliError::Mobility { file: model.file.clone(), why })?;
    let wanted = read_wanted(&args.poses, &model, followed[..3].contains(&true))?;
    let home = vec![0.0; mechanism.actuator_count()];
    let found: Vec<_> = with_spinner(format!("seeking {} poses", wanted.len()), || {
        let seek = |w: &crate::files::WantedPose| {
            command(mechanism, &geometry, w.near.as_ref().unwrap_or(&home), &w.pose, followed)
        };
        wanted.par_iter().map(seek).collect()
    });
    let mut commands = Vec::with_capacity(wanted.len());
    let (mut away, mut outside) = (Vec::new(), Vec::new());
    for (wanted, found) in wanted.iter().zip(found) {
        match found {
            Ok(found) => {
                let beyond = beyond(mechanism, &found.actuators, &model);
                if !beyond.is_empty() {
                    outside.push(format!("{} ({})", wanted.name, beyond.join(", ")));
                }
                commands.push(CommandedPose {
                    readings: readings(mechanism, model.units, &found.actuators),
                    pose: found.pose,
                    residual: found.residual,
                });
            }
            Err(why) => away.push(format!("{}: {}", wanted.name, not_reached(&why, model.units))),
        }
    }
    let file = args.poses.display();
    if !away.is_empty() {
        let few = mechanism.actuator_count() < followed.iter().filter(|f| **f).count();
        let hint = match few {
            true => format!(
                "; {} actuators cannot follow any {} components: name those to give up with --free",
                mechanism.actuator_count(),
                followed.iter().filter(|f| **f).count()
            ),
            false => String::new(),
        };
        return Err(CliError::Usage(format!(
            "{file}: {} of {} poses cannot be reached: {}{hint}",
            away.len(),
            wanted.len(),
            shortened(&away, "; ")
        )));
    }
    if !outside.is_empty() {
        let message = format!(
            "readings leave the drawn range at {}: none within it were found, these come nearest",
            shortened(&outside, ", ")
        );
        if !args.beyond_range {
            return Err(CliError::Usage(format!(
                "{file}: {message}; --beyond-range writes them all the same"
            )));
        }
        eprintln!("warning: {message}");
    }
    let format = args.output.as_deref().map_or(PosesFormat::Csv, PosesFormat::of);
    let text = commands_text(format, &mechanism.actuator_names(), &commands, model.units)
        .map_err(|why| CliError::Usage(format!("readings cannot be written: {why}")))?;
    output.write(&text)?;
    if followed != [true; 6] {
        let names: Vec<&str> = wanted.iter().map(|w| w.name.as_str()).collect();
        eprint!("{}", residuals(&model, followed, &names, &commands));
    }
    Ok(Ending::Done)
}

/// Actuators outside their ranges, and by how much, such as `limb1.leg 3.2 mm above`.
fn beyond(mechanism: &Mechanism, actuators: &[f64], model: &Model) -> Vec<String> {
    let (names, units) = (mechanism.actuator_names(), model.units);
    let joints: Vec<_> =
        mechanism.limbs.iter().flat_map(|limb| &limb.joints).filter(|joint| joint.actuated).collect();
    let shown = |(i, by): (usize, f64)| {
        let (size, unit) = match joints[i].motion.is_angular() {
            true => (units.from_radians(by.abs()), units.angle_symbol()),
            false => (units.from_metres(by.abs()), units.length_symbol()),
        };
        format!("{} {} {unit} {}", names[i], digits(size), if by > 0.0 { "above" } else { "below" })
    };
    beyond_range(mechanism, actuators).into_iter().map(shown).collect()
}

fn followed(free: &[String]) -> Result<[bool; 6], CliError> {
    let mut followed = [true; 6];
    for name in free {
        let place = COMPONENTS.iter().position(|component| component == &name.trim());
        match place {
            Some(place) => followed[place] = false,
            None => {
                return Err(CliError::Usage(format!(
                    "--free: no component is called {}; components are tx, ty, tz, rx, ry, rz",
                    crate::files::error::quoted(name)
                )));
            }
        }
    }
    if followed == [false; 6] {
        return Err(CliError::Usage("--free: every component is given up; leave one to follow".into()));
    }
    Ok(followed)
}

/// The first few, and how many more there are.
fn shortened(all: &[String], between: &str) -> String {
    let more = all.len().saturating_sub(NAMED);
    let shown = all.iter().take(NAMED).cloned().collect::<Vec<String>>().join(between);
    if more > 0 { format!("{shown}{between}and {more} more") } else { shown }
}

/// What is left of the components that are given up, pose by pose for the first of them, and the largest of all.
fn residuals(model: &Model, followed: [bool; 6], names: &[&str], commands: &[CommandedPose]) -> String {
    let given_up: Vec<usize> = (0..6).filter(|&i| !followed[i]).collect();
    let shown = |i: usize, value: f64| match i {
        0..3 => format!(
            "{} {} {}",
            COMPONENTS[i],
            digits(model.units.from_radians(value)),
            model.units.angle_symbol()
        ),
        _ => format!(
            "{} {} {}",
            COMPONENTS[i],
            digits(model.units.from_metres(value)),
            model.units.length_symbol()
        ),
    };
    let line = |of: &dyn Fn(usize) -> f64| -> String {
        given_up.iter().map(|&i| shown(i, of(i))).collect::<Vec<String>>().join(", ")
    };
    let mut text = "wanted less reached, of the components given up:\n".to_owned();
    for (name, command) in names.iter().zip(commands).take(NAMED) {
        text.push_str(&format!("  {name}: {}\n", line(&|i| command.residual[i])));
    }
    if commands.len() > NAMED {
        let largest = |i: usize| commands.iter().map(|c| c.residual[i].abs()).fold(0.0, f64::max);
        text.push_str(&format!("  largest of all {} poses: {}\n", commands.len(), line(&largest)));
    }
    text
}
