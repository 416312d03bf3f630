//! `gough identify`: the main job.

use super::dispatch::Ending;
use super::error::CliError;
use super::progress::with_spinner;
use super::summary::{Summary, summary};
use crate::calibration::Sample;
use crate::files::{DataPlaces, DataSet, Output, ProblemFile, json, read_problem};
use crate::identify::{Fit, Identification, NoiseEstimate, identify, identify_without_noise, score};
use crate::model::mobility;
use crate::solve::{Identifier, Stop, registry};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use std::path::{Path, PathBuf};

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Problem file: machine, tolerances and measured poses
    problem: PathBuf,
    /// Identifier; see `gough solvers`
    #[arg(long, value_name = "NAME", default_value = "minimal")]
    solver: String,
    /// Setting of the identifier; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<String>,
    /// Bounds of N times the tolerance on every component (identifiers that take bounds)
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    bounds: Option<String>,
    /// Part of the samples to hold out, between 0 and 1, besides the problem's own hold-out
    #[arg(long, value_name = "FRACTION", allow_negative_numbers = true)]
    holdout: Option<f64>,
    /// Seed of the choice of held-out samples
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Refuse postures that cannot take part instead of setting them aside
    #[arg(long)]
    require_all: bool,
    /// Further folder in which data files are looked for
    #[arg(long, value_name = "DIR")]
    data_dir: Option<PathBuf>,
    /// Where to write the result; - for standard output
    #[arg(short, long, value_name = "RESULT")]
    output: Option<PathBuf>,
}

/// Identifies, writes the result and prints a summary.
pub fn run(args: &Args) -> Result<Ending, CliError> {
    let identifier = configured(args)?;
    let output = args.output.as_deref().map(|path| Output::named(Some(path)));
    if let Some(output) = &output {
        output.check()?;
    }
    if let Some(path) = &args.output
        && same_file(path, &args.problem)
    {
        return Err(CliError::Usage(format!("-o {}: that is the problem file itself", path.display())));
    }
    let problem = read_problem(&args.problem, &DataPlaces::from_environment(args.data_dir.clone()))?;
    problem.require_tolerances()?;
    problem.require_samples()?;
    mobility::check(&problem.mechanism, &problem.mechanism.nominal())
        .map_err(|why| CliError::Mobility { file: problem.file.clone(), why })?;
    let own = problem.data.measured.iter().filter(|measured| measured.noise.is_some()).count();
    if !problem.data.has_noise() && problem.data.sets.iter().any(DataSet::has_noise) {
        return Err(CliError::Usage(format!(
            "{}: data.sets: some state their noise and others do not; state it for all or for none",
            problem.file
        )));
    }
    if !problem.data.has_noise() && own > 0 {
        return Err(CliError::Usage(format!(
            "{}: data: {own} samples state their own noise and the others have none; state data.noise",
            problem.file
        )));
    }
    let chosen = args.holdout.map(|fraction| (fraction, args.seed));
    let (training, mut holdout) = divided(&problem, chosen)?;
    let stop = Stop::default();
    let message = format!("identifying {} from {} postures", problem.name, training.len());
    let outcome = with_spinner(message, || match problem.data.has_noise() {
        true => {
            identify(&problem.mechanism, &training, identifier.as_ref(), &stop).map(|found| (found, None))
        }
        false => identify_without_noise(&problem.mechanism, &training, identifier.as_ref(), &stop)
            .map(|(found, noise)| (found, Some(noise))),
    });
    let (found, noise): (Identification, Option<NoiseEstimate>) =
        outcome.map_err(|why| CliError::Identify { file: problem.file.clone(), why })?;
    if let (true, Some(first)) = (args.require_all, found.set_aside.first()) {
        return Err(CliError::SetAside {
            file: problem.file.clone(),
            sample: first.name.clone(),
            why: first.reason.clone(),
        });
    }
    if let (Some(noise), false) = (&noise, problem.holdout.has_noise()) {
        holdout = noise.weigh(&holdout);
    }
    let held_out: (Option<Fit>, Option<Fit>) = (
        score::score(&found.start, &found.start.nominal(), &holdout),
        score::score(&found.start, &found.geometry, &holdout),
    );
    let report = Summary {
        problem: &problem,
        found: &found,
        holdout: held_out,
        held_out: holdout.len(),
        out_of_range: out_of_range(&problem),
        noise,
        identifier: identifier.as_ref(),
        chosen,
    };
    let text = summary(&report);
    match &output {
        None => Output::Stdout.write(text.as_bytes())?,
        Some(output) => {
            let bytes = json::text(&report.file())
                .map_err(|why| CliError::Usage(format!("the result cannot be written: {why}")))?;
            output.write(&bytes)?;
            match output {
                Output::Stdout => eprint!("{text}"),
                Output::File(_) => Output::Stdout.write(text.as_bytes())?,
            }
        }
    }
    for warning in report.warnings() {
        eprintln!("warning: {warning}");
    }
    Ok(if found.report.outcome.converged() { Ending::Done } else { Ending::NotConverged })
}

/// Whether both paths lead to one existing file.
fn same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// Actuators whose readings leave the range that the drawing states by more than a tenth of it.
fn out_of_range(problem: &ProblemFile) -> Vec<String> {
    let joints = problem.mechanism.limbs.iter().flat_map(|limb| &limb.joints).filter(|joint| joint.actuated);
    let mut names = problem.mechanism.actuator_names();
    let mut outside = Vec::new();
    for (index, joint) in joints.enumerate() {
        let Some((low, high)) = joint.range else { continue };
        let slack = 0.1 * (high - low);
        let leaves = |s: &Sample| {
            let reading = s.actuators.get(index).map_or(joint.home, |variable| variable + joint.home);
            reading < low - slack || reading > high + slack
        };
        if problem.data.samples.iter().any(leaves) {
            outside.push(std::mem::take(&mut names[index]));
        }
    }
    outside
}

/// The identifier named, with the settings given.
fn configured(args: &Args) -> Result<Box<dyn Identifier>, CliError> {
    let mut identifier = registry::find(&args.solver)?;
    let bounds = args.bounds.as_ref().map(|n| format!("bounds={n}"));
    for setting in args.settings.iter().chain(&bounds) {
        let (key, value) = setting
            .split_once('=')
            .ok_or_else(|| CliError::Usage(format!("--set {setting}: write it as KEY=VALUE")))?;
        identifier.set(key, value)?;
    }
    Ok(identifier)
}

/// Training samples and hold-out: the problem's own, and the fraction asked for, chosen by a seed.
pub(super) fn divided(
    problem: &ProblemFile,
    chosen: Option<(f64, u64)>,
) -> Result<(Vec<Sample>, Vec<Sample>), CliError> {
    let samples = &problem.data.samples;
    let mut holdout = problem.holdout.samples.clone();
    let Some((fraction, seed)) = chosen else { return Ok((samples.clone(), holdout)) };
    if !(0.0..1.0).contains(&fraction) {
        return Err(CliError::Usage("--holdout must be at least 0 and below 1".into()));
    }
    let mut order: Vec<usize> = (0..samples.len()).collect();
    order.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
    let count = (fraction * samples.len() as f64).round() as usize;
    let mut held: Vec<usize> = order.into_iter().take(count.min(samples.len() - 1)).collect();
    held.sort_unstable();
    let (mut training, mut next) = (Vec::new(), held.iter().peekable());
    for (index, sample) in samples.iter().enumerate() {
        if next.next_if(|held| **held == index).is_some() {
            holdout.push(sample.clone());
        } else {
            training.push(sample.clone());
        }
    }
    Ok((training, holdout))
}
