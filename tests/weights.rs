//! Sample weights: a weight of 4 is the same sample four times, 0 is not there, in estimate, covariance and scores.

mod support;

use serde_json::{Value, json};
use std::path::Path;
use support::{done, file, gough, json, numbers, write};

/// Simulated readings of a kind, so many of them.
fn simulated(folder: &Path, machine: &str, data: &Value, count: usize) -> Value {
    let mut value = json(&file(&format!("problems/{machine}.json")));
    for key in ["truth", "benchmark"] {
        value.as_object_mut().unwrap().remove(key);
    }
    value["data"] = data.clone();
    let base = write(folder, "base.json", &value);
    let out = folder.join("simulated.json");
    done(&format!("simulate {{0}} --poses {count} --seed 5 --holdout 8 -o {{1}}"), &[&base, &out]);
    json(&out)
}

fn identified(folder: &Path, problem: &Value) -> (Value, String) {
    let (path, out) = (write(folder, "weighted.json", problem), folder.join("result.json"));
    let ran = gough("identify {0} -o {1}", &[&path, &out]);
    assert!(ran.status == 0, "{ran:?}");
    (json(&out), ran.stdout)
}

/// Every number of two JSON values agrees to `relative` of the largest number of its list, or of itself.
#[track_caller]
fn agree(a: &Value, b: &Value, relative: f64, what: &str) {
    let flat = |v: &Value| -> Vec<f64> {
        fn push(v: &Value, to: &mut Vec<f64>) {
            match v {
                Value::Array(list) => list.iter().for_each(|v| push(v, to)),
                Value::Object(map) => map.values().for_each(|v| push(v, to)),
                Value::Number(number) => to.push(number.as_f64().unwrap()),
                _ => {}
            }
        }
        let mut all = Vec::new();
        push(v, &mut all);
        all
    };
    let (a, b) = (flat(a), flat(b));
    assert!(a.len() == b.len() && !a.is_empty(), "{what}: {} and {} numbers", a.len(), b.len());
    let largest = a.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    for (a, b) in a.iter().zip(&b) {
        assert!((a - b).abs() <= relative * largest, "{what}: {a:e} {b:e}");
    }
}

/// Variances of all links, from the root that a result states.
fn variances(result: &Value) -> Value {
    json!(result["uncertainty"]["root"].as_array().unwrap().iter().map(numbers).fold(
        Vec::new(),
        |mut sum: Vec<f64>, column| {
            sum.resize(column.len(), 0.0);
            sum.iter_mut().zip(column).for_each(|(sum, v)| *sum += v * v);
            sum
        }
    ))
}

#[test]
fn a_weight_of_four_is_four_equal_samples() {
    let folder = tempfile::tempdir().unwrap();
    let noise = json!({"angle": 2e-5, "length": 1e-5});
    let points = json!({"points": {
        "a": {"position": [0.9, 0.1, 0.2], "tolerance": 0.001},
        "b": {"position": [-0.3, 0.8, 0.1]}, "c": {"position": [0.4, -0.9, 1.2]}}});
    let cases = [
        ("serial-puma560", json!({"kind": "pose", "noise": noise}), 20),
        ("serial-puma560", json!({"kind": "position", "noise": noise}), 30),
        ("serial-puma560", json!({"kind": "distance", "noise": noise, "instrument": points}), 60),
        ("serial-puma560", json!({"kind": "separation", "noise": noise}), 60),
        (
            "serial-puma560",
            json!({"kind": "plane", "noise": noise, "instrument": {"planes": {
                "bed": {"normal": [0, 0, 1], "offset": 0.6, "tolerance": {"angle": 0.002, "length": 0.001}}}}}),
            60,
        ),
        ("tripod-3rps", json!({"kind": "passive-joint", "noise": noise}), 20),
        ("tripod-3rps", json!({"kind": "pose", "noise": noise}), 20),
    ];
    for (machine, data, count) in cases {
        let what = format!("{machine} {}", data["kind"]);
        let mut problem = simulated(folder.path(), machine, &data, count);
        // Equal samples share their error, which is estimated where nothing is stated; here they stand for independent ones.
        problem["data"]["posture_noise"] = json!({"angle": 0, "length": 0});
        let (mut weighted, mut copied) = (problem.clone(), problem.clone());
        let samples = problem["data"]["samples"].as_array().unwrap();
        let mut copies = Vec::new();
        for (k, sample) in samples.iter().enumerate() {
            let heavy = k % 3 == 0;
            weighted["data"]["samples"][k]["weight"] = json!(if heavy { 4.0 } else { 1.0 });
            copies.extend(vec![sample.clone(); if heavy { 4 } else { 1 }]);
        }
        copied["data"]["samples"] = json!(copies);
        let hold = problem["data"]["holdout"]["samples"].as_array().unwrap().clone();
        weighted["data"]["holdout"]["samples"][2]["weight"] = json!(4);
        copied["data"]["holdout"]["samples"] = json!([hold.clone(), vec![hold[2].clone(); 3]].concat());
        let (plain, _) = identified(folder.path(), &problem);
        let (a, _) = identified(folder.path(), &weighted);
        let (b, _) = identified(folder.path(), &copied);
        agree(&a["mechanism"]["limbs"], &b["mechanism"]["limbs"], 1e-8, &what);
        agree(&variances(&a), &variances(&b), 1e-5, &what);
        agree(&a["singular_values"], &b["singular_values"], 1e-7, &what);
        agree(&a["chi_square"]["value"], &b["chi_square"]["value"], 1e-6, &what);
        for set in ["fit", "holdout"] {
            for (key, value) in a[set]["after"].as_object().unwrap() {
                if key.ends_with("_rms") && key != "weighted_rms" && !value.is_null() {
                    agree(value, &b[set]["after"][key], 1e-4, &format!("{what} {set} {key}"));
                }
            }
        }
        // The weights do something; degrees of freedom count a weighted sample once.
        let differs = numbers(&plain["singular_values"])[0] / numbers(&a["singular_values"])[0];
        assert!(differs < 0.95, "{what}: {differs}");
        let freedom = |result: &Value| result["chi_square"]["degrees_of_freedom"].as_f64().unwrap();
        let (one, four) = (freedom(&a), freedom(&b));
        assert!((one - freedom(&plain)).abs() < 0.05 * one && four > 1.5 * one, "{what}: {one} {four}");
    }
}

