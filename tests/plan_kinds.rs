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
    // Nor is any pair the mirror image of another.
    let pairs: Vec<Vec<&str>> = text.lines().skip(1).map(|line| line.split(',').collect()).collect();
    assert!(pairs.iter().all(|a| pairs.iter().all(|b| a[..6] != b[6..12] || a[6..12] != b[..6])), "{text}");
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
}

/// What the result knows of the instrument counts too, and what is no result of this machine is refused.
#[test]
fn a_result_stands_in_only_for_its_own_machine() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let problem = file("problems/kinds/hexapod-6ups-distance.json");
    // Distances do not see where {S} is: a warning says so.
    let ran = gough("identify {0} -o {1}", &[&problem, &at("result.json")]);
    assert_eq!(ran.status, 0, "{ran:?}");
    let line = "plan {0} --poses 6 --random 40 --starts 1 --at {1} -o {2}";
    let value = |result: &Path| {
        let told = done(line, &[&problem, result, &at("plan.csv")]).stdout;
        number_after(&told, "log det(I + J'J) = ")
    };
    let first = value(&at("result.json"));
    let mut result = read_json(&at("result.json"));
    let constants = result["instrument"].as_array_mut().unwrap();
    let x = constants.iter_mut().find(|constant| constant["name"] == "point wire x").unwrap();
    x["value"] = json!(x["value"].as_f64().unwrap() - 0.3);
    let elsewhere = value(&write(folder.path(), "elsewhere.json", &result));
    assert!((elsewhere - first).abs() > 1e-3, "{elsewhere} {first}");
    let refused = |problem: &str, result: &Path, words: &str| {
        let ran = gough(line, &[&file(problem), result, &at("none.csv")]);
        assert!(
            ran.status == 2 && ran.stderr.contains(words) && !at("none.csv").exists(),
            "{words}: {ran:?}"
        );
        assert_eq!(ran.stderr.trim_end().lines().count(), 1, "{ran:?}");
    };
    refused("problems/hexapod-6ups.json", &file("problems/hexapod-6ups.json"), "is a problem file");
    refused("problems/tripod-3rps.json", &at("result.json"), "other limbs");
    refused("problems/hexapod-6ucu.json", &at("result.json"), "limb1 of its machine has other joints");
    refused("problems/hexapod-squat.json", &at("result.json"), "limb1 has other dimensions");
    refused("problems/hexapod-640.json", &at("result.json"), "another reading at home");
}

/// Rows of a plan as samples without readings: they keep the two postures, target, point and gauge of the plan.
#[test]
fn the_rows_of_a_plan_put_back_have_its_value() {
    let folder = tempfile::tempdir().unwrap();
    let plan = folder.path().join("plan.csv");
    for name in ["hexapod-6ups-distance", "serial-puma560-position", "delta-3puu-separation"] {
        let problem = file(&format!("problems/kinds/{name}.json"));
        let line = "plan {0} --poses 12 --random 120 --starts 1 -o {1}";
        let value = number_after(&done(line, &[&problem, &plan]).stdout, "log det(I + J'J) = ");
        let mut drawn = read_json(&problem);
        let count = drawn["data"]["samples"][0]["actuators"].as_array().unwrap().len();
        let text = std::fs::read_to_string(&plan).unwrap();
        let heading: Vec<&str> = text.lines().next().unwrap().split(',').collect();
        let row = |line: &str| {
            let cells: Vec<&str> = line.split(',').collect();
            let readings =
                |cells: &[&str]| -> Vec<f64> { cells.iter().map(|v| v.parse().unwrap()).collect() };
            let mut sample = json!({"actuators": readings(&cells[..count])});
            if heading.get(count).is_some_and(|name| name.starts_with("second.")) {
                sample["second"] = json!(readings(&cells[count..2 * count]));
            }
            for (name, cell) in heading.iter().zip(&cells) {
                if ["target", "point", "gauge"].contains(name) {
                    sample[*name] = json!(cell);
                }
            }
            sample
        };
        drawn["data"]["samples"] = text.lines().skip(1).map(row).collect();
        let back = write(folder.path(), "back.json", &drawn);
        let found: Value = serde_json::from_str(&done("analyze {0} --json", &[&back]).stdout).unwrap();
        let values = found["singular_values"].as_array().unwrap();
        let by_analysis: f64 = values.iter().map(|s| s.as_f64().unwrap().powi(2).ln_1p()).sum();
        eprintln!("{name}: {value} by the plan, {by_analysis} by the analysis");
        // The plan prints four digits.
        assert!((value / by_analysis - 1.0).abs() < 1e-3, "{name}: {value} {by_analysis}");
        // Twice the weight is worth more, none is worth nothing, and less is refused.
        let weighed = |weight: f64| {
            let mut drawn = drawn.clone();
            for sample in drawn["data"]["samples"].as_array_mut().unwrap().iter_mut().skip(1) {
                sample["weight"] = json!(weight);
            }
            gough("analyze {0} --json", &[&write(folder.path(), "weighed.json", &drawn)])
        };
        let first = |weight: f64| -> f64 {
            let found: Value = serde_json::from_str(&weighed(weight).stdout).unwrap();
            found["singular_values"][0].as_f64().unwrap()
        };
        assert!(first(4.0) > 1.5 * values[0].as_f64().unwrap() && first(0.0) < values[0].as_f64().unwrap());
        let ran = weighed(-3.0);
        assert!(ran.status == 2 && ran.stderr.contains("-3 is no weight"), "{ran:?}");
    }
}

