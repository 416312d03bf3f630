//! Outliers: how often clean data raise an alarm, and whether gross errors are told from what they drag along.

mod support;

use gough::calibration::Sample;
use gough::files::{DataPlaces, ProblemFile, read_problem};
use gough::identify::outliers::FALSE_ALARM;
use gough::identify::{Identification, identify};
use gough::lie::{Se3, so3};
use gough::measure::Pose;
use gough::simulate::{Plan, simulate};
use gough::solve::{Stop, registry};
use nalgebra::{Matrix6, Vector6};
use rayon::prelude::*;
use std::sync::Arc;

fn problem(name: &str) -> ProblemFile {
    let places = DataPlaces { data_dir: None, shared: "no such folder".into() };
    read_problem(&support::file(&format!("problems/{name}.json")), &places).unwrap()
}

/// Identifies from thirty simulated poses of which those in `wrong` are off by `by` standard deviations in every component.
fn identified(problem: &ProblemFile, solver: &str, seed: u64, wrong: &[usize], by: f64) -> Identification {
    let covariance: Matrix6<f64> = problem.data.noise.unwrap();
    let plan = Plan { poses: 30, holdout: 0, seed, noise: 1.0, distance: 1.0 };
    let drawn = simulate(&problem.mechanism, &covariance, &plan).unwrap();
    let sample = |(k, (actuators, pose)): (usize, (Vec<f64>, Se3))| {
        let off = covariance.map(f64::sqrt) * Vector6::repeat(if wrong.contains(&k) { by } else { 0.0 });
        let turn = so3::exp(&off.fixed_rows::<3>(0).into_owned());
        let pose = Se3 { r: turn * pose.r, p: pose.p + off.fixed_rows::<3>(3) };
        let measurement = Arc::new(Pose::new(pose, [true; 6], &covariance).unwrap());
        Sample { name: format!("{k}"), actuators, measurement }
    };
    let samples: Vec<Sample> = drawn.samples.into_iter().enumerate().map(sample).collect();
    let solver = registry::find(solver).unwrap();
    identify(&problem.mechanism, &samples, solver.as_ref(), &Stop::default()).unwrap()
}

/// Of 500 clean sets of data one in a hundred at most may raise an alarm: 5 are expected at most, and more than 12 with a
/// probability of 0.2 % (binomial).
#[test]
fn clean_data_raise_few_alarms() {
    const SETS: u64 = 500;
    let scara = problem("serial-scara");
    let alarms = |seed: u64| usize::from(!identified(&scara, "minimal", seed, &[], 0.0).outliers.is_empty());
    let raised: usize = (0..SETS).into_par_iter().map(alarms).sum();
    eprintln!("{raised} of {SETS} clean sets of data raise an alarm");
    assert!(raised <= 12 && FALSE_ALARM == 0.01, "{raised}");
    // The test is not blind: eight standard deviations in each component of one pose are found all but always.
    let found = |seed: u64| {
        let outliers = identified(&scara, "minimal", seed, &[4], 8.0).outliers;
        usize::from(outliers.len() == 1 && outliers[0].name == "4")
    };
    let found: usize = (0..100).into_par_iter().map(found).sum();
    eprintln!("{found} of 100 errors of eight standard deviations are found");
    assert!(found >= 95, "{found}");
}

/// Gross errors pull the machine after them, so that good postures are predicted badly. They are not blamed.
#[test]
fn gross_errors_are_found_and_their_neighbours_are_not_blamed() {
    // Limb by limb the estimate is not that of the readings together, from which the others are judged: it is dragged
    // farther than one linear step leads back, and good postures are blamed in a part of the runs.
    for (name, solver, wrong, by, least) in [
        ("tripod-3rps", "minimal", vec![7], 100.0, 19),
        ("tripod-3rps", "map", vec![3, 12, 22], 60.0, 19),
        ("hexapod-6pus", "limbwise", vec![9], 100.0, 12),
        ("serial-puma560", "minimal", vec![2, 17], 80.0, 19),
    ] {
        let drawn = problem(name);
        let each: Vec<Vec<usize>> = (0..20_u64)
            .into_par_iter()
            .map(|seed| {
                let found = identified(&drawn, solver, seed, &wrong, by);
                let mut named: Vec<usize> = found.outliers.iter().map(|o| o.name.parse().unwrap()).collect();
                named.sort_unstable();
                named
            })
            .collect();
        let exact = each.iter().filter(|named| **named == wrong).count();
        let missed = each.iter().filter(|named| !wrong.iter().all(|k| named.contains(k))).count();
        eprintln!("{name} {solver}: {exact} of {} exact, {missed} miss one", each.len());
        assert_eq!(missed, 0, "{name}: {each:?}");
        assert!(exact >= least, "{name}: {each:?}");
    }
}
