//! Inputs whose postures were closed otherwise than they were measured, or that describe no machine.

mod support;

use serde_json::Value;
use std::path::Path;
use support::{Ran, apart, file, gough, json, name, numbers, poses, problems, units, write};

fn case(name: &str) -> std::path::PathBuf {
    file("tests/data/cases/closure").join(name)
}

/// Simulates and identifies; the summary and the result.
fn simulated(drawing: &Path, options: &str, folder: &Path) -> (Ran, Value) {
    let (problem, result) = (folder.join("p.json"), folder.join("r.json"));
    let ran = gough(&format!("simulate {{0}} {options} -o {{1}}"), &[drawing, &problem]);
    assert_eq!(ran.status, 0, "{ran:?}");
    let ran = gough("identify {0} -o {1}", &[&problem, &result]);
    assert_ne!(ran.status, 2, "{ran:?}");
    (ran, json(&result))
}

#[test]
fn ball_screws_that_turn_far_close_as_measured() {
    let folder = tempfile::tempdir().unwrap();
    let drawing = file("problems/hexapod-ballscrew.json");
    let (ran, result) = simulated(&drawing, "--poses 300 --seed 1", folder.path());
    assert_eq!(ran.status, 0, "{ran:?}");
    let after = &result["holdout"]["after"];
    assert!(after["position_rms"].as_f64().unwrap() < 0.002, "{after}");
    assert!(!ran.stderr.contains("stand out") && !ran.stderr.contains("took no part"), "{}", ran.stderr);
}

/// The drawing is the truth: residuals are rounding, and nothing is blamed.
fn assert_exact_converge(paths: &[std::path::PathBuf]) {
    for path in paths {
        let folder = tempfile::tempdir().unwrap();
        let options = "--poses 30 --holdout 5 --seed 4 --noise 0 --distance 0";
        let (ran, result) = simulated(path, options, folder.path());
        let what = name(path);
        assert_eq!(ran.status, 0, "{what}: {ran:?}");
        assert!(result["iterations"].as_u64().unwrap() <= 2, "{what}: {}", result["iterations"]);
        let before = result["fit"]["before"]["weighted_rms"].as_f64().unwrap();
        assert!(before < 1e-5, "{what}: {before}");
        for blamed in ["units", "home", "stand", "took no part", "assembly mode"] {
            assert!(!ran.stderr.contains(blamed), "{what}: {}", ran.stderr);
        }
    }
}

#[test]
fn exact_data_of_the_drawing_converge_at_once() {
    let some = ["serial-kuka-lbr", "tripod-3rps", "delta-3puu", "hexapod-6ups", "tricept"];
    let paths: Vec<_> = some.iter().map(|name| file("problems").join(format!("{name}.json"))).collect();
    assert_exact_converge(&paths);
}

#[test]
#[ignore = "campaign: all problems, half a minute"]
fn exact_data_of_every_drawing_converge_at_once() {
    assert_exact_converge(&problems());
}

/// Other identifiers than the default follow rounding for ever as well.
#[test]
fn exact_data_end_every_identifier() {
    let folder = tempfile::tempdir().unwrap();
    let (problem, drawing) = (folder.path().join("p.json"), file("problems/tripod-3rps.json"));
    let ran = gough(
        "simulate {0} --poses 20 --holdout 0 --seed 4 --noise 0 --distance 0 -o {1}",
        &[&drawing, &problem],
    );
    assert_eq!(ran.status, 0, "{ran:?}");
    for solver in
        ["map", "limbwise", "textbook", "complete", "argmin-lm", "argmin-lbfgs", "argmin-trust-region"]
    {
        let ran = gough(&format!("identify {{0}} --solver {solver}"), &[&problem]);
        assert_eq!(ran.status, 0, "{solver}: {ran:?}");
    }
}

