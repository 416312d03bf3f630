//! `gough check`: each usual mistake, planted in clean data, is named; clean data are not accused.

mod support;

use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use serde_json::{Value, json};
use std::path::Path;
use support::{Ran, file, gough, json, numbers, problems, write};

/// What is done to a sample.
type Mistake = fn(&mut Value);

fn scale(value: &mut Value, factor: f64) {
    *value = json!(numbers(value).iter().map(|v| v * factor).collect::<Vec<_>>());
}

fn rotation(sample: &Value) -> Rotation3<f64> {
    Rotation3::from_scaled_axis(Vector3::from_column_slice(&numbers(&sample["pose"]["rotation"])))
}

fn position(sample: &Value) -> Vector3<f64> {
    Vector3::from_column_slice(&numbers(&sample["pose"]["position"]))
}

fn set(sample: &mut Value, p: Vector3<f64>, r: Rotation3<f64>) {
    sample["pose"] = json!({"position": p.as_slice(), "rotation": r.scaled_axis().as_slice()});
}

fn checked(folder: &Path, problem: &str, mistake: Mistake) -> Ran {
    let mut problem = json(&file(&format!("problems/{problem}.json")));
    for sample in problem["data"]["samples"].as_array_mut().unwrap() {
        mistake(sample);
    }
    gough("check {0}", &[&write(folder, "spoiled.json", &problem)])
}

/// The suspicion that is named first, with the residual before and after in m.
#[track_caller]
fn named(machine: &str, mistake: Mistake, words: &str) {
    let folder = tempfile::tempdir().unwrap();
    let ran = checked(folder.path(), machine, mistake);
    assert!(ran.status == 1 && ran.stderr.is_empty(), "{words}: {ran:?}");
    let suspicions: Vec<&str> = ran.stdout.lines().filter(|line| line.starts_with("suspicious")).collect();
    assert!(suspicions.len() == 1 && suspicions[0].contains(words), "{machine}, {words}: {}", ran.stdout);
    let line = ran.stdout.lines().find(|line| line.starts_with("  residual ")).unwrap();
    let parts: Vec<f64> = line.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    assert!(parts.len() == 2 && parts[1] < 0.02 && parts[0] > 10.0 * parts[1], "{machine}, {words}: {line}");
}

/// Mistakes that any machine's data may have.
const POSES: [(Mistake, &str); 6] = [
    (|s| scale(&mut s["pose"]["position"], 1e3), "measured positions look like mm where the file means m"),
    (|s| scale(&mut s["pose"]["position"], 1e-3), "measured positions look like m where the file means mm"),
    (
        |s| scale(&mut s["pose"]["rotation"], 180.0 / std::f64::consts::PI),
        "measured rotations look like degrees",
    ),
    (|s| scale(&mut s["pose"]["rotation"], -1.0), "measured rotations look transposed"),
    (
        |s| {
            let q = UnitQuaternion::from_rotation_matrix(&rotation(s));
            s["pose"] = json!({"position": s["pose"]["position"], "quaternion": [q.i, q.j, q.k, q.w]});
        },
        "quaternions look like [x, y, z, w]",
    ),
    (
        |s| {
            let (p, r) = (position(s), rotation(s).inverse());
            set(s, -(r * p), r);
        },
        "base and tool look exchanged",
    ),
];

#[test]
fn mistakes_in_poses() {
    for machine in ["hexapod-6ups", "serial-puma560"] {
        for (mistake, words) in POSES {
            named(machine, mistake, words);
        }
    }
    // The hexapod turns too little to tell such angles from a rotation vector.
    let angles: Mistake = |s| {
        let (roll, pitch, yaw) = rotation(s).euler_angles();
        s["pose"]["rotation"] = json!([roll, pitch, yaw]);
    };
    named(
        "serial-puma560",
        angles,
        "rotations look like angles about fixed axes x, y, z: write rotation vectors",
    );
}

fn reading(sample: &mut Value, i: usize, change: impl Fn(f64) -> f64) {
    let value = &mut sample["actuators"][i];
    *value = json!(change(value.as_f64().unwrap()));
}

