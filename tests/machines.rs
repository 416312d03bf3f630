//! The identifiers on machines with known truth: they agree with each other, and hold limits.

use gough::calibration::Calibration;
use gough::files::problem::parse_problem;
use gough::files::{DataPlaces, ProblemFile};
use gough::identify::score::score;
use gough::identify::{Identification, identify};
use gough::problem::Problem;
use gough::solve::{Identifier, Stop, registry};
use serde_json::Value;
use std::path::{Path, PathBuf};

const CASES: [&str; 4] = ["serial-6r", "tripod-3rps", "hexapod-6ups", "hexapod-6pus"];

fn golden(case: &str, file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/golden").join(case).join(file)
}

fn value(case: &str, file: &str) -> Value {
    serde_json::from_str(&std::fs::read_to_string(golden(case, file)).expect("readable")).expect("JSON")
}

fn problem(value: &Value) -> ProblemFile {
    let places = DataPlaces { data_dir: None, shared: "no such folder".into() };
    parse_problem(Path::new("machine.json"), value.to_string().as_bytes(), &places).expect("a problem")
}

/// The case, with its hold-out as a data set of the same machine.
fn case(name: &str) -> (ProblemFile, ProblemFile) {
    let training = value(name, "problem.json");
    let mut holdout = training.clone();
    holdout["data"] = value(name, "holdout.json");
    (problem(&training), problem(&holdout))
}

/// Position error on fresh poses, m.
fn fresh(name: &str, found: &Identification) -> f64 {
    let holdout = case(name).1;
    let fit = score(&found.start, &found.geometry, &holdout.data.samples).expect("poses that close");
    fit.position.expect("positions").rms
}

fn run(name: &str, identifier: &dyn Identifier) -> Identification {
    let training = case(name).0;
    identify(&training.mechanism, &training.data.samples, identifier, &Stop::default()).expect("identified")
}

/// Standard deviation of a measured coordinate in the golden cases, m.
const NOISE: f64 = 10e-6;

#[test]
fn least_squares_identifiers_agree_on_machines() {
    for name in CASES {
        let minimal = run(name, registry::find("minimal").expect("registered").as_ref());
        for other in ["argmin-lm", "argmin-trust-region", "conic-bounded"] {
            let found = run(name, registry::find(other).expect("registered").as_ref());
            assert!(found.report.outcome.converged(), "{name} {other}: {}", found.report.outcome);
            let apart = (fresh(name, &found) - fresh(name, &minimal)).abs();
            assert!(apart < 0.05 * NOISE, "{name} {other}: {apart:e} m");
            assert!((found.report.cost / minimal.report.cost - 1.0).abs() < 1e-3, "{name} {other}");
        }
    }
}

#[test]
fn ridge_equals_map_on_machines() {
    for name in CASES {
        let map = run(name, registry::find("map").expect("registered").as_ref());
        let ridge = run(name, registry::find("conic-ridge").expect("registered").as_ref());
        assert!(map.report.outcome.converged() && ridge.report.outcome.converged(), "{name}");
        assert!((ridge.report.cost / map.report.cost - 1.0).abs() < 1e-6, "{name}");
        let (a, b) = (fresh(name, &ridge), fresh(name, &map));
        assert!((a - b).abs() < 1e-3 * NOISE, "{name}: {a:e} and {b:e}");
    }
}

#[test]
fn bounds_on_a_machine_hold_and_are_reported() {
    let mut identifier = registry::find("conic-bounded").expect("registered");
    identifier.set("bounds", "1").expect("a setting it has");
    let found = run("tripod-3rps", identifier.as_ref());
    assert!(found.report.outcome.converged(), "{}", found.report.outcome);
    assert!(found.report.x.iter().all(|x| x.abs() <= 1.0));
    assert!(!found.report.active.is_empty());
    assert!(found.report.kkt.is_some_and(|kkt| kkt < 1e-6), "{:?}", found.report.kkt);
}

#[test]
fn far_starts_come_back() {
    for name in CASES {
        let training = case(name).0;
        let at = vec![0.0; training.mechanism.component_count()];
        for solver in ["argmin-lm", "map"] {
            let identifier = registry::find(solver).expect("registered");
            let problem =
                Calibration::new(&training.mechanism, &training.data.samples, identifier.form(), &at);
            let n = problem.params().len();
            let near = identifier.identify(&problem, &vec![0.0; n], &Stop::default());
            let start: Vec<f64> =
                (0..n).map(|i| 5.0 * f64::from(i as u32 * 37 % 11).mul_add(0.2, -1.0)).collect();
            let far = identifier.identify(&problem, &start, &Stop::default());
            assert!(far.outcome.converged(), "{name} {solver}: {}", far.outcome);
            assert!((far.cost / near.cost - 1.0).abs() < 1e-2, "{name} {solver}: {} {}", far.cost, near.cost);
        }
    }
}
