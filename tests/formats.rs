//! Foreign formats: poses by Pinocchio, MuJoCo and NumPy (tests/generate/formats.py), round trips, and bad files.

mod support;

use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use support::{Errors, done, errors, file, gough, json, poses, units, write};

fn model(name: &str) -> PathBuf {
    file("tests/data/formats").join(name)
}

fn independent(name: &str) -> PathBuf {
    file("tests/data/independent/formats").join(format!("{name}.json"))
}

/// Runs an import; it says on standard error what is still missing.
#[track_caller]
fn import(line: &str, source: &Path, to: &Path) {
    let ran = gough(&format!("import {line} -o {{1}}"), &[source, to]);
    assert!(
        ran.status == 0 && ran.stdout.is_empty() && ran.stderr.contains("to identify"),
        "{line}: {ran:?}"
    );
}

#[track_caller]
fn export(line: &str, paths: &[&Path]) -> String {
    let ran = gough(&format!("export {line}"), paths);
    assert!(ran.status == 0 && ran.stdout.is_empty(), "{line}: {ran:?}");
    ran.stderr
}

/// How the poses that `problem` predicts differ from others at the same readings.
#[track_caller]
fn against(problem: &Path, other: &Path) -> Errors {
    let units = units(&json(problem));
    let ran = done("predict {0} --actuators {1}", &[problem, other]);
    let predicted = poses(&serde_json::from_str(&ran.stdout).unwrap(), units);
    assert!(predicted.len() >= 10);
    errors(&predicted, &poses(&json(other), units))
}

#[track_caller]
fn assert_same(found: Errors) {
    assert!(found.rotation_max < 1e-12 && found.position_max < 1e-12, "{found:?}");
}

const ARM: &str = "urdf {0} --base world --tool tool";
const RAIL: &str = "urdf {0} --base base --tool k6";
const DH: &str = "dh {0} --length mm --angle deg --convention";

#[test]
fn machines_move_as_other_libraries_say() {
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().join("problem.json");
    for (line, source, name) in [
        (ARM, "skew-6r.urdf", "skew-6r"),
        (RAIL, "skew-7.urdf", "skew-7"),
        ("mjcf {0} --tool probe", "hexapod.xml", "hexapod"),
        (&format!("{DH} standard"), "table.csv", "table-standard"),
        (&format!("{DH} modified"), "table.csv", "table-modified"),
    ] {
        import(line, &model(source), &to);
        assert_same(against(&to, &independent(name)));
    }
    let hexapod = json(&{
        import("mjcf {0} --tool probe", &model("hexapod.xml"), &to);
        to.clone()
    });
    let first = &hexapod["mechanism"]["limbs"][0]["joints"][2];
    assert_eq!((&first["home"], &first["range"]), (&json!(0.01), &json!([-0.09, 0.08])));
}

/// Moves every axis, and the tool, by up to two millimetres and milliradians.
fn moved(problem: &Path, to: &Path) {
    let mut problem = json(problem);
    let (length, _) = units(&problem);
    let mut k = 0.0_f64;
    let mut shift = |value: &mut Value, size: f64| {
        for v in value.as_array_mut().unwrap() {
            k += 1.0;
            *v = json!(v.as_f64().unwrap() + size * (k * 12.9898).sin());
        }
    };
    for joint in problem["mechanism"]["limbs"][0]["joints"].as_array_mut().unwrap() {
        shift(&mut joint["point"], 0.002 / length);
        shift(&mut joint["axis"], 0.002);
    }
    shift(&mut problem["mechanism"]["tool"]["position"], 0.002 / length);
    fs::write(to, problem.to_string()).unwrap();
}

