//! The arms job that other calibration packages have been measured on: a 6R arm, 50 full poses, link errors of 1 mm
//! and 2 mrad per component, noise of 50 um and 100 urad per axis, scored on 2,000 fresh poses.
//!
//! `cargo run --release --example arms` prints a row per arm: errors before and after, the Cramer-Rao bound of the same
//! draws, and the time of one identification, all as medians or root mean squares over the draws.

use gough::calibration::{Calibration, Sample};
use gough::files::{DataPlaces, read_problem};
use gough::identify::score::score;
use gough::linalg;
use gough::measure::{Pose, Weights};
use gough::model::Mechanism;
use gough::problem::{Form, Problem};
use gough::simulate::{Plan, simulate};
use gough::solve::{Stop, registry};
use nalgebra::Matrix6;
use std::error::Error;
use std::sync::Arc;
use std::time::Instant;

const DRAWS: u64 = 20;

fn samples(
    poses: &[(Vec<f64>, gough::lie::Se3)],
    covariance: &Matrix6<f64>,
) -> Result<Vec<Sample>, Box<dyn Error>> {
    let sample = |(actuators, pose): &(Vec<f64>, _)| {
        let measurement = Arc::new(Pose::new(*pose, [true; 6], covariance)?);
        Ok(Sample { name: String::new(), actuators: actuators.clone(), measurement })
    };
    poses.iter().map(sample).collect()
}

/// Root mean square errors of predicted rotation (rad) and position (m) that no unbiased estimate can beat.
fn bound(
    mechanism: &Mechanism,
    training: &[Sample],
    fresh: &[Sample],
    truth: &[f64],
) -> Result<(f64, f64), Box<dyn Error>> {
    let linearized = |samples: &[Sample]| {
        let problem = Calibration::new(mechanism, samples, Form::Minimal, truth);
        let x = problem.coordinates().nearest(truth);
        problem.linearize(&x)
    };
    let svd = linalg::svd(linearized(training)?.jac.as_ref()).ok_or("the Jacobian is not finite")?;
    let unit: Vec<Sample> = fresh
        .iter()
        .map(|s| Sample { measurement: s.measurement.reweighted(Weights::Unit), ..s.clone() })
        .collect();
    let seen = linearized(&unit)?.jac * &svd.v;
    let (mut rotation, mut position) = (0.0, 0.0);
    for i in 0..seen.nrows() {
        let variance: f64 = svd.s.iter().enumerate().map(|(k, s)| (seen[(i, k)] / s).powi(2)).sum();
        *(if i % 6 < 3 { &mut rotation } else { &mut position }) += variance;
    }
    let count = fresh.len() as f64;
    Ok(((rotation / count).sqrt(), (position / count).sqrt()))
}

fn main() -> Result<(), Box<dyn Error>> {
    let minimal = registry::find("minimal")?;
    println!("| arm | before, um | after, um / urad | bound, um / urad | ms |\n|---|---|---|---|---|");
    for name in ["serial-ur10", "serial-puma560"] {
        let path = format!("{}/problems/{name}.json", env!("CARGO_MANIFEST_DIR"));
        let file = read_problem(path.as_ref(), &DataPlaces::from_environment(None))?;
        let covariance = file.data.noise.ok_or("no noise stated")?;
        let mut squares = [0.0; 5];
        let mut times = Vec::new();
        for seed in 0..DRAWS {
            let plan = Plan { poses: 50, holdout: 2000, seed, noise: 1.0, distance: 1.0 };
            let drawn = simulate(&file.mechanism, &covariance, &plan)?;
            let training = samples(&drawn.samples, &covariance)?;
            let fresh = samples(&drawn.holdout, &covariance)?;
            let nominal = vec![0.0; file.mechanism.component_count()];
            let clock = Instant::now();
            let problem = Calibration::new(&file.mechanism, &training, Form::Minimal, &nominal);
            let start = vec![0.0; problem.params().len()];
            let report = minimal.identify(&problem, &start, &Stop::default());
            times.push(clock.elapsed().as_secs_f64());
            let found = file.mechanism.deviated(&problem.coordinates().deviations(&report.x));
            let before =
                score(&file.mechanism, &file.mechanism.nominal(), &fresh).and_then(|fit| fit.position);
            let after = score(&file.mechanism, &found, &fresh).ok_or("no fresh pose closes")?;
            let truth = drawn.truth.deviations_from(&file.mechanism.nominal());
            let (rotation, position) = bound(&file.mechanism, &training, &fresh, &truth)?;
            let values = [
                before.map_or(0.0, |p| p.rms),
                after.position.map_or(0.0, |p| p.rms),
                after.rotation.map_or(0.0, |r| r.rms),
                position,
                rotation,
            ];
            squares.iter_mut().zip(values).for_each(|(sum, v)| *sum += v * v);
        }
        times.sort_by(f64::total_cmp);
        let [before, um, urad, bound_um, bound_urad] = squares.map(|sum| 1e6 * (sum / DRAWS as f64).sqrt());
        println!(
            "| {name} | {before:.0} | {um:.1} / {urad:.1} | {bound_um:.1} / {bound_urad:.1} | {:.2} |",
            1e3 * times[times.len() / 2]
        );
    }
    Ok(())
}