/// Postures of a machine of revolute, prismatic and helical joints, predicted within what the result claims.
#[test]
fn predictions_err_no_more_than_they_say() {
    let folder = tempfile::tempdir().unwrap();
    let (result, predicted) = (folder.path().join("r.json"), folder.path().join("p.json"));
    let holdout = case("truth-holdout.json");
    let ran = gough("identify {0} -o {1}", &[&case("truth-train.json"), &result]);
    assert_eq!(ran.status, 0, "{ran:?}");
    let ran = gough("predict {0} --actuators {1} --uncertainty -o {2}", &[&result, &holdout, &predicted]);
    assert_eq!(ran.status, 0, "{ran:?}");
    let (truth, predicted) = (json(&holdout), json(&predicted));
    let units = units(&truth);
    let measured = poses(&truth["data"], units);
    let samples = predicted["samples"].as_array().unwrap();
    assert_eq!(samples.len(), measured.len());
    for (sample, (measured, predicted)) in samples.iter().zip(measured.iter().zip(poses(&predicted, units))) {
        let size = |key: &str| numbers(&sample["std"][key]).iter().map(|s| s * s).sum::<f64>().sqrt();
        let (angle, distance) = apart(measured, &predicted);
        assert!(
            angle < 4.0 * size("rotation") && distance < 4.0 * size("position"),
            "{angle} {distance} {sample}"
        );
    }
}

#[test]
fn a_home_that_is_nearly_singular_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let (drawing, out) = (case("hexaglide.json"), folder.path().join("p.json"));
    let said = "home is nearly singular";
    let ran = gough("check {0}", &[&drawing]);
    assert_eq!(ran.status, 1, "{ran:?}");
    assert!(ran.stdout.contains(said) && !ran.stdout.contains("nothing suspicious"), "{}", ran.stdout);
    let ran = gough("simulate {0} --poses 20 --seed 11 -o {1}", &[&drawing, &out]);
    assert!(ran.status == 2 && ran.stderr.contains(said) && !ran.stderr.contains("narrower"), "{ran:?}");
    let ran = gough("analyze {0} --poses 5", &[&drawing]);
    assert!(ran.stderr.contains(said), "{ran:?}");
    // One sample, at home.
    let mut value = json(&drawing);
    value["data"] = serde_json::json!({"noise": {"angle": 1e-5, "length": 1e-5}, "samples": [
        {"actuators": [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], "pose": {"position": [0.0, 0.0, 0.6], "rotation": [0.0, 0.0, 0.0]}}]});
    let ran = gough("identify {0}", &[&write(folder.path(), "home.json", &value)]);
    assert!(ran.stderr.contains(said), "{ran:?}");
}

/// A limb was copied into the machine of a result: twelve wrenches hold its platform.
#[test]
fn a_result_that_is_no_machine_is_refused_by_every_command() {
    let (problem, result) = (case("report-panic/p.json"), case("report-panic/q.json"));
    let lines = [
        "report {1} --problem {0}",
        "report {1}",
        "predict {1} --actuators {0}",
        "command {1} --poses {0}",
        "export {1} --format csv",
        "export {1} --format urdf",
        "export {1} --format dh",
        "plan {0} --poses 5 --at {1}",
    ];
    for line in lines {
        let ran = gough(line, &[&problem, &result]);
        assert_eq!(ran.status, 2, "{line}: {ran:?}");
        assert!(ran.stdout.is_empty() && ran.stderr.lines().count() == 1, "{line}: {ran:?}");
        assert!(ran.stderr.contains("q.json: mechanism: over-constrained"), "{line}: {}", ran.stderr);
    }
    for line in ["identify {1}", "check {1}", "analyze {1}", "compare {1} --seeds 1"] {
        let ran = gough(line, &[&problem, &result]);
        assert!(ran.status == 2 && ran.stderr.contains("q.json"), "{line}: {ran:?}");
    }
    let ran = gough("report {1} --problem {0}", &[&problem, &case("report-panic/r0.json")]);
    assert_eq!(ran.status, 0, "{ran:?}");
}

/// The same of a truth, and of the problem that a report is given.
#[test]
fn a_truth_that_is_no_machine_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut value = json(&file("problems/tripod-3rps.json"));
    let limb = value["truth"]["limbs"][0].clone();
    value["truth"]["limbs"].as_array_mut().unwrap().push(limb);
    value["truth"]["limbs"][3]["name"] = "copy".into();
    let problem = write(folder.path(), "p.json", &value);
    for line in ["identify {0}", "compare {0} --own-data --seeds 1", "analyze {0} --at truth"] {
        let ran = gough(line, &[&problem]);
        assert!(ran.status == 2 && ran.stderr.contains("truth"), "{line}: {ran:?}");
    }
}