/// What is known before anything is measured is that of the tolerances, whatever the instrument could see.
#[test]
fn the_instrument_does_not_change_what_the_tolerances_say() {
    let folder = tempfile::tempdir().unwrap();
    let noise = json!({"angle": 2e-5, "length": 1e-5});
    let point = json!({"points": {"a": {"position": [0.5, 0.1, 0.2], "tolerance": 1e-3}}});
    let mut lines = Vec::new();
    for data in [
        json!({"kind": "pose", "noise": noise}),
        json!({"kind": "position", "noise": noise}),
        json!({"kind": "distance", "noise": noise, "instrument": point}),
        json!({"kind": "separation", "noise": noise}),
        json!({"kind": "passive-joint", "noise": noise, "joints": ["limb1.base.1", "limb1.base.2"]}),
    ] {
        let problem = with_data(folder.path(), "problem.json", &data);
        let line = "plan {0} --poses 4 --random 30 --starts 1 -o {1}";
        let told = done(line, &[&problem, &folder.path().join("plan.csv")]).stdout;
        lines.push(told.lines().find(|line| line.starts_with("without it")).unwrap().to_owned());
    }
    assert!(lines.iter().all(|line| *line == lines[0]), "{lines:?}");
}

/// With what was measured already, the expected accuracy is the one that a result of these data states.
#[test]
fn expected_accuracy_is_that_of_a_result() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let problem = file("problems/kinds/serial-puma560-position.json");
    let line = "plan {0} --poses 12 --random 100 --starts 1 --add-to-measured --workspace {0} -o {1}";
    let told = done(line, &[&problem, &at("plan.csv")]).stdout;
    let stated: Vec<f64> = told
        .lines()
        .find_map(|line| line.strip_prefix("without it"))
        .unwrap()
        .split_whitespace()
        .map(|v| v.parse().unwrap())
        .collect();
    done("identify {0} --solver map -o {1}", &[&problem, &at("result.json")]);
    let line = "predict {0} --actuators {1} --uncertainty -o {2}";
    done(line, &[&at("result.json"), &problem, &at("poses.json")]);
    let poses = read_json(&at("poses.json"));
    for (part, stated) in [("position", &stated[..2]), ("rotation", &stated[2..])] {
        let squares: Vec<f64> = poses["samples"]
            .as_array()
            .unwrap()
            .iter()
            .map(|s| support::numbers(&s["std"][part]).iter().map(|v| v * v).sum())
            .collect();
        let rms = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
        let most = squares.iter().copied().fold(0.0, f64::max).sqrt();
        eprintln!("{part}: rms {} and max {} planned, {rms} and {most} by the result", stated[0], stated[1]);
        assert!((stated[0] / rms - 1.0).abs() < 0.1 && (stated[1] / most - 1.0).abs() < 0.1);
    }
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
