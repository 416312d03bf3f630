//! Messages about what people get wrong in files, and commands on data of several sets: one clear line each.

mod support;

use serde_json::{Value, json};
use std::path::Path;
use support::{done, file, gough, json, numbers, write};

fn arm() -> Value {
    json(&file("problems/serial-puma560.json"))
}

/// `gough identify` refuses the text with one line that holds these words.
#[track_caller]
fn refused(folder: &Path, text: &str, words: &[&str]) {
    let path = folder.join("bad.json");
    std::fs::write(&path, text).unwrap();
    let ran = gough("identify {0}", &[&path]);
    assert!(ran.status == 2 && ran.stdout.is_empty(), "{words:?}: {ran:?}");
    assert!(ran.stderr.trim_end().lines().count() == 1 && ran.stderr.len() < 500, "{ran:?}");
    for word in words {
        assert!(ran.stderr.contains(word), "{word}: {}", ran.stderr);
    }
}

#[test]
fn mistakes_in_files_are_named_with_their_place() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let mut problem = arm();
    problem["data"]["samples"][3]["pose"] = Value::Null;
    refused(at, &problem.to_string(), &["data.samples[3].pose (sample 4)", "it is null; leave the key out"]);
    let mut problem = arm();
    problem["data"]["samples"][3]["pose"] = json!([1, 2, 3]);
    refused(at, &problem.to_string(), &["data.samples[3].pose", "(sample 4)"]);
    let mut problem = arm();
    problem["units"]["length"] = json!("cm");
    refused(at, &problem.to_string(), &["units.length", "`cm`", "`m` or `mm`"]);
    // Tokens and numbers that JSON does not have.
    let mut problem = arm();
    problem["data"]["samples"][3]["actuators"][2] = json!("HERE");
    let text = problem.to_string();
    for token in ["NaN", "Infinity", "-Infinity"] {
        let place = ["data.samples[3].actuators[2]", "is no number of JSON (line 1 column", "finite number"];
        refused(at, &text.replace("\"HERE\"", token), &place);
        refused(at, &text.replace("\"HERE\"", token), &[token.trim_start_matches('-')]);
    }
    refused(
        at,
        &text.replace("\"HERE\"", "1e999"),
        &["data.samples[3].actuators[2]", "a number is too large"],
    );
    refused(
        at,
        &text.replace("\"HERE\"", "1e300"),
        &["(sample 4)", "1e300 rad is too large", "are the units right?"],
    );
    let mut problem = arm();
    let samples = problem["data"].as_object_mut().unwrap().remove("samples").unwrap();
    problem["data"]["file"] = json!("t.csv");
    for separator in [";", "\t", "|"] {
        let mut table = "q1,q2,q3,q4,q5,q6,x,y,z,rx,ry,rz\n".replace(',', separator);
        for sample in samples.as_array().unwrap() {
            let cells = [&sample["actuators"], &sample["pose"]["position"], &sample["pose"]["rotation"]];
            let cells: Vec<String> = cells.into_iter().flat_map(numbers).map(|v| v.to_string()).collect();
            table += &format!("{}\n", cells.join(separator));
        }
        std::fs::write(at.join("t.csv"), table).unwrap();
        let shown = format!("{:?}", separator.chars().next().unwrap());
        refused(at, &problem.to_string(), &["t.csv: line 1", &shown, "write commas"]);
    }
}

#[test]
fn predictions_cover_every_set() {
    let folder = tempfile::tempdir().unwrap();
    let mixed = file("problems/kinds/serial-puma560-mixed.json");
    let ran = done("predict {0} --actuators {0}", &[&mixed]);
    let found: Value = serde_json::from_str(&ran.stdout).unwrap();
    let sets = json(&mixed)["data"]["sets"].clone();
    let wanted: Vec<Value> = (sets.as_array().unwrap().iter())
        .flat_map(|set| set["samples"].as_array().unwrap().iter().map(|s| s["actuators"].clone()))
        .collect();
    let read: Vec<Value> =
        found["samples"].as_array().unwrap().iter().map(|s| s["actuators"].clone()).collect();
    assert!(wanted.len() == 66 && read == wanted, "{} {}", wanted.len(), read.len());
    let mut named = json(&mixed);
    named["data"]["sets"][1]["samples"][2]["actuators"] = json!([1, 2]);
    let ran = gough("predict {0} --actuators {1}", &[&mixed, &write(folder.path(), "short.json", &named)]);
    assert!(ran.status == 2 && ran.stderr.contains("set 2 sample 3"), "{ran:?}");
    let mut tabled = arm();
    tabled["data"] = json!({"sets": [{"file": "t.csv"}]});
    let ran = gough("predict {0} --actuators {1}", &[&mixed, &write(folder.path(), "table.json", &tabled)]);
    assert!(ran.status == 2 && ran.stderr.contains("the readings are in the table `t.csv`"), "{ran:?}");
}

#[test]
fn axes_that_are_nearly_parallel_are_warned_of() {
    let folder = tempfile::tempdir().unwrap();
    let mut arm = json(&file("problems/serial-ur10.json"));
    let joints = arm["mechanism"]["limbs"][0]["joints"].as_array_mut().unwrap();
    let parallel = |a: &Value, b: &Value| {
        let dot: f64 = numbers(&a["axis"]).iter().zip(numbers(&b["axis"])).map(|(a, b)| a * b).sum();
        dot.abs() > 1.0 - 1e-9
    };
    let k = (1..joints.len()).find(|k| parallel(&joints[k - 1], &joints[*k])).unwrap();
    let mut axis = numbers(&joints[k]["axis"]);
    let other = axis.iter().position(|v| v.abs() < 0.5).unwrap();
    axis[other] += 1e-3;
    joints[k]["axis"] = json!(axis);
    let path = write(folder.path(), "tilted.json", &arm);
    for given in ["", " --parallel 0.0005"] {
        let ran = gough(&format!("export {{0}} --format dh{given}"), &[&path]);
        assert!(ran.status == 0 && ran.stderr.contains("from parallel: their common normal lies"), "{ran:?}");
        assert!(ran.stderr.contains("with --parallel 1.01e-3 (it says what that costs)"), "{ran:?}");
    }
    let ran = gough("export {0} --format dh --parallel 0.00101", &[&path]);
    assert!(!ran.stderr.contains("warning") && ran.stderr.contains("are written as parallel"), "{ran:?}");
    let ran = gough("export {0} --format dh", &[&file("problems/serial-ur10.json")]);
    assert!(!ran.stderr.contains("warning"), "{ran:?}");
}
