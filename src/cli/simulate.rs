//! `gough simulate`: a benchmark problem with known truth.

use super::dispatch::Ending;
use super::error::CliError;
use crate::compare::draw::simulate_by;
use crate::files::{
    DataDrawing, DataPlaces, Kind, Output, ProblemFile, SampleDrawing, json, noise::NoiseDrawing,
    read_problem, redraw,
};
use crate::model::mobility;
use crate::simulate::Plan;
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Problem file: machine, tolerances and noise; its data, if any, are replaced
    problem: PathBuf,
    /// Number of measured postures
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    poses: u32,
    /// Number of further postures with their true poses, for the hold-out
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
    /// Where to write the problem
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
}

/// Writes the problem with simulated data, hold-out and truth.
pub fn run(args: &Args) -> Result<Ending, CliError> {
    let output = Output::named(Some(&args.output));
    output.check()?;
    for (name, value) in [("--noise", args.noise), ("--distance", args.distance)] {
        if !value.is_finite() || value < 0.0 {
            return Err(CliError::Usage(format!("{name} must be a number that is not negative")));
        }
    }
    let problem = read_problem(&args.problem, &DataPlaces::from_environment(None))?;
    problem.require_tolerances()?;
    mobility::check(&problem.mechanism, &problem.mechanism.nominal())
        .map_err(|why| CliError::Mobility { file: problem.file.clone(), why })?;
    let covariance = problem.data.noise.ok_or_else(|| {
        CliError::Usage(format!("{}: data.noise is not stated: simulation needs to know it", problem.file))
    })?;
    let Args { poses, holdout, seed, noise, distance, .. } = *args;
    let plan = Plan { poses: poses as usize, holdout: holdout as usize, seed, noise, distance };
    let recipe = problem.drawing.benchmark.clone().unwrap_or_default();
    let simulated = simulate_by(&recipe, &problem.mechanism, &covariance, &plan)
        .map_err(|why| CliError::Simulate { file: problem.file.clone(), why })?;
    let drawing = with_data(&problem, &simulated, args);
    let text = json::text(&drawing)
        .map_err(|why| CliError::Usage(format!("the problem cannot be written: {why}")))?;
    output.write(&text)?;
    Ok(Ending::Done)
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
    let origin = format!(
        "gough simulate --poses {} --holdout {} --seed {} --noise {} --distance {}",
        args.poses, args.holdout, args.seed, args.noise, args.distance
    );
    let holdout = (args.holdout > 0).then(|| {
        let samples = Some(drawn(&simulated.holdout));
        Box::new(DataDrawing { origin: Some("true poses".into()), samples, ..DataDrawing::default() })
    });
    let mut drawing = problem.drawing.clone();
    drawing.data = Some(DataDrawing {
        kind: stated.kind,
        origin: Some(origin),
        noise,
        covariance,
        samples: Some(drawn(&simulated.samples)),
        holdout,
        ..DataDrawing::default()
    });
    drawing.truth = Some(redraw(mechanism, &simulated.truth, units).without_priors());
    drawing
}
