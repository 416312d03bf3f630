//! `gough check`: mistakes of whole files, several at once, small ones, single postures, and readings other than poses.

mod support;

use nalgebra::{Rotation3, Vector3};
use serde_json::{Value, json};
use std::path::Path;
use support::{Ran, file, gough, json, numbers, write};

const MACHINES: [&str; 2] = ["hexapod-6ups", "serial-puma560"];
const DEGREE: f64 = std::f64::consts::PI / 180.0;

fn problem(machine: &str) -> Value {
    json(&file(&format!("problems/{machine}.json")))
}

fn checked(problem: &Value) -> Ran {
    let folder = tempfile::tempdir().unwrap();
    let ran = gough("check {0}", &[&write(folder.path(), "spoiled.json", problem)]);
    assert!(ran.stderr.is_empty(), "{ran:?}");
    ran
}

fn samples(problem: &mut Value) -> &mut Vec<Value> {
    problem["data"]["samples"].as_array_mut().unwrap()
}

/// Every number below `value`, times the factor.
fn scale(value: &mut Value, factor: f64) {
    match value {
        Value::Array(list) => list.iter_mut().for_each(|v| scale(v, factor)),
        Value::Number(number) => *value = json!(number.as_f64().unwrap() * factor),
        _ => {}
    }
}

/// Numbers of these keys anywhere below, and of these keys in tolerances and noises, times the factor.
fn scale_keys(value: &mut Value, keys: &[&str], factor: f64) {
    match value {
        Value::Array(list) => list.iter_mut().for_each(|v| scale_keys(v, keys, factor)),
        Value::Object(map) => {
            for (key, value) in map.iter_mut() {
                if keys.contains(&key.as_str()) {
                    scale(value, factor)
                } else {
                    scale_keys(value, keys, factor)
                }
            }
        }
        _ => {}
    }
}

/// The lines that suspect something are these and no others.
#[track_caller]
fn suspects(problem: &Value, words: &[&str]) -> Ran {
    let ran = checked(problem);
    let lines: Vec<&str> = ran.stdout.lines().filter(|line| line.starts_with("suspicious")).collect();
    assert!(ran.status == 1 && lines.len() == words.len(), "{words:?}: {}", ran.stdout);
    for word in words {
        assert!(lines.iter().any(|line| line.contains(word)), "{word}: {}", ran.stdout);
    }
    ran
}

/// The problem with lengths of its data, or of the whole file, as another unit writes them; what it states stays.
fn lengths(problem: &mut Value, whole: bool, factor: f64) {
    let sliding = problem["name"].as_str().unwrap().starts_with("hexapod");
    for sample in samples(problem) {
        scale(&mut sample["pose"]["position"], factor);
        if sliding {
            scale(&mut sample["actuators"], factor);
        }
    }
    if whole {
        let of_machine: &[&str] = if sliding {
            &["point", "position", "length", "home", "range"]
        } else {
            &["point", "position", "length"]
        };
        scale_keys(&mut problem["mechanism"], of_machine, factor);
        scale_keys(&mut problem["data"]["noise"], &["length"], factor);
        let data = problem["data"].as_object_mut().unwrap();
        data.remove("holdout");
        problem.as_object_mut().unwrap().remove("truth");
    }
}

/// The same problem in mm.
fn in_millimetres(machine: &str) -> Value {
    let mut problem = problem(machine);
    lengths(&mut problem, true, 1e3);
    problem["units"]["length"] = json!("mm");
    assert_eq!(checked(&problem).status, 0, "{machine}");
    problem
}

#[test]
fn units_of_all_lengths_and_of_the_file() {
    for machine in MACHINES {
        let both = if machine == "hexapod-6ups" {
            "positions and readings of sliding actuators look like"
        } else {
            "measured positions look like"
        };
        // Metres in readings and positions of a file in mm, and the reverse.
        let mut spoiled = in_millimetres(machine);
        lengths(&mut spoiled, false, 1e-3);
        suspects(&spoiled, &[&format!("{both} m where the file means mm")]);
        let mut spoiled = problem(machine);
        lengths(&mut spoiled, false, 1e3);
        suspects(&spoiled, &[&format!("{both} mm where the file means m")]);
        // The file says m and everything in it is in mm, and the reverse.
        let mut spoiled = problem(machine);
        lengths(&mut spoiled, true, 1e3);
        suspects(&spoiled, &["the file says m, but its lengths look like mm; correct units.length"]);
        let mut spoiled = in_millimetres(machine);
        lengths(&mut spoiled, true, 1e-3);
        suspects(&spoiled, &["the file says mm, but its lengths look like m; correct units.length"]);
    }
}

#[test]
fn units_of_all_angles() {
    let turned = |factor: f64| {
        let mut problem = problem("serial-puma560");
        for sample in samples(&mut problem) {
            scale(&mut sample["pose"]["rotation"], factor);
            scale(&mut sample["actuators"], factor);
        }
        problem
    };
    let words = "readings of turning actuators and measured rotations look like";
    suspects(&turned(1.0 / DEGREE), &[&format!("{words} degrees where the file means rad")]);
    suspects(&turned(DEGREE), &[&format!("{words} rad where the file means degrees")]);
}

