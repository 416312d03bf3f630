//! True machines drawn from `F` times the stated tolerances: is the factor named, do stated intervals hold the truth, and
//! which estimate predicts better?
//!
//! `cargo run --release --example tolerances -- 100 1,3,6,10 minimal,map PROBLEM...` prints a row per problem, factor and
//! identifier. The table of docs/design.md is made of these.

use gough::calibration::representative::representative;
use gough::calibration::{Coordinates, Sample};
use gough::files::{DataPlaces, ProblemFile, read_problem};
use gough::identify::score::score;
use gough::identify::{ToleranceVerdict, identify, pose_covariances};
use gough::lie::{Se3, so3};
use gough::measure::Pose;
use gough::problem::Form;
use gough::simulate::{Plan, close, simulate};
use gough::solve::{Identifier, Stop, registry};
use nalgebra::Matrix6;
use rayon::prelude::*;
use std::env::args;
use std::error::Error;
use std::path::Path;
use std::sync::Arc;

/// Two-sided 95 % quantile of the normal distribution.
const Z: f64 = 1.96;
/// Part of a tolerance below which a standard error is that of a redundant component.
const REDUNDANT: f64 = 1e-6;

/// What one true machine shows.
#[derive(Default)]
struct Run {
    converged: bool,
    alarm: bool,
    factor: f64,
    directions: usize,
    /// Components of links, and of predicted poses, whose interval holds the truth; and how many there are.
    links: (usize, usize),
    poses: (usize, usize),
    /// Errors of predicted poses, root mean square in the stated noise.
    holdout: f64,
    iterations: usize,
}

fn samples(poses: &[(Vec<f64>, Se3)], noise: &Matrix6<f64>) -> Result<Vec<Sample>, Box<dyn Error>> {
    let sample = |(actuators, pose): &(Vec<f64>, Se3)| {
        let measurement = Arc::new(Pose::new(*pose, [true; 6], noise)?);
        Ok(Sample { name: String::new(), actuators: actuators.clone(), measurement })
    };
    poses.iter().map(sample).collect()
}

/// `None` where the machine drawn does not close often enough.
fn run(
    problem: &ProblemFile,
    noise: &Matrix6<f64>,
    distance: f64,
    seed: u64,
    solver: &dyn Identifier,
) -> Option<Run> {
    let plan = Plan { poses: 40, holdout: 20, seed, noise: 1.0, distance };
    let drawn = &problem.mechanism;
    let simulated = simulate(drawn, noise, &plan).ok()?;
    let training = samples(&simulated.samples, noise).ok()?;
    let fresh = samples(&simulated.holdout, noise).ok()?;
    let found = identify(drawn, &training, solver, &Stop::default()).ok()?;
    let mut run = Run {
        converged: found.report.outcome.converged(),
        iterations: found.trace.len(),
        holdout: score(&found.start, &found.geometry, &fresh).map_or(f64::NAN, |fit| fit.weighted_rms),
        ..Run::default()
    };
    if let Some(test) = found.tolerance_test {
        run.alarm = test.verdict == ToleranceVerdict::TooSmall;
        (run.factor, run.directions) = (test.factor, test.directions);
    }
    let Some(errors) = found.standard_errors() else { return Some(run) };
    let truth = Coordinates::new(&found.start, Form::Minimal)
        .deviations(&representative(&found.start, &simulated.truth));
    for ((truth, found), error) in truth.iter().zip(&found.deviations).zip(&errors) {
        if *error > REDUNDANT * 1e-3 {
            run.links.0 += usize::from((truth - found).abs() <= Z * error);
            run.links.1 += 1;
        }
    }
    let machine = found.calibrated();
    let mut closed = Vec::new();
    let mut true_poses = Vec::new();
    for (actuators, pose) in &simulated.holdout {
        if let Ok(posture) = close(drawn, &found.geometry, actuators) {
            closed.push((actuators.clone(), posture));
            true_poses.push(*pose);
        }
    }
    let stated = pose_covariances(&machine, &closed, &found.link_root()?).ok()?;
    for (((_, posture), truth), stated) in closed.iter().zip(&true_poses).zip(&stated) {
        let (at, std) = (posture.tool(), stated.std());
        let w = so3::log(&(at.r * truth.r.transpose()));
        let dp = at.p - truth.p;
        for (error, std) in w.iter().chain(dp.iter()).zip(std) {
            run.poses.0 += usize::from(error.abs() <= Z * std);
            run.poses.1 += 1;
        }
    }
    Some(run)
}

fn main() -> Result<(), Box<dyn Error>> {
    let given: Vec<String> = args().skip(1).collect();
    let [seeds, factors, solvers, problems @ ..] = given.as_slice() else {
        return Err("give a number of seeds, factors, identifiers and problem files".into());
    };
    let seeds: u64 = seeds.parse()?;
    println!(
        "machine F identifier runs converged directions factor_median within_0.8_1.25 alarm links poses holdout iterations"
    );
    for path in problems {
        let problem = read_problem(Path::new(path), &DataPlaces::from_environment(None))?;
        let noise = problem.data.noise.ok_or("no noise is stated")?;
        for factor in factors.split(',') {
            let distance: f64 = factor.parse()?;
            for name in solvers.split(',') {
                let solver = registry::find(name)?;
                let one = |seed| run(&problem, &noise, distance, seed, solver.as_ref());
                let runs: Vec<Run> = (1..=seeds).into_par_iter().filter_map(one).collect();
                let share = |of: &dyn Fn(&Run) -> bool| {
                    100.0 * runs.iter().filter(|run| of(run)).count() as f64 / runs.len() as f64
                };
                let coverage = |of: &dyn Fn(&Run) -> (usize, usize)| {
                    let sum = runs.iter().map(of).fold((0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
                    sum.0 as f64 / sum.1 as f64
                };
                let mut sorted: Vec<f64> = runs.iter().map(|run| run.factor).collect();
                sorted.sort_by(f64::total_cmp);
                let mean = |of: &dyn Fn(&Run) -> f64| runs.iter().map(of).sum::<f64>() / runs.len() as f64;
                println!(
                    "{} {factor} {name} {} {:.0}% {:.0} {:.3} {:.0}% {:.0}% {:.3} {:.3} {:.4} {:.1}",
                    problem.name,
                    runs.len(),
                    share(&|run| run.converged),
                    mean(&|run| run.directions as f64),
                    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN),
                    share(&|run| (0.8..=1.25).contains(&(run.factor / distance))),
                    share(&|run| run.alarm),
                    coverage(&|run| run.links),
                    coverage(&|run| run.poses),
                    mean(&|run| run.holdout.powi(2)).sqrt(),
                    mean(&|run| run.iterations as f64),
                );
            }
        }
    }
    Ok(())
}
