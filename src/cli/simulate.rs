//! `gough simulate`: a benchmark problem with known truth.

use super::dispatch::Ending;
use super::error::CliError;
use super::ranges::warn_of_home;
use super::wording::counted;
use crate::compare::draw::{check_recipe, simulate_by, simulate_sets_by};
use crate::files::problem::parse_problem;
use crate::files::{
    DataDrawing, DataPlaces, DataSet, Kind, Output, ProblemDrawing, ProblemFile, SampleDrawing,
    constant_values, json, kinds, noise::NoiseDrawing, read_problem, redraw,
};
use crate::model::{Geometry, mobility};
use crate::simulate::readings::Reading;
use crate::simulate::{Plan, SimulatedSet};
use nalgebra::Matrix6;
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Problem file: machine, tolerances and noise; its data, if any, are replaced
    problem: PathBuf,
    /// Number of measured postures (all targets at each where data.posture_noise is stated, else in turn); a list with one per set where the data consist of several
    #[arg(long, value_name = "N", value_delimiter = ',', required = true,
        value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    poses: Vec<u32>,
    /// What is measured instead of what the problem says: pose, position, distance, separation, plane, passive-joint
    #[arg(long, value_name = "KIND")]
    kind: Option<String>,
    /// Number of further postures with true readings, for the hold-out (of each set)
    #[arg(long, value_name = "N", default_value_t = 40, value_parser = clap::value_parser!(u32).range(0..=1_000_000))]
    holdout: u32,
    /// Seed of everything random
    #[arg(long, value_name = "N")]
    seed: u64,
    /// Factor on the stated noise; the problem keeps stating it
    #[arg(long, value_name = "SCALE", default_value_t = 1.0, allow_negative_numbers = true)]
    noise: f64,
    /// Factor on the tolerances from which the truth is drawn
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, allow_negative_numbers = true)]
    distance: f64,
    /// Further folder in which data files are looked for
    #[arg(long, value_name = "DIR")]
    data_dir: Option<PathBuf>,
    /// Where to write the problem, a JSON file
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
}

/// Writes the problem with simulated data, hold-out and truth.
pub fn run(args: &Args) -> Result<Ending, CliError> {
    let output = Output::named(Some(&args.output));
    output.check()?;
    if args.output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("csv")) {
        return Err(CliError::Usage(format!(
            "-o {}: a simulated problem holds machine, noise and truth, which a table cannot; name a .json file",
            args.output.display()
        )));
    }
    for (name, value) in [("--noise", args.noise), ("--distance", args.distance)] {
        if !value.is_finite() || value < 0.0 {
            return Err(CliError::Usage(format!("{name} must be a number that is not negative")));
        }
    }
    let problem = problem_to_measure(args)?;
    problem.require_tolerances()?;
    mobility::check(&problem.mechanism, &problem.mechanism.nominal())
        .map_err(|why| CliError::Mobility { file: problem.file.clone(), why })?;
    let sets = problem.data.parts();
    let not_stated = || {
        CliError::Usage(format!("{}: data.noise is not stated: simulation needs to know it", problem.file))
    };
    let covariance =
        sets.iter().map(|set| set.noise.ok_or_else(not_stated)).collect::<Result<Vec<_>, _>>()?;
    let counts: Vec<usize> = match args.poses.as_slice() {
        [all] => vec![*all as usize; sets.len()],
        each if each.len() == sets.len() => each.iter().map(|n| *n as usize).collect(),
        each => {
            let (found, wanted) = (each.len(), sets.len());
            return Err(CliError::Usage(format!(
                "--poses: {} for {}; give one number{}",
                counted(found, "number"),
                counted(wanted, "set"),
                if wanted > 1 { format!(" for all of them, or {wanted}") } else { String::new() },
            )));
        }
    };
    let Args { holdout, seed, noise, distance, .. } = *args;
    let plan = Plan { poses: counts[0], holdout: holdout as usize, seed, noise, distance };
    let failed = |why| CliError::Simulate { file: problem.file.clone(), why };
    check_recipe(&problem).map_err(|why| CliError::Usage(format!("{}: {why}", problem.file)))?;
    let recipe = problem.drawing.benchmark.clone().unwrap_or_default();
    let mechanism = &problem.mechanism;
    let drawing = if problem.measures_tool_alone() {
        let common = problem.data.posture_noise.unwrap_or_default();
        let whole = covariance[0] + Matrix6::from_diagonal(&common.variances());
        with_data(&problem, &simulate_by(&recipe, mechanism, &whole, &plan).map_err(failed)?, args)
    } else {
        let blanks =
            sets.iter().map(|set| set.blanks.iter().map(|blank| blank.measurement.clone()).collect());
        let blanks: Vec<Vec<_>> = blanks.collect();
        let (truth, read) = simulate_sets_by(&recipe, mechanism, &blanks, &counts, &plan).map_err(failed)?;
        with_sets(&problem, &truth, &read, args)
    };
    let text = json::text(&drawing)
        .map_err(|why| CliError::Usage(format!("the problem cannot be written: {why}")))?;
    warn_of_home(&problem.mechanism);
    output.write(&text)?;
    Ok(Ending::Done)
}

