//! Plans for every kind of measurement, and for the machine of a result.

mod support;

use serde_json::{Value, json};
use std::path::Path;
use support::{done, file, gough, json as read_json, write};

/// The hexapod with other data.
fn with_data(folder: &Path, name: &str, data: &Value) -> std::path::PathBuf {
    let mut problem = read_json(&file("problems/hexapod-6ups.json"));
    problem.as_object_mut().unwrap().remove("truth");
    problem["data"] = data.clone();
    write(folder, name, &problem)
}

fn number_after(text: &str, words: &str) -> f64 {
    let rest = text.split(words).nth(1).unwrap_or_else(|| panic!("{words}: {text}"));
    rest.split([';', ' ', '\n']).next().unwrap().parse().unwrap()
}

/// For kinds with one thing to measure the value of the plan is `log det(I + J'J)` by the singular values that `analyze`
/// finds at the planned postures.
#[test]
fn the_value_of_a_plan_is_that_of_an_analysis_of_its_postures() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let noise = json!({"angle": 2e-5, "length": 1e-5});
    let joints = ["limb1.base.1", "limb1.base.2", "limb2.base.1"];
    for data in [
        json!({"kind": "distance", "noise": noise, "instrument": {"points": {"a": {"position": [0.5, 0.1, 0.2]}}}}),
        json!({"kind": "plane", "noise": noise,
            "instrument": {"planes": {"bed": {"normal": [0.1, -0.05, 1], "offset": 0.9}}}}),
        json!({"kind": "passive-joint", "noise": noise, "joints": joints}),
        json!({"kind": "position", "noise": noise}),
    ] {
        let kind = data["kind"].as_str().unwrap().to_owned();
        let problem = with_data(folder.path(), "problem.json", &data);
        // Not every posture leads to the plane: a warning says how many do.
        let line = "plan {0} --poses 12 --random 150 --starts 2 -o {1}";
        let ran = gough(line, &[&problem, &at("plan.csv")]);
        assert_eq!(ran.status, 0, "{ran:?}");
        let told = ran.stdout;
        let value = number_after(&told, "log det(I + J'J) = ");
        let text = std::fs::read_to_string(at("plan.csv")).unwrap();
        let mut lines = text.lines();
        let heading: Vec<&str> = lines.next().unwrap().split(',').collect();
        let rows: Vec<Value> = lines
            .map(|line| {
                let numbers: Vec<f64> = line.split(',').take(6).map(|v| v.parse().unwrap()).collect();
                json!({"actuators": numbers})
            })
            .collect();
        assert_eq!(rows.len(), 12);
        assert!(heading.len() == if kind == "distance" || kind == "plane" { 7 } else { 6 }, "{heading:?}");
        let mut planned = data.clone();
        planned["samples"] = json!(rows);
        let planned = with_data(folder.path(), "planned.json", &planned);
        let found: Value = serde_json::from_str(&done("analyze {0} --json", &[&planned]).stdout).unwrap();
        let values = found["singular_values"].as_array().unwrap();
        let by_analysis: f64 = values.iter().map(|s| s.as_f64().unwrap().powi(2).ln_1p()).sum();
        eprintln!("{kind}: {value} by the plan, {by_analysis} by the analysis");
        assert!((value / by_analysis - 1.0).abs() < 1e-3, "{kind}: {value} {by_analysis}");
    }
}

#[test]
fn postures_that_are_compared_are_planned_in_pairs() {
    let folder = tempfile::tempdir().unwrap();
    let plan = folder.path().join("plan.csv");
    let data = json!({"kind": "separation", "noise": {"length": 1e-5},
        "instrument": {"targets": {"t1": {"offset": [0.1, 0, 0]}, "t2": {"offset": [0, 0.1, 0]}}}});
    let problem = with_data(folder.path(), "problem.json", &data);
    done("plan {0} --poses 10 --random 100 --starts 2 -o {1}", &[&problem, &plan]);
    let text = std::fs::read_to_string(&plan).unwrap();
    let mut lines = text.lines();
    let heading: Vec<&str> = lines.next().unwrap().split(',').collect();
    assert!(
        heading.len() == 13 && heading[6].starts_with("second.") && heading[12] == "target",
        "{heading:?}"
    );
    for line in lines {
        let cells: Vec<&str> = line.split(',').collect();
        assert!(cells[..6] != cells[6..12] && ["t1", "t2"].contains(&cells[12]), "{line}");
    }
    // One posture alone has no other to be compared with; random ones are at least two.
    let mut alone = data.clone();
    alone["samples"] = json!([{"actuators": [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]}]);
    let ran = gough("analyze {0}", &[&with_data(folder.path(), "alone.json", &alone)]);
    assert!(ran.status == 2 && ran.stderr.contains("compares two postures"), "{ran:?}");
    let ran = gough("analyze {0} --poses 1 --json", &[&problem]);
    assert_eq!(ran.status, 0, "{ran:?}");
    let found: Value = serde_json::from_str(&ran.stdout).unwrap();
    assert!(found["singular_values"][0].as_f64().unwrap() > 1.0, "{}", found["singular_values"][0]);
}

/// What is planned on the machine of a result is reached by that machine, away from its singularities and in its ranges.
#[test]
fn a_plan_is_made_for_the_machine_of_a_result() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    // In millimetres and degrees.
    let problem = file("problems/hexapod-640.json");
    done("identify {0} -o {1}", &[&problem, &at("result.json")]);
    let line = "plan {0} --poses 10 --random 100 --starts 1 -o {1}";
    let drawn = done(line, &[&problem, &at("drawn.csv")]).stdout;
    let line = format!("{line} --at {{2}}");
    let real = done(&line, &[&problem, &at("real.csv"), &at("result.json")]).stdout;
    let value = |text: &str| number_after(text, "log det(I + J'J) = ");
    // The real machine's axes no longer meet: little is the same, most is alike.
    assert!(
        value(&real) != value(&drawn) && (value(&real) / value(&drawn) - 1.0).abs() < 0.2,
        "{real} {drawn}"
    );
    done("predict {0} --actuators {1}", &[&at("result.json"), &at("real.csv")]);
    let ran = gough(&line, &[&problem, &at("real.csv"), &file("problems/tripod-3rps.json")]);
    assert!(ran.status == 2 && ran.stderr.contains("other limbs or joints"), "{ran:?}");
}

#[test]
fn what_is_not_known_of_the_instrument_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let noise = json!({"angle": 2e-5, "length": 1e-5});
    let point = json!({"points": {"a": {"position": [0.5, 0.1, 0.2], "tolerance": "free"}}});
    for (data, words) in [
        (json!({"kind": "distance", "noise": noise, "instrument": point}), "is free"),
        (json!({"kind": "passive-joint", "noise": noise}), "data.joints"),
        (
            json!({"sets": [{"kind": "pose", "noise": noise}, {"kind": "passive-joint", "noise": noise}]}),
            "one kind",
        ),
        (json!({"kind": "pose"}), "data.noise"),
    ] {
        let ran = gough("plan {0} --poses 4 --random 20", &[&with_data(folder.path(), "p.json", &data)]);
        assert!(ran.status == 2 && ran.stderr.contains(words) && ran.stdout.is_empty(), "{words}: {ran:?}");
        assert_eq!(ran.stderr.trim_end().lines().count(), 1, "{ran:?}");
    }
}
