//! Less noise, more directions, smaller errors; machines far from their drawing; postures out of the drawing's reach.

mod support;

use gough::calibration::Sample;
use gough::files::{DataPlaces, ProblemFile, read_actuators, read_model, read_problem};
use gough::identify::{Fit, Identification, identify, score};
use gough::lie::{Se3, so3};
use gough::measure::Pose;
use gough::model::{Geometry, Mechanism};
use gough::simulate::{Plan, close, simulate};
use gough::solve::Stop;
use gough::solve::minimal::Minimal;
use nalgebra::{Matrix6, Vector6};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::path::Path;
use std::sync::Arc;
use support::{GOLDEN, golden};

/// Of the golden cases, rad and m, per component.
const NOISE: (f64, f64) = (2e-5, 1e-5);

fn problem(path: &Path) -> ProblemFile {
    read_problem(path, &DataPlaces { data_dir: None, shared: "no such folder".into() }).unwrap()
}

fn covariance(scale: f64) -> Matrix6<f64> {
    let variance = |sigma: f64| (sigma * scale).powi(2);
    let (w, v) = (variance(NOISE.0), variance(NOISE.1));
    Matrix6::from_diagonal(&Vector6::new(w, w, w, v, v, v))
}

/// What an instrument of `scale` times the stated noise reads of the machine, and states.
fn measured(
    machine: &Mechanism,
    geometry: &Geometry,
    variables: &[Vec<f64>],
    scale: f64,
    seed: u64,
) -> Vec<Sample> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut sample = |(k, actuators): (usize, &Vec<f64>)| {
        let tool = close(machine, geometry, actuators).unwrap().tool();
        let n: Vector6<f64> = Vector6::from_fn(|i, _| {
            let normal: f64 = StandardNormal.sample(&mut rng);
            normal * scale * if i < 3 { NOISE.0 } else { NOISE.1 }
        });
        let turn = so3::exp(&n.fixed_rows::<3>(0).into_owned());
        let read = Se3 { r: turn * tool.r, p: tool.p + n.fixed_rows::<3>(3) };
        let pose = Pose::new(read, [true; 6], &covariance(scale)).unwrap();
        Sample {
            name: format!("sample {}", k + 1),
            actuators: actuators.clone(),
            measurement: Arc::new(pose),
        }
    };
    variables.iter().enumerate().map(&mut sample).collect()
}

/// True poses as a hold-out.
fn exact(poses: &[(Vec<f64>, Se3)]) -> Vec<Sample> {
    let sample = |(actuators, pose): &(Vec<f64>, Se3)| {
        let pose = Pose::new(*pose, [true; 6], &covariance(1.0)).unwrap();
        Sample { name: "hold-out".into(), actuators: actuators.clone(), measurement: Arc::new(pose) }
    };
    poses.iter().map(sample).collect()
}

fn identified(mechanism: &Mechanism, samples: &[Sample]) -> Identification {
    identify(mechanism, samples, &Minimal::default(), &Stop::default()).unwrap()
}

/// Hold-out error in units of the noise: rotation and position, root mean square of lengths by noise per component.
fn in_noise(found: &Identification, holdout: &[Sample], scale: f64) -> (f64, f64) {
    let fit: Fit = score::score(&found.start, &found.geometry, holdout).unwrap();
    assert_eq!(fit.samples, holdout.len());
    (fit.rotation.unwrap().rms / (scale * NOISE.0), fit.position.unwrap().rms / (scale * NOISE.1))
}

#[test]
fn a_tenth_of_the_noise_leaves_a_tenth_of_the_error() {
    for case in GOLDEN {
        let drawn = problem(&golden(case, "problem.json"));
        let truth = read_model(&golden(case, "truth.json")).unwrap();
        let variables: Vec<Vec<f64>> = drawn.data.samples.iter().map(|s| s.actuators.clone()).collect();
        let rows = read_actuators(&golden(case, "holdout.json"), &truth).unwrap();
        let machine = &truth.mechanism;
        let tool = |actuators: &[f64]| close(machine, &machine.nominal(), actuators).unwrap().tool();
        let poses: Vec<(Vec<f64>, Se3)> =
            rows.iter().map(|row| (row.variables.clone(), tool(&row.variables))).collect();
        let holdout = exact(&poses);
        let mut kept = 0;
        for scale in [1.0, 0.1, 0.01] {
            for seed in 1..=3 {
                let samples = measured(machine, &machine.nominal(), &variables, scale, seed);
                let found = identified(&drawn.mechanism, &samples);
                let (rotation, position) = in_noise(&found, &holdout, scale);
                let counts = found.counts().unwrap();
                let what = format!(
                    "{case}, {scale} of the noise, seed {seed}: {rotation:.2} and {position:.2} of it, {} of {} \
                     directions, {} iterations",
                    counts.practical,
                    counts.structural,
                    found.trace.len()
                );
                eprintln!("{what}");
                assert!(found.report.outcome.converged(), "{what}: {}", found.report.outcome);
                assert!(rotation <= 2.0 && position <= 2.0, "{what}");
                assert!(counts.practical >= kept, "{what}: before {kept}");
                if seed == 3 {
                    kept = counts.practical;
                }
            }
        }
    }
}

#[test]
fn three_tolerances_away() {
    for case in GOLDEN {
        let drawn = problem(&golden(case, "problem.json")).mechanism;
        for seed in 1..=3 {
            let plan = Plan { poses: 60, holdout: 30, seed, noise: 1.0, distance: 3.0 };
            let simulated = simulate(&drawn, &covariance(1.0), &plan).unwrap();
            let variables: Vec<Vec<f64>> = simulated.samples.iter().map(|(q, _)| q.clone()).collect();
            let samples = measured(&drawn, &simulated.truth, &variables, 1.0, seed);
            let found = identified(&drawn, &samples);
            let (rotation, position) = in_noise(&found, &exact(&simulated.holdout), 1.0);
            let iterations = found.trace.len();
            eprintln!(
                "{case}, seed {seed}: {rotation:.2} and {position:.2} of the noise, {iterations} iterations"
            );
            assert!(found.report.outcome.converged(), "{case} {seed}: {}", found.report.outcome);
            assert!(rotation <= 2.0 && position <= 2.0, "{case} {seed}: {rotation} {position}");
        }
    }
}