/// The ball joint of one limb was turned over where one posture was measured: no path leads there. Eleven others were
/// measured in another assembly mode, and take part.
#[test]
fn a_posture_of_another_branch_is_named_and_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let (problem, result) = (case("mode-eclipse.json"), folder.path().join("r.json"));
    let ran = gough("identify {0} -o {1}", &[&problem, &result]);
    assert_eq!(ran.status, 0, "{ran:?}");
    let result = json(&result);
    let aside = result["set_aside"].as_array().unwrap();
    assert_eq!(aside.len(), 1, "{aside:?}");
    assert_eq!(aside[0]["sample"], "sample 10");
    let reason = aside[0]["reason"].as_str().unwrap();
    assert!(reason.contains("another assembly mode") && reason.contains("times the noise"), "{reason}");
    assert!(result["holdout"]["after"]["weighted_rms"].as_f64().unwrap() < 1.0, "{}", result["holdout"]);
    assert!(result["fit"]["after"]["weighted_rms"].as_f64().unwrap() < 1.1, "{}", result["fit"]);
    assert!(!ran.stderr.contains("stands out"), "{}", ran.stderr);
    // A report closes the postures where the identification did.
    let page = gough("report {0} --problem {1}", &[&folder.path().join("r.json"), &problem]);
    assert_eq!(page.status, 0, "{}", page.stderr);
}

/// Names of samples as `check` and `identify` list them.
fn names(numbers: &[usize]) -> String {
    numbers.iter().map(|n| format!("sample {n}")).collect::<Vec<_>>().join(", ")
}

/// A dozen of 60 postures in other assembly modes, eight mirrored below the carriages and four with home's sign of `det Jr`:
/// closed forms of the rods' lengths made them, no drawn joints.
#[test]
fn postures_of_other_modes_are_all_named() {
    let folder = tempfile::tempdir().unwrap();
    let (problem, result) = (case("modes-mixed.json"), folder.path().join("r.json"));
    let named = names(&[3, 8, 13, 18, 23, 28, 33, 38, 43, 48]);
    let ran = gough("identify {0} -o {1}", &[&problem, &result]);
    assert_eq!(ran.status, 0, "{ran:?}");
    let said = "12 of 60 postures were measured in another assembly mode than that of home";
    assert!(
        ran.stderr.contains(said) && ran.stderr.contains(&format!("{named} and 2 more")),
        "{}",
        ran.stderr
    );
    let stated = &json(&result)["measured_elsewhere"];
    assert_eq!((&stated["samples"], &stated["of"]), (&Value::from(12), &Value::from(60)));
    assert!(json(&result)["fit"]["after"]["weighted_rms"].as_f64().unwrap() < 1.1);
    let ran = gough("check {0}", &[&problem]);
    assert_eq!(ran.status, 1, "{ran:?}");
    assert!(ran.stdout.contains("suspicious: 12 of 60 samples were measured in another"), "{}", ran.stdout);
    assert!(ran.stdout.contains(&named) && !ran.stdout.contains("nothing suspicious"), "{}", ran.stdout);
    // What predicts from this result says so.
    let ran = gough("predict {0} --actuators {1}", &[&result, &problem]);
    assert!(ran.status == 0 && ran.stderr.contains("12 of 60 samples were measured in another"), "{ran:?}");
}

/// All postures hang below the base that home stands above: 1.8 m from where the path from home leads.
#[test]
fn a_home_in_another_mode_than_all_postures_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let (problem, result) = (case("modes-all.json"), folder.path().join("r.json"));
    let ran = gough("identify {0} -o {1}", &[&problem, &result]);
    assert_eq!(ran.status, 0, "{ran:?}");
    let (said, cure) = ("40 of 40 postures were measured in another", "draw the machine at home in the mode");
    assert!(ran.stderr.contains(said) && ran.stderr.contains(cure), "{}", ran.stderr);
    // The mirrored home: the platform 0.9 m below.
    let stands = ran.stderr.split("there the tool stands at [").nth(1).unwrap();
    let position: Vec<f64> =
        stands.split(']').next().unwrap().split(", ").map(|v| v.parse().unwrap()).collect();
    assert!(position[0].abs() < 0.005 && position[1].abs() < 0.005, "{position:?}");
    assert!((position[2] + 0.9).abs() < 0.005, "{position:?}");
    let ran = gough("check {0}", &[&problem]);
    assert!(ran.status == 1 && ran.stdout.contains("40 of 40 samples were measured in another"), "{ran:?}");
    // Nothing of the kind is said of postures of home's mode.
    let ran = gough("check {0}", &[&file("problems/hexapod-6ups.json")]);
    assert!(!ran.stdout.contains("assembly mode"), "{}", ran.stdout);
}