#[test]
fn mistakes_in_readings() {
    let swapped: Mistake = |s| s["actuators"].as_array_mut().unwrap().swap(1, 2);
    named("hexapod-6ups", swapped, "actuators limb2.leg and limb3.leg look swapped");
    named("serial-puma560", swapped, "actuators arm.shoulder and arm.elbow look swapped");
    let reversed: Mistake = |s| reading(s, 4, |v| -v);
    named("hexapod-6ups", reversed, "limb5.leg looks reversed");
    named("serial-puma560", reversed, "arm.pitch looks reversed");
    named("hexapod-6ups", |s| scale(&mut s["actuators"], 1e3), "readings of sliding actuators look like mm");
    named(
        "hexapod-6ups",
        |s| scale(&mut s["actuators"], 1e-3),
        "readings of sliding actuators look like m where",
    );
    let degrees: Mistake = |s| scale(&mut s["actuators"], 180.0 / std::f64::consts::PI);
    named("serial-puma560", degrees, "readings of turning actuators look like degrees");
    named("hexapod-6ups", |s| s["actuators"].as_array_mut().unwrap().rotate_right(2), "look shifted by 2");
    named("serial-puma560", |s| s["actuators"].as_array_mut().unwrap().reverse(), "in reverse order");
    let counted: Mistake = |s| (0..6).for_each(|i| reading(s, i, |v| v + 0.7));
    let folder = tempfile::tempdir().unwrap();
    let ran = checked(folder.path(), "hexapod-6ups", counted);
    assert!(
        ran.status == 1 && ran.stdout.contains("readings at home look different from \"home\""),
        "{ran:?}"
    );
    for limb in 1..=6 {
        let line = ran.stdout.lines().find(|l| l.contains(&format!("limb{limb}.leg: \"home\": "))).unwrap();
        let home: f64 = line.split("\"home\": ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
        assert!((home - 0.7).abs() < 5e-3, "{line}");
    }
    named("serial-puma560", |s| reading(s, 2, |v| v - 0.35), "readings at home look different");
}

#[test]
fn mistakes_together() {
    let folder = tempfile::tempdir().unwrap();
    let both: Mistake = |s| {
        scale(&mut s["pose"]["position"], 1e3);
        s["actuators"].as_array_mut().unwrap().swap(0, 5);
    };
    let ran = checked(folder.path(), "hexapod-6ups", both);
    assert!(ran.status == 1, "{ran:?}");
    for words in ["measured positions look like mm", "limb1.leg and limb6.leg look swapped"] {
        assert!(ran.stdout.contains(words), "{}", ran.stdout);
    }
    // An instrument that stands elsewhere, with its axes turned.
    for machine in ["hexapod-6ups", "serial-puma560"] {
        named(
            machine,
            |s| {
                let turn = Rotation3::from_scaled_axis(Vector3::new(0.4, 1.9, -0.3));
                let (p, r) = (position(s), rotation(s));
                set(s, turn * p + Vector3::new(3.0, -2.0, 1.0), turn * r);
            },
            "the base looks to stand elsewhere than drawn",
        );
    }
}

#[test]
fn clean_data_are_not_accused() {
    for problem in problems() {
        let ran = gough("check {0}", &[&problem]);
        assert!(ran.status == 0 && ran.stderr.is_empty(), "{}: {ran:?}", problem.display());
        assert!(ran.stdout.ends_with("\nnothing suspicious\n"), "{}", ran.stdout);
    }
    let ran = gough("check {0}", &[&file("problems/hexapod-6ups.json")]);
    for words in
        ["limb1: base (universal), leg (prismatic, actuated), ball (spherical)", "mobility: six", "limb6.leg"]
    {
        assert!(ran.stdout.contains(words), "{}", ran.stdout);
    }
}

#[test]
fn repeated_postures_tell_the_noise() {
    let folder = tempfile::tempdir().unwrap();
    let mut problem = json(&file("problems/hexapod-6ups.json"));
    let samples = problem["data"]["samples"].as_array_mut().unwrap();
    samples.truncate(5);
    // Four measurements of each posture whose positions are 0, 0, 3 and -3 s from their mean: pooled variance
    // 5 * 3 * 18 s^2 / (5 * 9) = 6 s^2.
    let s = 1e-5 / 6f64.sqrt();
    let repeated: Vec<Value> = samples
        .iter()
        .flat_map(|sample| {
            [0.0, 0.0, 3.0, -3.0].map(|by| {
                let mut again = sample.clone();
                let p = position(sample) + Vector3::repeat(by * s);
                again["pose"]["position"] = json!(p.as_slice());
                again
            })
        })
        .collect();
    *samples = repeated;
    problem["data"]["noise"] = json!({"angle": 2e-5, "length": 1e-5});
    let ran = gough("check {0}", &[&write(folder.path(), "repeated.json", &problem)]);
    let line = "5 postures were measured more than once, 20 times in all: noise 1.000e-5 m, 0.000e0 rad";
    assert!(ran.stdout.contains(line), "{ran:?}");
    // Rotations that never change are as surprising as positions that scatter far too much.
    problem["data"]["noise"] = json!({"angle": 2e-5, "length": 1e-6});
    let ran = gough("check {0}", &[&write(folder.path(), "repeated.json", &problem)]);
    assert!(ran.status == 1 && ran.stdout.contains("stated noise in length is 0.10 of that"), "{ran:?}");
}
