//! `gough identify`: the main job.

use super::dispatch::Ending;
use super::error::CliError;
use super::judged::sets_of;
use super::progress::with_spinner;
use super::ranges::{out_of_range, warn_of_home};
use super::summary::{Summary, summary};
use super::wording::{counted, not_identified, reason};
use crate::calibration::{ByPosture, Sample};
use crate::files::{DataPlaces, DataSet, Output, ProblemFile, json, read_problem};
use crate::identify::copies::copies;
use crate::identify::posture_noise::sharing;
use crate::identify::score::{score, set_aside};
use crate::identify::{
    Fit, Folds, IdentifyError, Judged, Mounts, believed, cross_validate, identify, identify_sharing,
    identify_without_noise, judge, measured_elsewhere, undecided,
};
use crate::measure::Clue;
use crate::model::mobility;
use crate::solve::{Failure, Identifier, Outcome, Stop, registry};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use std::cmp::Ordering;
use std::iter;
use std::path::PathBuf;

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
    /// Part of the postures to hold out, between 0 and 1, besides the problem's own hold-out
    #[arg(long, value_name = "FRACTION", allow_negative_numbers = true)]
    holdout: Option<f64>,
    /// Seed of the choice of held-out postures, and of the parts of --cross-validate
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Predict each posture without it: number of parts, or loo for one posture at a time
    #[arg(long, value_name = "K|loo")]
    cross_validate: Option<String>,
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
    let problem = read_problem(&args.problem, &DataPlaces::from_environment(args.data_dir.clone()))?;
    problem.require_tolerances()?;
    problem.require_samples()?;
    warn_of_home(&problem.mechanism);
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
            "{}: data: noise is stated by {} and by no other; state data.noise",
            problem.file,
            counted(own, "sample")
        )));
    }
    let chosen = args.holdout.map(|fraction| (fraction, args.seed));
    let (mut training, mut holdout) = divided(&problem, chosen)?;
    let postures = ByPosture::of(&training).count();
    let folds = args.cross_validate.as_deref().map(|text| folds(text, postures, args.seed)).transpose()?;
    let stop = Stop::default();
    let message = format!("identifying {} from {}", problem.name, counted(postures, "posture"));
    let from = |samples: &[Sample]| match problem.data.has_noise() {
        true => identify(&problem.mechanism, samples, identifier.as_ref(), &stop).map(|found| (found, None)),
        false => identify_without_noise(&problem.mechanism, samples, identifier.as_ref(), &stop)
            .map(|(found, noise)| (found, Some(noise))),
    };
    let outcome = with_spinner(message, || identify_sharing(&training, from));
    let (found, noise, common) = outcome.map_err(|why| not_done(&problem, &why))?;
    let mut unused = problem.data.unused.clone();
    if let Some(common) = common {
        for samples in [&mut training, &mut holdout, &mut unused] {
            *samples = sharing(samples, common.noise);
        }
    }
    if let Outcome::Failed(Failure::Infeasible(names)) = &found.report.outcome {
        return Err(CliError::Usage(format!(
            "{}: the limits contradict each other: no machine fits those of {}; widen or remove one",
            problem.file,
            names.join(", ")
        )));
    }
    if let Outcome::Failed(Failure::Unsuited(why)) = &found.report.outcome {
        return Err(CliError::Usage(format!(
            "{}: {} does not suit this problem: {why}; choose another --solver",
            problem.file, found.report.identifier
        )));
    }
    if let (0, Some(first)) = (found.rows, found.set_aside.first()) {
        return Err(CliError::Usage(format!(
            "{}: no posture closes with the machine that they gave (gough check looks for mistakes); {}: {}",
            problem.file,
            first.name,
            reason(&first.reason, problem.units)
        )));
    }
    if let (true, Some(first)) = (args.require_all, found.set_aside.first()) {
        return Err(CliError::SetAside {
            file: problem.file.clone(),
            sample: first.name.clone(),
            why: reason(&first.reason, problem.units),
        });
    }
    if let (Some(noise), false) = (&noise, problem.holdout.has_noise()) {
        holdout = noise.weigh(&holdout);
    }
    let weighed = noise.as_ref().map_or_else(|| training.clone(), |noise| noise.weigh(&training));
    let cross_validation = match folds {
        None => None,
        Some(folds) => {
            let message = format!("leaving out postures of {}", problem.name);
            let left_out = || cross_validate(&found, &weighed, folds, identifier.as_ref(), &stop);
            let why = |why| not_done(&problem, &why);
            with_spinner(message, left_out).map_err(why)?
        }
    };
    let held_out: (Option<Fit>, Option<Fit>) = (
        score(&found.start, &found.start.nominal(), &holdout),
        score(&found.start, &found.geometry, &holdout),
    );
    let found = if noise.is_some() { believed(found, held_out) } else { found };
    let holdout_set_aside = set_aside(&found.start, &found.geometry, &holdout);
    let judgement = judge(&Judged {
        found: &found,
        samples: &weighed,
        sets: &sets_of(&problem, &weighed),
        holdout: &holdout,
        stated: noise.is_none(),
        identifier: identifier.as_ref(),
        stop: &stop,
    });
    let report = Summary {
        elsewhere: measured_elsewhere(&found.start, &found.geometry, &found.taking),
        undecided: undecided(&found, &weighed),
        unused: (unused.iter())
            .map(|s| {
                let weighed =
                    noise.as_ref().map_or_else(|| vec![s.clone()], |n| n.weigh(std::slice::from_ref(s)));
                (s.name.clone(), score(&found.start, &found.geometry, &weighed))
            })
            .collect(),
        problem: &problem,
        mounts: Mounts::of(&problem.mechanism, &found),
        repeated: repeated(&training),
        copies: copies(&training),
        shared: shared(&training, &holdout),
        holdout_set_aside,
        found: &found,
        holdout: held_out,
        out_of_range: out_of_range(
            &problem.mechanism,
            problem.data.samples.iter().flat_map(|sample| {
                iter::once(sample.actuators.as_slice()).chain(sample.measurement.second())
            }),
        ),
        noise,
        common,
        judgement,
        cross_validation,
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

fn not_done(problem: &ProblemFile, why: &IdentifyError) -> CliError {
    CliError::Identify { file: problem.file.clone(), why: not_identified(why, problem.units) }
}

/// How so many postures are divided for cross-validation.
fn folds(text: &str, postures: usize, seed: u64) -> Result<Folds, CliError> {
    if text == "loo" && postures > 1 {
        return Ok(Folds::LeaveOneOut);
    }
    match text.parse::<usize>() {
        Ok(count) if (2..=postures).contains(&count) => Ok(Folds::Parts { count, seed }),
        _ => Err(CliError::Usage(format!(
            "--cross-validate {text}: give a number of parts from 2 to the {postures} postures there are, or loo"
        ))),
    }
}

/// Names of the training samples that are in the hold-out, too: the same readings and the same values measured.
fn shared(training: &[Sample], holdout: &[Sample]) -> Vec<String> {
    let same =
        |a: &Sample, b: &Sample| same_object(a, b) && a.measurement.readings() == b.measurement.readings();
    // Only samples of one posture can be equal.
    let both: Vec<Sample> = training.iter().chain(holdout).cloned().collect();
    let mut names = Vec::new();
    for of in ByPosture::of(&both).iter() {
        let (here, there) = of.split_at(of.partition_point(|i| *i < training.len()));
        let held = |i: &usize| there.iter().any(|j| same(&both[*i], &both[*j]));
        names.extend(here.iter().filter(|i| held(i)).copied());
    }
    names.sort_unstable();
    names.into_iter().map(|i| both[i].name.clone()).collect()
}

/// Number of samples that measure the same thing at the same readings as an earlier one.
fn repeated(samples: &[Sample]) -> usize {
    // Of separations it is not known which target they follow.
    let mut sorted: Vec<&Sample> = samples.iter().filter(|s| s.measurement.second().is_none()).collect();
    sorted.sort_by(|a, b| a.actuators.partial_cmp(&b.actuators).unwrap_or(Ordering::Equal));
    let groups = sorted.chunk_by(|a, b| a.actuators == b.actuators);
    groups.map(|group| group.len() - objects(group).len()).sum()
}

/// One sample for each thing that is measured.
fn objects<'s>(samples: &[&'s Sample]) -> Vec<&'s Sample> {
    let mut different: Vec<&Sample> = Vec::new();
    for sample in samples {
        if !different.iter().any(|other| same_object(other, sample)) {
            different.push(sample);
        }
    }
    different
}