#[test]
fn a_urdf_comes_back_as_it_was_and_a_calibrated_one_moves_as_the_machine() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for (line, source, ends, name) in [
        (ARM, "skew-6r.urdf", "--base world --tool tool", "skew-6r"),
        (RAIL, "skew-7.urdf", "--base base --tool k6", "skew-7"),
    ] {
        let source = model(source);
        import(line, &source, &at("drawn.json"));
        moved(&at("drawn.json"), &at("moved.json"));
        let into = format!("{{0}} --format urdf --template {{1}} {ends} -o {{2}}");
        export(&into, &[&at("drawn.json"), &source, &at("same.urdf")]);
        assert_eq!(fs::read_to_string(at("same.urdf")).unwrap(), fs::read_to_string(&source).unwrap());
        export(&into, &[&at("moved.json"), &source, &at("moved.urdf")]);
        export("{0} --format urdf -o {1}", &[&at("moved.json"), &at("plain.urdf")]);
        let ran = done(
            "predict {0} --actuators {1} -o {2}",
            &[&at("moved.json"), &independent(name), &at("p.json")],
        );
        assert!(ran.stdout.is_empty());
        let drawn = against(&at("drawn.json"), &at("p.json"));
        assert!(drawn.position_rms > 1e-3 && drawn.rotation_rms > 1e-3, "{drawn:?}");
        import(line, &at("moved.urdf"), &at("again.json"));
        assert_same(against(&at("again.json"), &at("p.json")));
        import("urdf {0} --base base_link --tool tool", &at("plain.urdf"), &at("again.json"));
        assert_same(against(&at("again.json"), &at("p.json")));
        // What is not part of the chain is there, byte for byte.
        let kept = fs::read_to_string(at("moved.urdf")).unwrap();
        let original = fs::read_to_string(&source).unwrap();
        for line in
            original.lines().filter(|line| !line.contains("<origin") && !line.contains("<child link=\"k6\""))
        {
            assert!(kept.contains(line), "{line}");
        }
    }
}

#[test]
fn a_template_fits_a_machine_that_stands_elsewhere() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    import(ARM, &model("skew-6r.urdf"), &at("drawn.json"));
    let mut problem = json(&at("drawn.json"));
    // {S} turned by 90 degrees about z and moved by metres: (x, y, z) -> (y - 3, -x + 2, z + 1).
    let turn = |v: &Value, by: [f64; 3]| {
        let v = support::numbers(v);
        json!([v[1] + by[0], -v[0] + by[1], v[2] + by[2]])
    };
    for joint in problem["mechanism"]["limbs"][0]["joints"].as_array_mut().unwrap() {
        joint["point"] = turn(&joint["point"], [-3.0, 2.0, 1.0]);
        joint["axis"] = turn(&joint["axis"], [0.0; 3]);
    }
    let moved = write(folder.path(), "moved.json", &problem);
    export(
        "{0} --format urdf --template {1} --base world --tool tool -o {2}",
        &[&moved, &model("skew-6r.urdf"), &at("moved.urdf")],
    );
    // One origin says where the base is, and the last one where the tool is: all others are as they were.
    let (new, old) =
        (fs::read_to_string(at("moved.urdf")).unwrap(), fs::read_to_string(model("skew-6r.urdf")).unwrap());
    let changed: Vec<&str> = new.lines().filter(|line| !old.contains(line)).collect();
    assert!(changed.iter().all(|line| line.contains("<origin")), "{changed:?}");
    done("predict {0} --actuators {1} -o {2}", &[&moved, &independent("skew-6r"), &at("p.json")]);
    import(ARM, &at("moved.urdf"), &at("again.json"));
    assert_same(against(&at("again.json"), &at("p.json")));
}

