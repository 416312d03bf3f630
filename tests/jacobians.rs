//! Error Jacobians against finite differences of the forward kinematics with loops closed again.
//!
//! Steps are 0.3 tolerances (0.3 mrad, 0.3 mm) and less: the extrapolated differences leave an error of the order of
//! the fourth power of that, and loops closed to 1e-15 leave `1e-15 / 3e-4` of the largest entry.

mod random_machine;
mod support;

use faer::Mat;
use gough::calibration::{Calibration, Sample};
use gough::files::{DataPlaces, read_problem};
use gough::lie::{Se3, so3};
use gough::measure::{Evaluation, Measurement, Pose, View, Weights};
use gough::model::Mechanism;
use gough::problem::{Form, Problem, check};
use gough::simulate::draw_deviations;
use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use random_machine::{PATTERNS, random_components, random_covariance, random_machine, random_samples};
use std::sync::Arc;
use support::{name, problems};

/// Difference of any entry from its finite difference, in parts of the largest entry.
const OF_LARGEST: f64 = 1e-9;
/// The same in parts of the largest entry of its own column; a column counts as no smaller than a thousandth of
/// the largest.
const OF_COLUMN: f64 = 1e-7;

fn in_form(samples: &[Sample], form: Form) -> Vec<Sample> {
    let weighted = |s: &Sample| match form {
        Form::Plain => s.measurement.reweighted(Weights::SpatialTwist),
        Form::Minimal | Form::Complete => s.measurement.clone(),
    };
    samples.iter().map(|s| Sample { measurement: weighted(s), ..s.clone() }).collect()
}

/// Checks the Jacobian at nominal and at a random deviation; returns the two errors. Of several steps each column takes
/// the one whose difference comes closest: a wrong column is far from all.
fn assert_jacobian(
    mechanism: &Mechanism,
    samples: &[Sample],
    form: Form,
    steps: &[f64],
    what: &str,
) -> (f64, f64) {
    let samples = in_form(samples, form);
    let unit = if form == Form::Plain { 1e-3 } else { 1.0 };
    let mut worst = (0.0_f64, 0.0_f64);
    for distance in [0.0, 1.0] {
        let at = draw_deviations(mechanism, 5, distance);
        let problem = Calibration::new(mechanism, &samples, form, &at);
        assert!(problem.sample_count() > 0, "{what}: {:?}", problem.set_aside());
        let x = problem.coordinates().nearest(&at);
        let analytic = problem.linearize(&x).unwrap().jac;
        let difference = |step| &analytic - check::finite_difference(&problem, &x, unit * step).unwrap();
        let differences: Vec<Mat<f64>> = steps.iter().map(difference).collect();
        let largest = analytic.norm_max();
        for (j, column) in analytic.col_iter().enumerate() {
            let errors = differences.iter().map(|difference| difference.col(j).norm_max());
            let error = errors.fold(f64::INFINITY, f64::min);
            worst.0 = worst.0.max(error / largest);
            worst.1 = worst.1.max(error / column.norm_max().max(1e-3 * largest));
        }
        assert!(
            worst.0 <= OF_LARGEST && worst.1 <= OF_COLUMN,
            "{what} {form:?} {distance}: {:.1e} {:.1e}",
            worst.0,
            worst.1
        );
    }
    worst
}

fn every_problem(form: Form) {
    let places = DataPlaces { data_dir: None, shared: "no such folder".into() };
    let mut worst = (0.0_f64, 0.0_f64);
    for path in problems() {
        let read = read_problem(&path, &places).unwrap();
        let samples: Vec<Sample> = read.data.samples.iter().step_by(25).cloned().collect();
        let found = assert_jacobian(&read.mechanism, &samples, form, &[0.3], &name(&path));
        worst = (worst.0.max(found.0), worst.1.max(found.1));
    }
    eprintln!("{form:?}: {:.1e} of the largest entry, {:.1e} of a column's", worst.0, worst.1);
}

#[test]
fn of_every_problem_minimal() {
    every_problem(Form::Minimal);
}

#[test]
fn of_every_problem_complete() {
    every_problem(Form::Complete);
}

#[test]
fn of_every_problem_plain() {
    every_problem(Form::Plain);
}

#[test]
fn of_random_machines_with_partial_measurements() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let mut worst = (0.0_f64, 0.0_f64);
    for pattern in PATTERNS {
        for round in 0..4 {
            let mechanism = random_machine(pattern, 1, &mut rng);
            let samples = random_samples(&mechanism, 4, 0.1, true, &mut rng);
            // One form a machine, but complete, of which the others are products, always.
            let others = [Form::Minimal, Form::Plain];
            for form in [Form::Complete, others[round % 2]] {
                // Some of these bend faster than machines that are built; others show the rounding of their closures.
                let what = format!("{pattern:?} {round}");
                let found = assert_jacobian(&mechanism, &samples, form, &[0.02, 0.05], &what);
                worst = (worst.0.max(found.0), worst.1.max(found.1));
            }
        }
    }
    eprintln!("random: {:.1e} of the largest entry, {:.1e} of a column's", worst.0, worst.1);
}