/// Whether both refer to the same target, fixed point and plane, and to the same second posture.
fn same_object(a: &Sample, b: &Sample) -> bool {
    let referred = match (a.measurement.clue(), b.measurement.clue()) {
        (Clue::Pose(_), Clue::Pose(_)) | (Clue::Internal, Clue::Internal) | (Clue::None, Clue::None) => true,
        (Clue::Position { target: a, .. }, Clue::Position { target: b, .. }) => a == b,
        (Clue::Range { target: a, point: from, .. }, Clue::Range { target: b, point: to, .. }) => {
            a == b && from == to
        }
        (Clue::Touch { target: a, plane: on, .. }, Clue::Touch { target: b, plane: under, .. }) => {
            a == b && on == under
        }
        _ => false,
    };
    referred && a.measurement.second() == b.measurement.second()
}

/// The identifier named, with the settings given.
fn configured(args: &Args) -> Result<Box<dyn Identifier>, CliError> {
    let mut identifier = registry::find(&args.solver)?;
    let takes_bounds =
        |identifier: &dyn Identifier| identifier.settings().iter().any(|(key, _)| *key == "bounds");
    if args.bounds.is_some() && !takes_bounds(identifier.as_ref()) {
        let all = registry::all();
        let others: Vec<&str> = all.iter().filter(|i| takes_bounds(i.as_ref())).map(|i| i.name()).collect();
        return Err(CliError::Usage(format!(
            "--bounds: solver '{}' takes no bounds; these do: {}",
            args.solver,
            others.join(", ")
        )));
    }
    let twice = |setting: &String| setting.split_once('=').is_some_and(|(key, _)| key.trim() == "bounds");
    if args.bounds.is_some() && args.settings.iter().any(twice) {
        return Err(CliError::Usage("both --bounds and --set bounds=...; give one of them".into()));
    }
    let bounds = args.bounds.as_ref().map(|n| format!("bounds={n}"));
    for setting in args.settings.iter().chain(&bounds) {
        let (key, value) = setting
            .split_once('=')
            .ok_or_else(|| CliError::Usage(format!("--set {setting}: write it as KEY=VALUE")))?;
        identifier.set(key, value)?;
    }
    Ok(identifier)
}

/// Training samples and hold-out: the problem's own, and the fraction of the postures asked for, chosen by a seed.
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
    // By posture: samples of one share what is wrong with it, and would prove each other right.
    let postures = ByPosture::of(samples);
    let mut order: Vec<usize> = (0..postures.count()).collect();
    order.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
    let count = (fraction * postures.count() as f64).round() as usize;
    order.truncate(count.min(postures.count().saturating_sub(1)));
    let held = postures.samples_of(&order);
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
