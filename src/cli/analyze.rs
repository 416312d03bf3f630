//! `gough analyze`: what poses can reveal.

use super::analysis::{Report, json_text};
use super::at::{registered, with_links_of};
use super::dispatch::Ending;
use super::error::CliError;
use super::progress::with_spinner;
use super::ranges::warn_of_singular_home;
use super::wording::reason;
use crate::calibration::Sample;
use crate::design::Observability;
use crate::files::{DataPlaces, DataSet, Kind, Output, ProblemFile, read_problem};
use crate::identify::untold::{Untold, untold_words};
use crate::identify::{Registration, analyze};
use crate::measure::Measurement;
use crate::model::{Geometry, Mechanism, mobility};
use crate::simulate::{draw_deviations, draw_postures, read};
use std::path::PathBuf;

/// Postures drawn where a problem holds none.
const PLANNED: usize = 60;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Problem file; samples without a pose are planned ones; without samples, random postures in the actuators' ranges
    /// stand in for them
    problem: PathBuf,
    /// Print counts, singular values, directions and postures as JSON
    #[arg(long)]
    json: bool,
    /// Geometry at which the machine is linearised
    #[arg(long, value_enum, default_value_t = At::Nominal)]
    at: At,
    /// Linearise at a machine drawn at random from N times the tolerances instead
    #[arg(long, value_name = "N", allow_negative_numbers = true, conflicts_with = "at")]
    perturb: Option<f64>,
    /// Number of random postures, in place of the samples
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    poses: Option<u32>,
    /// Seed of --perturb and --poses
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Further folder in which data files are looked for
    #[arg(long, value_name = "DIR")]
    data_dir: Option<PathBuf>,
}

/// Where the machine is linearised.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum At {
    /// As drawn
    Nominal,
    /// The true machine that a benchmark problem states
    Truth,
}

/// Prints the analysis.
pub fn run(args: &Args) -> Result<Ending, CliError> {
    if args.perturb.is_some_and(|n| !n.is_finite() || n < 0.0) {
        return Err(CliError::Usage("--perturb must be a number that is not negative".into()));
    }
    let problem = read_problem(&args.problem, &DataPlaces::from_environment(args.data_dir.clone()))?;
    problem.require_tolerances()?;
    warn_of_singular_home(&problem.mechanism);
    mobility::check(&problem.mechanism, &problem.mechanism.nominal())
        .map_err(|why| CliError::Mobility { file: problem.file.clone(), why })?;
    let (mechanism, untold, deviations, point) = place(&problem, args)?;
    let geometry = mechanism.deviated(&deviations);
    let (what, samples) = match args.poses {
        None if !problem.data.is_empty() || !problem.data.planned.is_empty() => {
            let mut samples = problem.data.samples.clone();
            if !problem.data.planned.is_empty() {
                samples.extend(planned_in_file(&problem, (&mechanism, &geometry))?);
            }
            let what = match (problem.data.samples.is_empty(), problem.data.planned.is_empty()) {
                (false, true) => "measured postures",
                (true, _) => "planned postures",
                (false, false) => "measured and planned postures",
            };
            (what, samples)
        }
        poses => {
            let count = poses.map_or(PLANNED, |count| count as usize);
            let what = match poses {
                None => "random postures (the problem has no samples)",
                Some(_) => "random postures",
            };
            (what, random(&problem, (&mechanism, &geometry), count, args.seed)?)
        }
    };
    let found =
        with_spinner(format!("analysing {}", problem.name), || analyze(&mechanism, &samples, &deviations))
            .map_err(|why| CliError::Evaluate { file: problem.file.clone(), why })?;
    let practical = &found.singular_values[..found.counts.practical.min(found.singular_values.len())];
    let report = Report {
        name: &problem.name,
        units: problem.units,
        mechanism: &mechanism,
        samples: &samples,
        what,
        point,
        found: &found,
        observability: Observability::of(practical, found.postures.len()),
        notes: problem
            .data
            .kind_notes()
            .into_iter()
            .map(str::to_owned)
            .chain(problem.data.point_note().map(str::to_owned))
            .chain(untold_words(&untold))
            .collect(),
    };
    let text = match args.json {
        true => json_text(&report)
            .map_err(|why| CliError::Usage(format!("the analysis cannot be written: {why}")))?,
        false => report.words().into_bytes(),
    };
    Output::Stdout.write(&text)?;
    Ok(Ending::Done)
}