/// The problem, with another kind of measurement where one is asked for.
fn problem_to_measure(args: &Args) -> Result<ProblemFile, CliError> {
    let places = DataPlaces::from_environment(args.data_dir.clone());
    let problem = read_problem(&args.problem, &places)?;
    let Some(kind) = &args.kind else { return Ok(problem) };
    let mut drawing = problem.drawing;
    let data = drawing.data.unwrap_or_default();
    drawing.data = Some(DataDrawing {
        kind: Some(kind.clone()),
        samples: None,
        sets: None,
        file: None,
        columns: None,
        filter: None,
        holdout: None,
        ..data
    });
    let text = json::text(&drawing)
        .map_err(|why| CliError::Usage(format!("the problem cannot be written: {why}")))?;
    Ok(parse_problem(&args.problem, &text, &places)?)
}

/// How the data came about.
fn origin(args: &Args) -> String {
    let poses: Vec<String> = args.poses.iter().map(u32::to_string).collect();
    let kind = args.kind.as_ref().map_or(String::new(), |kind| format!(" --kind {kind}"));
    format!(
        "gough simulate --poses {}{kind} --holdout {} --seed {} --noise {} --distance {}",
        poses.join(","),
        args.holdout,
        args.seed,
        args.noise,
        args.distance
    )
}

/// The problem with readings of any kinds, set by set.
fn with_sets(problem: &ProblemFile, truth: &Geometry, read: &[SimulatedSet], args: &Args) -> ProblemDrawing {
    let (mechanism, units) = (&problem.mechanism, problem.units);
    let parts = problem.data.parts();
    let drawn = |part: &DataSet, first: usize, readings: &[Reading]| -> Vec<SampleDrawing> {
        let pairs = part.blanks.iter().cycle().skip(first).zip(readings);
        pairs.map(|(blank, (q, m))| kinds::drawn(mechanism, units, part.kind, blank, q, &**m)).collect()
    };
    let stated = problem.drawing.data.clone().unwrap_or_default();
    let several = stated.sets.is_some();
    let of_set = |k: usize, readings: &[Reading], held: bool| {
        let common = match &stated.sets {
            Some(sets) => sets[k].clone(),
            None => DataDrawing { instrument: None, posture_noise: None, ..stated.clone() },
        };
        let common = if held && !several { DataDrawing::default() } else { common };
        DataDrawing {
            samples: Some(drawn(&parts[k], if held { read[k].samples.len() } else { 0 }, readings)),
            origin: None,
            file: None,
            columns: None,
            filter: None,
            holdout: None,
            sets: None,
            ..common
        }
    };
    let whole = |of: fn(&SimulatedSet) -> &Vec<Reading>, held: bool| {
        let sets: Vec<DataDrawing> =
            read.iter().enumerate().map(|(k, set)| of_set(k, of(set), held)).collect();
        match several {
            true => DataDrawing { sets: Some(sets), ..DataDrawing::default() },
            false => sets.into_iter().next().unwrap_or_default(),
        }
    };
    let holdout = (args.holdout > 0).then(|| {
        Box::new(DataDrawing { origin: Some("true readings".into()), ..whole(|set| &set.holdout, true) })
    });
    let samples = whole(|set| &set.samples, false);
    let mut drawing = problem.drawing.clone();
    drawing.data = Some(match several {
        true => DataDrawing {
            origin: Some(origin(args)),
            sets: samples.sets,
            holdout,
            file: None,
            columns: None,
            filter: None,
            samples: None,
            ..stated.clone()
        },
        false => DataDrawing {
            origin: Some(origin(args)),
            instrument: stated.instrument.clone(),
            posture_noise: stated.posture_noise,
            holdout,
            ..samples
        },
    });
    drawing.truth = Some(redraw(mechanism, truth, units).without_priors());
    drawing.truth_instrument = constant_values(&mechanism.instrument, &truth.instrument, units);
    drawing
}

fn with_data(
    problem: &ProblemFile,
    simulated: &crate::simulate::Simulated,
    args: &Args,
) -> crate::files::ProblemDrawing {
    let (mechanism, units) = (&problem.mechanism, problem.units);
    let drawn = |samples: &[(Vec<f64>, crate::lie::Se3)]| {
        let sample = |(q, pose): &(Vec<f64>, _)| {
            let mut sample = SampleDrawing::of(mechanism, units, q, pose);
            if problem.data.kind == Kind::Position {
                sample.pose.rotation = None;
            }
            sample
        };
        samples.iter().map(sample).collect()
    };
    let stated = problem.drawing.data.clone().unwrap_or_default();
    let (noise, covariance): (Option<NoiseDrawing>, _) = (stated.noise, stated.covariance);
    let holdout = (args.holdout > 0).then(|| {
        let samples = Some(drawn(&simulated.holdout));
        Box::new(DataDrawing { origin: Some("true poses".into()), samples, ..DataDrawing::default() })
    });
    let mut drawing = problem.drawing.clone();
    drawing.data = Some(DataDrawing {
        kind: stated.kind,
        origin: Some(origin(args)),
        noise,
        covariance,
        posture_noise: stated.posture_noise,
        samples: Some(drawn(&simulated.samples)),
        holdout,
        ..DataDrawing::default()
    });
    drawing.truth = Some(redraw(mechanism, &simulated.truth, units).without_priors());
    drawing
}
