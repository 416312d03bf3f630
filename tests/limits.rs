//! Hard limits end to end: active ones with their prices in the result, and limits that are refused.

mod support;

use serde_json::{Value, json};
use std::path::Path;
use support::{file, gough, json, write};

/// Runs `conic-bounded` on a machine of problems/ and returns the result; it must have converged.
fn bounded(name: &str, settings: &str) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let (problem, out) = (file(&format!("problems/{name}.json")), folder.path().join("result.json"));
    let ran = gough(&format!("identify {{0}} --solver conic-bounded {settings} -o {{1}}"), &[&problem, &out]);
    assert!(ran.status == 0, "{name} {settings}: {ran:?}");
    let result = json(&out);
    assert_eq!(result["converged"], true);
    result
}

fn cost(result: &Value) -> f64 {
    result["trace"].as_array().unwrap().last().unwrap()["cost"].as_f64().unwrap()
}

#[test]
fn active_bounds_come_with_multipliers_and_a_small_kkt_residual() {
    for (name, limit) in
        [("serial-puma560", 0.5), ("serial-ur10", 0.8), ("tripod-3prs", 0.8), ("hexapod-6ups", 0.8)]
    {
        let result = bounded(name, &format!("--bounds {limit}"));
        let kkt = result["kkt"].as_f64().unwrap();
        assert!(kkt < 1e-6, "{name}: {kkt:e}");
        let active = result["active_bounds"].as_array().unwrap();
        assert!(!active.is_empty(), "{name}");
        for bound in active {
            assert!((bound["limit"].as_f64().unwrap().abs() - limit).abs() < 1e-12, "{name}: {bound}");
            assert!(bound["multiplier"].as_f64().unwrap() >= 0.0, "{name}: {bound}");
        }
        assert!(active.iter().any(|bound| bound["multiplier"].as_f64().unwrap() > 0.0), "{name}");
    }
}

/// The sum of the multipliers is what the cost gains per tolerance that all bounds give way.
#[test]
fn the_multipliers_are_the_slope_of_the_cost() {
    let at = |limit: f64| bounded("serial-ur10", &format!("--bounds {limit}"));
    let (low, middle, high) = (at(0.799), at(0.8), at(0.801));
    let active = middle["active_bounds"].as_array().unwrap();
    let price: f64 = active.iter().map(|bound| bound["multiplier"].as_f64().unwrap()).sum();
    let slope = (cost(&low) - cost(&high)) / 0.002;
    assert!((price - slope).abs() < 0.02 * slope, "{price} and {slope}");
}

#[track_caller]
fn refused(line: &str, paths: &[&Path], parts: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.json");
    let mut all = paths.to_vec();
    all.push(&out);
    let ran = gough(&format!("{line} -o {{{}}}", paths.len()), &all);
    assert!(ran.status == 2 && ran.stdout.is_empty() && !out.exists(), "{ran:?}");
    assert!(parts.iter().all(|part| ran.stderr.contains(part)), "{parts:?}: {}", ran.stderr);
}

#[test]
fn bounds_that_mean_nothing_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let spoiled = |key: &str, value: Value| {
        let mut problem = json(&file("problems/hexapod-6ups.json"));
        problem["mechanism"]["limbs"][2]["joints"][0][key] = value;
        problem
    };
    let reversed = write(folder.path(), "a.json", &spoiled("bounds", json!({"angle": -0.001})));
    refused("identify {0}", &[&reversed], &["limbs[2].joints[0].bounds.angle (limb3.base)", "negative"]);
    let mut held = spoiled("bounds", json!({"angle": 0.001}));
    held["mechanism"]["limbs"][2]["joints"][0]["tolerance"] = json!({"angle": 0, "length": 0});
    let held = write(folder.path(), "b.json", &held);
    refused("identify {0}", &[&held], &["limbs[2].joints[0].bounds (limb3.base)", "held"]);
}

#[test]
fn bounds_for_a_solver_that_has_none_or_twice_are_refused() {
    let problem = file("problems/serial-scara.json");
    refused(
        "identify {0} --bounds 3",
        &[&problem],
        &["'minimal' takes no bounds", "conic-bounded", "conic-huber"],
    );
    let twice = "identify {0} --solver conic-bounded --bounds 3 --set bounds=2";
    refused(twice, &[&problem], &["--bounds", "--set bounds"]);
    refused("identify {0} --solver conic-bounded --bounds=-1", &[&problem], &["bounds", "-1"]);
}