#[test]
fn a_table_comes_back_and_says_what_it_cannot_express() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for convention in ["standard", "modified"] {
        import(&format!("{DH} {convention}"), &model("table.csv"), &at("drawn.json"));
        moved(&at("drawn.json"), &at("moved.json"));
        for problem in ["drawn.json", "moved.json"] {
            let line = format!("{{0}} --format dh --convention {convention} -o {{1}}");
            let said = export(&line, &[&at(problem), &at("table.csv")]);
            assert!(said.contains("largest error of the table"), "{said}");
            import(&format!("{DH} {convention}"), &at("table.csv"), &at("again.json"));
            let readings = independent(&format!("table-{convention}"));
            done("predict {0} --actuators {1} -o {2}", &[&at(problem), &readings, &at("p.json")]);
            assert_same(against(&at("again.json"), &at("p.json")));
        }
    }
    // The textbook's table of the PUMA 560 (Craig, section 3.7, in the standard convention).
    export("{0} --format dh -o {1}", &[&file("problems/serial-puma560.json"), &at("puma.csv")]);
    let table = fs::read_to_string(at("puma.csv")).unwrap();
    let rows: Vec<Vec<&str>> = table.lines().skip(1).map(|line| line.split(',').collect()).collect();
    let right = std::f64::consts::FRAC_PI_2;
    let wanted = [
        [0.0, 0.6718, 0.0, right],
        [0.0, 0.0, 0.4318, 0.0],
        [0.0, 0.15005, 0.0203, -right],
        [0.0, 0.4318, 0.0, right],
        [0.0, 0.0, 0.0, -right],
        [0.0, 0.05625, 0.0, 0.0],
    ];
    assert_eq!(rows.len(), 6);
    for (row, wanted) in rows.iter().zip(wanted) {
        for (cell, wanted) in row[2..6].iter().zip(wanted) {
            assert!((cell.parse::<f64>().unwrap() - wanted).abs() < 1e-14, "{row:?}");
        }
    }
    // Two axes a microradian from parallel: their common normal is far away, or they are written as parallel.
    let mut problem = json(&file("problems/serial-puma560.json"));
    problem["mechanism"]["limbs"][0]["joints"][2]["axis"] = json!([1e-6, -1.0, 0.0]);
    let skew = write(folder.path(), "skew.json", &problem);
    let said = export("{0} --format dh -o {1}", &[&skew, &at("far.csv")]);
    assert!(said.contains("shoulder and elbow are 1.00e-6 rad from parallel"), "{said}");
    assert!(said.contains("with --parallel 1.01e-6"), "{said}");
    let said = export("{0} --format dh --parallel 1e-5 -o {1}", &[&skew, &at("near.csv")]);
    assert!(
        said.contains("shoulder and elbow are written as parallel; they are 1.00e-6 rad apart"),
        "{said}"
    );
    let error: f64 =
        said.split("joints' ranges: ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!(error > 1e-7 && error < 2e-6, "{said}");
}

#[test]
fn deviations_are_a_table() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    done("identify {0} -o {1}", &[&file("problems/serial-puma560.json"), &at("result.json")]);
    export("{0} --format csv -o {1}", &[&at("result.json"), &at("table.csv")]);
    let result = json(&at("result.json"));
    let mut table = csv::Reader::from_path(at("table.csv")).unwrap();
    let rows: Vec<csv::StringRecord> = table.records().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 7);
    for (row, link) in rows.iter().zip(result["links"].as_array().unwrap()) {
        assert_eq!((row.get(0), row.get(1)), (link["limb"].as_str(), link["link"].as_str()));
        let wanted = [
            &link["deviation"]["rotation"],
            &link["deviation"]["translation"],
            &link["std"]["rotation"],
            &link["std"]["translation"],
        ];
        let wanted: Vec<f64> = wanted.iter().flat_map(|v| support::numbers(v)).collect();
        let found: Vec<f64> = row.iter().skip(2).map(|cell| cell.parse().unwrap()).collect();
        assert_eq!(found, wanted);
    }
    // The calibrated arm as a URDF, at the readings of the hold-out.
    export("{0} --format urdf -o {1}", &[&at("result.json"), &at("arm.urdf")]);
    import("urdf {0} --base base_link --tool tool", &at("arm.urdf"), &at("arm.json"));
    let problem = json(&file("problems/serial-puma560.json"));
    let readings = write(folder.path(), "r.json", &json!({"samples": problem["data"]["holdout"]["samples"]}));
    done("predict {0} --actuators {1} -o {2}", &[&at("result.json"), &readings, &at("p.json")]);
    assert_same(against(&at("arm.json"), &at("p.json")));
}
