//! `gough compare` on problems that measure something else than poses, in sets, or with a recipe that does not fit.

mod support;

use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use support::{done, file, gough, json, write};

/// A problem with simulated readings of this kind, under a name of its own.
fn simulated(folder: &Path, kind: &str, source: &Path, machine: &str) -> PathBuf {
    let path = folder.join(format!("{machine}-{kind}.json"));
    done(&format!("simulate {{0}} --poses 40 --seed 3 --kind {kind} -o {{1}}"), &[source, &path]);
    let mut problem = json(&path);
    problem["name"] = format!("{machine}-{kind}").into();
    write(folder, &format!("{machine}-{kind}.json"), &problem)
}

fn lines(path: &Path) -> Vec<Value> {
    let text = std::fs::read_to_string(path).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[test]
fn every_kind_of_measurement_is_compared_and_shown() {
    let folder = tempfile::tempdir().unwrap();
    let mut paths = Vec::new();
    for kind in ["position", "separation", "passive-joint"] {
        paths.push(simulated(folder.path(), kind, &file("problems/tripod-3rps.json"), "tripod"));
    }
    // Distance and plane need something to measure from.
    let mut drawn = json(&file("problems/serial-puma560.json"));
    let data = drawn["data"].as_object_mut().unwrap();
    data.retain(|key, _| key == "noise");
    data.insert(
        "instrument".into(),
        json!({ "points": { "bar": { "position": [0.3, 0.1, 0.0] } },
                "planes": { "table": { "normal": [0, 0, 1], "offset": 0.0 } } }),
    );
    let drawn = write(folder.path(), "drawn.json", &drawn);
    for kind in ["distance", "plane"] {
        paths.push(simulated(folder.path(), kind, &drawn, "puma"));
    }
    for path in &paths {
        let name = support::name(path);
        let out = folder.path().join(format!("{name}-out"));
        let ran = gough(
            "compare {0} --solvers minimal,conic-ridge --seeds 2 --noise 1,0.1 -o {1}",
            &[path.as_path(), &out],
        );
        assert_eq!(ran.status, 0, "{name}: {}", ran.stderr);
        let placed = name.ends_with("position");
        for line in lines(&out.join("runs.jsonl")) {
            let score = &line["score"];
            assert_eq!(line["verified"]["success"], true, "{name}: {}", line["verified"]);
            assert!(score["ratio"].as_f64().unwrap() < 3.0 && score["after"]["in_noise"].is_number());
            assert_eq!(score["after"]["position"].is_number(), placed, "{name}");
        }
        // What was not measured is a dash, not a failure; the figure of errors has its lines all the same.
        let row = ran.stdout.lines().find(|line| line.starts_with(&format!("| {name} | 1.0 "))).unwrap();
        assert!(!row.contains("limit") && row.contains("| - |") != placed, "{row}");
        let figure = std::fs::read_to_string(out.join(format!("error-noise-{name}.svg"))).unwrap();
        assert!(figure.contains(if placed { "position error" } else { "hold-out error / noise" }), "{name}");
        assert!(figure.contains("Cramer-Rao bound"), "{name}");
    }
}

/// A set of poses and a set of separations in one problem; and gross errors, which only poses take.
#[test]
fn sets_are_compared_and_gross_errors_of_readings_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let separation = simulated(folder.path(), "separation", &file("problems/serial-puma560.json"), "puma");
    let (mut both, poses) = (json(&separation), json(&file("problems/serial-puma560.json")));
    both["name"] = "both".into();
    both["data"] = json!({ "sets": [poses["data"], both["data"]] });
    let data = both["data"]["sets"].as_array_mut().unwrap();
    data.iter_mut().for_each(|set| {
        set.as_object_mut().unwrap().retain(|key, _| key != "holdout" && key != "origin");
    });
    let path = write(folder.path(), "both.json", &both);
    let out = folder.path().join("out");
    let ran = gough("compare {0} --solvers minimal,map --seeds 1 -o {1}", &[path.as_path(), &out]);
    assert_eq!(ran.status, 0, "{}", ran.stderr);
    for line in lines(&out.join("runs.jsonl")) {
        assert_eq!(line["verified"]["success"], true, "{line}");
        assert_eq!(line["score"]["samples"], 40 + poses["data"]["samples"].as_array().unwrap().len());
    }
    let mut spoiled = json(&separation);
    spoiled["benchmark"] =
        json!({ "purpose": "p", "stresses": ["s"], "outliers": { "share": 0.1, "factor": 9 } });
    let path = write(folder.path(), "spoiled.json", &spoiled);
    let ran = gough("compare {0} --solvers minimal", &[&path]);
    assert!(ran.status == 2 && ran.stdout.is_empty(), "{ran:?}");
    assert!(
        ran.stderr.contains("spoiled.json") && ran.stderr.contains("benchmark.outliers"),
        "{}",
        ran.stderr
    );
}