/// The machine where its free ends are, what is not told of these, the deviations at which it is linearised, and that
/// point in words.
fn place(problem: &ProblemFile, args: &Args) -> Result<(Mechanism, Vec<Untold>, Vec<f64>, String), CliError> {
    if args.perturb.is_none() && args.at == At::Truth {
        return at_truth(problem);
    }
    let Registration { machine: mechanism, untold, .. } = registered(problem)?;
    let zero = vec![0.0; mechanism.component_count()];
    if let Some(factor) = args.perturb {
        let drawn = draw_deviations(&mechanism, args.seed, factor);
        let point = format!("at a machine drawn from {factor} times the tolerances (seed {})", args.seed);
        return Ok((mechanism, untold, drawn, point));
    }
    Ok((mechanism, untold, zero, "at nominal".into()))
}

/// The true machine of a benchmark problem, which stands where it stands.
fn at_truth(problem: &ProblemFile) -> Result<(Mechanism, Vec<Untold>, Vec<f64>, String), CliError> {
    let truth = problem.truth.as_ref().ok_or_else(|| {
        CliError::Usage(format!("{}: --at truth: the problem states no truth", problem.file))
    })?;
    let mechanism = with_links_of(problem.mechanism.clone(), truth)
        .map_err(|why| CliError::Usage(format!("{}: --at truth: {why}", problem.file)))?;
    let zero = vec![0.0; mechanism.component_count()];
    Ok((mechanism, Vec::new(), zero, "at the true machine".into()))
}

/// A posture at which the instrument is taken to measure with the stated noise: what `blank` reads there.
fn planned(
    problem: &ProblemFile,
    (mechanism, geometry): (&Mechanism, &Geometry),
    blank: &dyn Measurement,
    name: &str,
    (actuators, second): (&[f64], &[f64]),
) -> Result<Sample, CliError> {
    let measurement =
        read(mechanism, geometry, blank, actuators, second).map_err(|why| CliError::Posture {
            file: problem.file.clone(),
            sample: name.to_owned(),
            why: reason(&why, problem.units),
        })?;
    Ok(Sample { name: name.to_owned(), actuators: actuators.to_vec(), measurement })
}

/// Postures of the file of which nothing was measured yet.
fn planned_in_file(problem: &ProblemFile, machine: (&Mechanism, &Geometry)) -> Result<Vec<Sample>, CliError> {
    let mut samples = Vec::new();
    for set in problem.data.parts() {
        require_noise(problem, set)?;
        for (k, posture) in set.planned.iter().enumerate() {
            // Where none is stated, planned separations compare each posture with the next.
            let next = &set.planned[(k + 1) % set.planned.len()];
            let second = posture.second.as_ref().unwrap_or(&next.actuators);
            if set.kind == Kind::Separation && posture.second.is_none() && set.planned.len() == 1 {
                return Err(CliError::Usage(format!(
                    "{}: {}: a separation compares two postures, and only one is planned: state `second`, or plan more",
                    problem.file, posture.name
                )));
            }
            // What is predicted only adds nothing.
            if posture.measurement.weight() > 0.0 {
                let at = (posture.actuators.as_slice(), second.as_slice());
                samples.push(planned(problem, machine, &*posture.measurement, &posture.name, at)?);
            }
        }
    }
    Ok(samples)
}

/// Random postures inside the actuators' ranges, `count` for each set of data.
fn random(
    problem: &ProblemFile,
    machine: (&Mechanism, &Geometry),
    count: usize,
    seed: u64,
) -> Result<Vec<Sample>, CliError> {
    let sets = problem.data.parts();
    sets.iter().try_for_each(|set| require_noise(problem, set))?;
    let simulate = |why| CliError::Simulate { file: problem.file.clone(), why };
    let nominal = machine.0.nominal();
    // Two postures at least, so that no separation compares one with itself.
    let two = if sets.iter().any(|set| set.kind == Kind::Separation) { 2 } else { 1 };
    let drawn = draw_postures(machine.0, &[&nominal, machine.1], count.max(two), seed).map_err(simulate)?;
    let mut pool = drawn.into_iter().cycle();
    let mut next = || pool.next().unwrap_or_default();
    let mut samples = Vec::with_capacity(count * sets.len());
    for set in sets {
        for blank in set.blanks.iter().cycle().take(count) {
            let name = format!("posture {}", samples.len() + 1);
            let actuators = next();
            let second = if set.kind == Kind::Separation { next() } else { Vec::new() };
            samples.push(planned(problem, machine, &*blank.measurement, &name, (&actuators, &second))?);
        }
    }
    Ok(samples)
}

fn require_noise(problem: &ProblemFile, set: &DataSet) -> Result<(), CliError> {
    match set.noise {
        Some(_) => Ok(()),
        None => Err(CliError::Usage(format!(
            "{}: neither samples nor data.noise: state the noise to plan with",
            problem.file
        ))),
    }
}
