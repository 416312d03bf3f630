//! What a problem evaluates to depends on where it is evaluated and on nothing that was asked before
//! (cases/library/pure.rs).

use gough::calibration::Calibration;
use gough::files::{DataPlaces, read_problem};
use gough::problem::{Form, Problem};

/// Residuals and the triangular factor at `x`, as bits.
fn bits(problem: &dyn Problem, x: &[f64]) -> Vec<u64> {
    let r = problem.residual(x).unwrap();
    let jac = problem.compress(x).unwrap().jac;
    let entries = (0..jac.ncols()).flat_map(|j| (0..jac.nrows()).map(move |i| (i, j)));
    let jac: Vec<f64> = entries.map(|(i, j)| jac[(i, j)]).collect();
    r.iter().chain(&jac).map(|value| value.to_bits()).collect()
}

/// Evaluates far and near, the far ones being refused or not, and comes back.
fn assert_pure(problem: &dyn Problem, name: &str) {
    let n = problem.params().len();
    let x = vec![0.3; n];
    let first = bits(problem, &x);
    for k in 1..6 {
        let there: Vec<f64> = (0..n).map(|i| ((i * 7 + k) as f64).sin() * k as f64).collect();
        let _ = problem.residual(&there);
        let _ = problem.gradient(&there);
        assert!(bits(problem, &x) == first, "{name} after detour {k}");
    }
}

#[test]
fn problems_evaluate_alike_whatever_was_asked_before() {
    let places = DataPlaces { data_dir: None, shared: "no such folder".into() };
    for name in ["hexapod-6ups", "tripod-3prs", "serial-puma560", "kinds/hexapod-6ups-distance"] {
        let file = read_problem(format!("problems/{name}.json").as_ref(), &places).unwrap();
        let nominal = vec![0.0; file.mechanism.component_count()];
        let whole = Calibration::new(&file.mechanism, &file.data.samples, Form::Minimal, &nominal);
        assert_pure(&whole, name);
        let parts = whole.parts();
        assert_eq!(parts.is_some(), !name.contains("distance"), "{name}");
        for part in parts.iter().flatten() {
            assert_pure(part.problem.as_ref(), name);
        }
    }
}
