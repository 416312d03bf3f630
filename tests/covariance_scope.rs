//! For what a covariance is stated, and for what not; noise from the residual where linear theory does not apply.

mod support;

use gough::calibration::Sample;
use gough::files::{DataPlaces, ProblemFile, read_problem};
use gough::identify::covariance::Variance;
use gough::identify::{Identification, identify, identify_without_noise, pose_covariances};
use gough::lie::Se3;
use gough::measure::{Pose, Weights};
use gough::model::Prior;
use gough::simulate::{Plan, Simulated, close, simulate};
use gough::solve::{Stop, registry};
use nalgebra::Matrix6;
use std::sync::Arc;

fn problem(name: &str) -> ProblemFile {
    let places = DataPlaces { data_dir: None, shared: "no such folder".into() };
    read_problem(&support::file(&format!("problems/{name}.json")), &places).unwrap()
}

fn drawn(problem: &ProblemFile, poses: usize, holdout: usize) -> Simulated {
    let plan = Plan { poses, holdout, seed: 4, noise: 1.0, distance: 1.0 };
    simulate(&problem.mechanism, &problem.data.noise.unwrap(), &plan).unwrap()
}

fn samples(poses: &[(Vec<f64>, Se3)], seen: [bool; 6], covariance: &Matrix6<f64>) -> Vec<Sample> {
    let sample = |(actuators, pose): &(Vec<f64>, Se3)| {
        let measurement = Arc::new(Pose::new(*pose, seen, covariance).unwrap());
        Sample { name: "measured".into(), actuators: actuators.clone(), measurement }
    };
    poses.iter().map(sample).collect()
}

/// Positions alone never show how the tool is turned: that is known as well as the tolerance says, and no better.
#[test]
fn what_positions_do_not_show_has_the_error_of_the_tolerance() {
    let puma = problem("serial-puma560");
    let covariance = puma.data.noise.unwrap();
    let drawn = drawn(&puma, 40, 5);
    let position = [false, false, false, true, true, true];
    let data = samples(&drawn.samples, position, &covariance);
    let solver = registry::find("minimal").unwrap();
    let found = identify(&puma.mechanism, &data, solver.as_ref(), &Stop::default()).unwrap();
    let root = &found.covariance.as_ref().unwrap().root;
    assert_eq!(root.nrows(), found.counts().unwrap().structural);
    assert_eq!(root.ncols(), root.nrows(), "the covariance is that of all directions");
    let tool = puma.mechanism.limbs[0].links.last().unwrap().tolerance.angle;
    let Prior::Sigma(tolerance) = tool else { panic!("{tool:?}") };
    let closed: Vec<_> = drawn
        .holdout
        .iter()
        .map(|(q, _)| (q.clone(), close(&puma.mechanism, &found.geometry, q).unwrap()))
        .collect();
    let stated = pose_covariances(&found.calibrated(), &closed, &found.link_root().unwrap()).unwrap();
    for covariance_of_pose in stated {
        let std = covariance_of_pose.std();
        eprintln!(
            "{:.3?} tolerances, {:?} m",
            std[..3].iter().map(|s| s / tolerance).collect::<Vec<_>>(),
            &std[3..]
        );
        assert!(std[..3].iter().all(|s| *s > 0.9 * tolerance && *s < 2.0 * tolerance), "{std:?} {tolerance}");
        assert!((0..3).all(|i| covariance_of_pose.prior[(i, i)] > 0.9 * covariance_of_pose.total[(i, i)]));
        assert!((3..6).all(|i| std[i] < covariance[(i, i)].sqrt()), "{std:?}");
    }
}

#[test]
fn no_covariance_without_convergence() {
    let hexapod = problem("hexapod-6ups");
    let run = |iterations: usize| -> Identification {
        let stop = Stop { iterations, ..Stop::default() };
        let solver = registry::find("minimal").unwrap();
        identify(&hexapod.mechanism, &hexapod.data.samples, solver.as_ref(), &stop).unwrap()
    };
    let cut = run(1);
    assert!(!cut.report.outcome.converged());
    assert!(cut.covariance.is_none() && cut.variances.is_none() && cut.link_root().is_none());
    assert!(cut.chi_square().is_none() && cut.standard_errors().is_none());
    let whole = run(Stop::default().iterations);
    assert!(whole.report.outcome.converged() && whole.covariance.is_some());
}

/// The noise is found from the residual by estimates without a linear theory, too.
#[test]
fn noise_from_the_residual_under_bounds_and_robust_losses() {
    let tripod = problem("tripod-3rps");
    let covariance = tripod.data.noise.unwrap();
    let drawn = drawn(&tripod, 80, 0);
    let blank: Vec<Sample> = samples(&drawn.samples, [true; 6], &covariance)
        .into_iter()
        .map(|s| Sample { measurement: s.measurement.reweighted(Weights::Unit), ..s })
        .collect();
    for name in ["minimal", "conic-bounded", "conic-huber"] {
        let mut solver = registry::find(name).unwrap();
        if name == "conic-bounded" {
            solver.set("bounds", "5").unwrap();
        }
        let (_, noise) =
            identify_without_noise(&tripod.mechanism, &blank, solver.as_ref(), &Stop::default()).unwrap();
        let (angle, length) = (noise.angle.unwrap(), noise.length.unwrap());
        let by = (angle / covariance[(0, 0)].sqrt(), length / covariance[(3, 3)].sqrt());
        eprintln!("{name}: {by:.3?} of the noise");
        assert!((by.0 - 1.0).abs() < 0.15 && (by.1 - 1.0).abs() < 0.15, "{name}: {by:?}");
    }
}

/// Scaled errors by hand: of a variance of 5 of which 1 is the prior's, twice the noise makes 4 * 4 + 1.
#[test]
fn scaled_errors_scale_the_part_of_the_data() {
    let variance = Variance { total: 5.0, prior: 1.0 };
    assert!((variance.scaled_error(2.0) - 17.0_f64.sqrt()).abs() < 1e-15);
    assert!((variance.scaled_error(1.0) - 5.0_f64.sqrt()).abs() < 1e-15);
}