#[test]
fn a_weight_of_zero_is_listed_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let noise = json!({"angle": 2e-5, "length": 1e-5});
    let problem = simulated(folder.path(), "serial-puma560", &json!({"kind": "pose", "noise": noise}), 20);
    let (mut zero, mut without) = (problem.clone(), problem.clone());
    zero["data"]["samples"][3]["weight"] = json!(0);
    zero["data"]["samples"][3]["pose"]["position"][0] = json!(7);
    without["data"]["samples"].as_array_mut().unwrap().remove(3);
    let (a, summary) = identified(folder.path(), &zero);
    let (b, _) = identified(folder.path(), &without);
    for key in ["mechanism", "fit", "holdout", "chi_square", "singular_values", "counts"] {
        agree(&a[key], &b[key], 1e-12, key);
    }
    assert!(summary.contains("1 sample of weight 0, not used:\n  sample 4: off by "), "{summary}");
    let error = a["unused"][0]["errors"]["position_rms"].as_f64().unwrap();
    assert!(a["unused"][0]["sample"] == "sample 4" && error > 5.0, "{}", a["unused"]);
    assert!(b["unused"].is_null());
}

#[test]
fn tables_have_weights_too_and_bad_ones_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let noise = json!({"angle": 2e-5, "length": 1e-5});
    let mut problem =
        simulated(folder.path(), "serial-puma560", &json!({"kind": "pose", "noise": noise}), 20);
    let mut table = "q1,q2,q3,q4,q5,q6,x,y,z,rx,ry,rz,weight\n".to_owned();
    for (k, sample) in problem["data"]["samples"].as_array_mut().unwrap().iter_mut().enumerate() {
        let weight = if k == 5 { String::new() } else { format!("{}", 0.5 * k as f64) };
        if k != 5 {
            sample["weight"] = json!(0.5 * k as f64);
        }
        let cells = [&sample["actuators"], &sample["pose"]["position"], &sample["pose"]["rotation"]];
        let cells: Vec<String> = cells.into_iter().flat_map(numbers).map(|v| format!("{v:?}")).collect();
        table += &format!("{},{weight}\n", cells.join(","));
    }
    std::fs::write(folder.path().join("t.csv"), &table).unwrap();
    let mut tabled = problem.clone();
    tabled["data"].as_object_mut().unwrap().remove("samples");
    tabled["data"]["file"] = json!("t.csv");
    let (a, _) = identified(folder.path(), &problem);
    let (b, _) = identified(folder.path(), &tabled);
    agree(&a["mechanism"], &b["mechanism"], 0.0, "table");
    assert_eq!(b["unused"][0]["sample"], "t.csv line 2");
    // A table of foreign names keeps them.
    let (path, out) = (write(folder.path(), "p.json", &problem), folder.path().join("imported.json"));
    std::fs::write(folder.path().join("u.csv"), table.replace("weight", "trust")).unwrap();
    let ran = gough(
        "import csv {0} --problem {1} --map weight=trust -o {2}",
        &[&folder.path().join("u.csv"), &path, &out],
    );
    assert!(ran.status == 0, "{ran:?}");
    assert_eq!(json(&out)["data"]["samples"][7]["weight"], json!(3.5));
    for (weight, shown) in [(json!(-1), "-1 is no weight"), (json!(1e-300), "1e-300 is no weight")] {
        let mut bad = problem.clone();
        bad["data"]["samples"][6]["weight"] = weight;
        let ran = gough("identify {0}", &[&write(folder.path(), "bad.json", &bad)]);
        assert!(ran.status == 2 && ran.stderr.contains(shown), "{ran:?}");
        assert!(ran.stderr.contains("data.samples[6].weight (sample 7)"), "{ran:?}");
    }
    for bad in ["-2", "NaN", "heavy"] {
        let spoiled = table.replacen(",0.5\n", &format!(",{bad}\n"), 1);
        std::fs::write(folder.path().join("t.csv"), spoiled).unwrap();
        let ran = gough("identify {0}", &[&write(folder.path(), "bad.json", &tabled)]);
        assert!(ran.status == 2 && ran.stderr.contains("line 3"), "{bad}: {ran:?}");
        assert_eq!(ran.stderr.trim().lines().count(), 1, "{ran:?}");
    }
}
