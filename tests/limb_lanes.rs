//! Limbs are brought to their poses several postures at a time: whatever their number, each ends where it would alone.

mod support;

use gough::calibration::Calibration;
use gough::files::{DataPlaces, read_problem};
use gough::problem::{Form, Problem};
use support::golden;

/// Residuals and derivatives of every limb, posture after posture.
fn rows(calibration: &Calibration<'_>, x: &[f64]) -> Vec<(Vec<f64>, Vec<f64>)> {
    let limbs = calibration.limbs().expect("whole poses");
    let of_limb = |(limb, own): &(gough::calibration::limbwise::LimbProblem<'_>, std::ops::Range<usize>)| {
        let linear = limb.linearize(&x[own.clone()]).expect("close to nominal");
        let (m, n) = (linear.jac.nrows(), linear.jac.ncols());
        (linear.r, (0..m).flat_map(|i| (0..n).map(move |j| (i, j))).map(|at| linear.jac[at]).collect())
    };
    limbs.iter().map(of_limb).collect()
}

#[test]
fn postures_side_by_side_are_as_alone() {
    for name in ["hexapod-6ups", "tripod-3rps"] {
        let path = golden(name, "problem.json");
        let problem = read_problem(&path, &DataPlaces::from_environment(None)).expect("a golden case");
        let nominal = vec![0.0; problem.mechanism.component_count()];
        let all = Calibration::new(&problem.mechanism, &problem.data.samples, Form::Minimal, &nominal);
        let x: Vec<f64> = (0..all.params().len()).map(|i| 0.3 * (i as f64).sin()).collect();
        let together = rows(&all, &x);
        let postures = all.sample_count();
        for (first, count) in [(0, 1), (3, 2), (1, 3), (4, 4), (2, 7), (postures - 1, 1)] {
            let some = rows(&all.only(first..first + count), &x);
            for ((r, jac), (whole_r, whole_jac)) in some.iter().zip(&together) {
                let (per_r, per_jac) = (r.len() / count, jac.len() / count);
                assert!(per_r > 0);
                let near = |a: &[f64], b: &[f64], scale: f64| {
                    a.iter()
                        .zip(b)
                        .for_each(|(a, b)| assert!((a - b).abs() <= scale, "{name} {first}: {a} {b}"));
                };
                near(r, &whole_r[first * per_r..(first + count) * per_r], 1e-6);
                let largest = whole_jac.iter().fold(0.0f64, |most, v| most.max(v.abs()));
                near(jac, &whole_jac[first * per_jac..(first + count) * per_jac], 1e-9 * largest);
            }
        }
    }
}