#[test]
fn two_mistakes_at_once() {
    for machine in MACHINES {
        let names = if machine == "hexapod-6ups" {
            "actuators limb2.leg and limb3.leg look swapped"
        } else {
            "actuators arm.shoulder and arm.elbow look swapped"
        };
        let mut spoiled = problem(machine);
        for sample in samples(&mut spoiled) {
            sample["actuators"].as_array_mut().unwrap().swap(1, 2);
            scale(&mut sample["pose"]["rotation"], DEGREE);
        }
        suspects(&spoiled, &["measured rotations look like rad where the file means degrees", names]);
        let reversed =
            if machine == "hexapod-6ups" { "limb5.leg looks reversed" } else { "arm.pitch looks reversed" };
        let mut spoiled = problem(machine);
        for sample in samples(&mut spoiled) {
            scale(&mut sample["actuators"][4], -1.0);
            scale(&mut sample["pose"]["position"], 1e3);
        }
        suspects(&spoiled, &["measured positions look like mm where the file means m", reversed]);
        // Inverted rotations seen by an instrument that stands elsewhere.
        let turn = Rotation3::from_scaled_axis(Vector3::new(0.4, 1.9, -0.3));
        let mut spoiled = problem(machine);
        for sample in samples(&mut spoiled) {
            let vector = |key: &str| Vector3::from_column_slice(&numbers(&sample["pose"][key]));
            let p = turn * vector("position") + Vector3::new(3.0, -2.0, 1.0);
            let r = turn * Rotation3::from_scaled_axis(vector("rotation"));
            sample["pose"] =
                json!({"position": p.as_slice(), "rotation": r.inverse().scaled_axis().as_slice()});
        }
        suspects(&spoiled, &["measured rotations look transposed", "the base looks to stand elsewhere"]);
    }
}

#[test]
fn small_offsets_of_homes_are_named() {
    // Tolerances of the hexapod explain a few mm.
    for off in [0.008, 0.012, 0.02] {
        let mut spoiled = problem("hexapod-6ups");
        for sample in samples(&mut spoiled) {
            let read = sample["actuators"][2].as_f64().unwrap();
            sample["actuators"][2] = json!(read + off);
        }
        let ran = suspects(&spoiled, &["readings at home look different"]);
        let line = ran.stdout.lines().find(|line| line.contains("limb3.leg: \"home\": ")).unwrap();
        let home: f64 = line.split("\"home\": ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
        assert!((home - off).abs() < 2e-3, "{line}");
    }
    let mut spoiled = problem("serial-puma560");
    for sample in samples(&mut spoiled) {
        let read = sample["actuators"][2].as_f64().unwrap();
        sample["actuators"][2] = json!(read + 0.04);
    }
    suspects(&spoiled, &["readings at home look different"]);
}

#[test]
fn a_tool_drawn_elsewhere_is_no_home() {
    for machine in MACHINES {
        for shift in [[0.02, 0.0, 0.0], [0.0, 0.0, 0.02]] {
            let mut spoiled = problem(machine);
            for sample in samples(&mut spoiled) {
                let vector = |key: &str| Vector3::from_column_slice(&numbers(&sample["pose"][key]));
                let r = Rotation3::from_scaled_axis(vector("rotation"));
                sample["pose"]["position"] =
                    json!((vector("position") + r * Vector3::from(shift)).as_slice());
            }
            suspects(&spoiled, &["the tool looks to stand elsewhere than drawn"]);
        }
    }
}

#[test]
fn a_posture_that_stands_out_is_named() {
    for machine in MACHINES {
        let mut spoiled = problem(machine);
        let p = &mut samples(&mut spoiled)[6]["pose"]["position"];
        p[1] = json!(p[1].as_f64().unwrap() + 0.05);
        let line = "1 posture stands out from the others: sample 7 (";
        suspects(&spoiled, &[line]);
        // Beside another mistake, too.
        for sample in samples(&mut spoiled) {
            scale(&mut sample["pose"]["rotation"], 1.0 / DEGREE);
        }
        suspects(&spoiled, &["measured rotations look like degrees", line]);
    }
}

#[test]
fn what_is_compared_is_said() {
    let name = |kind: &str| file(&format!("problems/kinds/{kind}.json"));
    for (kind, words) in [
        ("hexapod-6ups-distance", "150 samples are less than a pose of the tool (kinds: distance): compared"),
        ("hexapod-6ups-plane", "  height above a plane: median error "),
        ("hexapod-6ups-passive", "  passive joint (angle): median error "),
        ("delta-3puu-separation", "  distance: median error "),
        ("serial-puma560-position", "  position: median error "),
        ("serial-puma560-mixed", "drawing against poses: "),
    ] {
        let ran = gough("check {0}", &[&name(kind)]);
        assert!(ran.status == 0 && ran.stdout.contains(words), "{kind}: {ran:?}");
        assert!(ran.stdout.ends_with("\nnothing suspicious\n"), "{}", ran.stdout);
    }
    let mut spoiled: Value = json(Path::new(&name("hexapod-6ups-distance")));
    for sample in samples(&mut spoiled) {
        scale(&mut sample["distance"], 1e3);
    }
    let ran = checked(&spoiled);
    assert!(ran.status == 1 && ran.stdout.contains("readings of kind distance are far from"), "{ran:?}");
}