fn norm_squared(jac: &Mat<f64>, dx: &[f64], r: &[f64]) -> f64 {
    let along = gough::linalg::mul(jac.as_ref(), dx);
    along.iter().zip(r).map(|(a, b)| (a + b) * (a + b)).sum()
}

#[test]
fn gradient_and_compressed_rows_are_those_of_the_jacobian() {
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    // More postures than one thread takes at a time, so that parts are joined.
    for (pattern, count) in [(PATTERNS[0], 300), (PATTERNS[4], 150), (PATTERNS[6], 5)] {
        let mechanism = random_machine(pattern, 1, &mut rng);
        let samples = random_samples(&mechanism, count, 0.05, true, &mut rng);
        for form in [Form::Minimal, Form::Complete, Form::Plain] {
            let samples = in_form(&samples, form);
            let at = draw_deviations(&mechanism, 6, 0.5);
            let problem = Calibration::new(&mechanism, &samples, form, &at);
            let x = problem.coordinates().nearest(&at);
            let rows = problem.linearize(&x).unwrap();
            assert_eq!(problem.residual(&x).unwrap(), rows.r);
            let (cost, gradient) = problem.gradient(&x).unwrap();
            let half: f64 = 0.5 * rows.r.iter().map(|r| r * r).sum::<f64>();
            assert!((cost - half).abs() <= 1e-14 * half);
            let product = gough::linalg::mul_transpose(rows.jac.as_ref(), &rows.r);
            let scale = rows.jac.norm_l2() * (2.0 * half).sqrt();
            for (a, b) in gradient.iter().zip(&product) {
                assert!((a - b).abs() <= 1e-13 * scale, "{a} {b} {scale}");
            }
            let small = problem.compress(&x).unwrap();
            assert!(small.r.len() <= x.len() && (small.cost - half).abs() <= 1e-13 * half);
            let beyond = 2.0 * small.cost - small.r.iter().map(|r| r * r).sum::<f64>();
            for size in [1e-3, 1.0] {
                let dx: Vec<f64> = x.iter().map(|_| rng.random_range(-size..size)).collect();
                let (all, few) =
                    (norm_squared(&rows.jac, &dx, &rows.r), norm_squared(&small.jac, &dx, &small.r));
                assert!((all - few - beyond).abs() <= 1e-12 * all.max(half), "{all} {few} {beyond}");
            }
        }
    }
}

/// Residuals of a pose against their derivative by the tool twist `[w; dp]`.
#[test]
fn of_measurements() {
    let mut rng = ChaCha8Rng::seed_from_u64(13);
    for round in 0..200 {
        let vector = |rng: &mut ChaCha8Rng, size: f64| {
            Vector3::from(std::array::from_fn::<f64, 3, _>(|_| rng.random_range(-size..size)))
        };
        let measured = Se3 { r: so3::exp(&vector(&mut rng, 2.0)), p: vector(&mut rng, 1.0) };
        // From errors of a microradian to some that no calibration has.
        let size = [1e-6, 1e-3, 0.3][round % 3];
        let turn = so3::exp(&vector(&mut rng, size));
        let tool = Se3 { r: turn * measured.r, p: measured.p + vector(&mut rng, size) };
        let pose = Pose::new(measured, random_components(&mut rng), &random_covariance(&mut rng)).unwrap();
        let others = [Weights::Unit, Weights::SpatialTwist, Weights::Isotropic { angle: 1e-3, length: 1e-4 }];
        let pose: Arc<dyn Measurement> = match round % 6 {
            weights @ 0..3 => pose.reweighted(others[weights]),
            _ => Arc::new(pose),
        };
        let evaluate = |tool: &Se3| {
            let mut out = Evaluation::default();
            pose.evaluate(&View::of_tool(tool), &mut out);
            out.rows
        };
        let rows = evaluate(&tool);
        let largest = rows.iter().flat_map(|row| row.by_tool).fold(0.0_f64, |m, v| m.max(v.abs()));
        for component in 0..6 {
            let moved = |h: f64| {
                let mut step = Vector3::zeros();
                step[component % 3] = h;
                match component < 3 {
                    true => evaluate(&Se3 { r: so3::exp(&step) * tool.r, p: tool.p }),
                    false => evaluate(&Se3 { r: tool.r, p: tool.p + step }),
                }
            };
            let slope = |h: f64| -> Vec<f64> {
                moved(h).iter().zip(moved(-h)).map(|(a, b)| (a.r - b.r) / (2.0 * h)).collect()
            };
            let (coarse, fine) = (slope(2e-3), slope(1e-3));
            for (row, (coarse, fine)) in rows.iter().zip(coarse.iter().zip(fine)) {
                let difference = (4.0 * fine - coarse) / 3.0;
                let error = (row.by_tool[component] - difference).abs() / largest;
                assert!(error <= 1e-10, "round {round}, component {component}: {error:.1e}");
            }
        }
    }
}
