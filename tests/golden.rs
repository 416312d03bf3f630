//! The golden cases (tests/data/golden, an independent implementation), through the command.

mod support;

use support::{GOLDEN, done, errors, golden, json, numbers, poses, units};

#[test]
fn truth_predicts_the_hold_out() {
    for case in GOLDEN {
        let (truth, holdout) = (golden(case, "truth.json"), golden(case, "holdout.json"));
        let ran = done("predict {0} --actuators {1}", &[&truth, &holdout]);
        let units = units(&json(&truth));
        let predicted = poses(&serde_json::from_str(&ran.stdout).unwrap(), units);
        let found = errors(&predicted, &poses(&json(&holdout), units));
        eprintln!("{case}: {:.1e} rad, {:.1e} m", found.rotation_max, found.position_max);
        assert!(found.rotation_max <= 1e-9 && found.position_max <= 1e-9, "{case}: {found:?}");
    }
}

#[test]
fn counts_and_singular_values() {
    for case in GOLDEN {
        let expect = json(&golden(case, "expect.json"));
        let ran = done("analyze {0} --json", &[&golden(case, "problem.json")]);
        let found: serde_json::Value = serde_json::from_str(&ran.stdout).unwrap();
        for (ours, theirs) in [
            ("structural", "structural"),
            ("first_order", "first_order"),
            ("practical", "practical_at_nominal"),
        ] {
            assert_eq!(found["counts"][ours], expect[theirs], "{case}: {ours}");
        }
        let (found, expect) = (numbers(&found["singular_values"]), numbers(&expect["singular_values"]));
        assert_eq!(found.len(), expect.len(), "{case}");
        assert!(found.is_sorted_by(|a, b| a >= b), "{case}");
        let seen: Vec<_> = expect.iter().zip(&found).filter(|(e, _)| **e > 1e-6 * expect[0]).collect();
        let worst = seen.iter().map(|(e, f)| (*e - *f).abs() / *e).fold(0.0, f64::max);
        eprintln!("{case}: {} singular values to {worst:.1e}", seen.len());
        assert!(worst <= 1e-6, "{case}: {worst:.1e}");
    }
}

/// Noise is stated per axis, so that the root mean square of the error's *length* would be sqrt(3) times it for an
/// unbiased estimate of nothing but the pose; held against twice the noise it is the stricter of two readings.
#[test]
fn identified_machines_predict_the_hold_out_to_twice_the_noise() {
    let folder = tempfile::tempdir().unwrap();
    for case in GOLDEN {
        let (problem, holdout) = (golden(case, "problem.json"), golden(case, "holdout.json"));
        let result = folder.path().join(format!("{case}.json"));
        done("identify {0} -o {1}", &[&problem, &result]);
        let ran = done("predict {0} --actuators {1}", &[&result, &holdout]);
        let stated = json(&problem);
        let (length, angle) = units(&stated);
        let predicted = poses(&serde_json::from_str(&ran.stdout).unwrap(), (length, angle));
        let found = errors(&predicted, &poses(&json(&holdout), (length, angle)));
        let noise = |key: &str| stated["data"]["noise"][key].as_f64().unwrap();
        let (rotation, position) =
            (found.rotation_rms / (noise("angle") * angle), found.position_rms / (noise("length") * length));
        let result = json(&result);
        let iterations = result["iterations"].as_u64().unwrap();
        eprintln!("{case}: {rotation:.2}, {position:.2} of the noise in {iterations} iterations");
        assert!(rotation <= 2.0 && position <= 2.0, "{case}: {found:?}");
        assert!(iterations <= 10, "{case}: {iterations}");
        assert_eq!(result["converged"], true, "{case}");
        assert_eq!(result["trace"].as_array().unwrap().len() as u64, iterations, "{case}");
    }
}
