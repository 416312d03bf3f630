//! `gough check`: mistakes of whole machines, of screws and of targets; and what the file states of noise and tolerances.

mod support;

use nalgebra::{Rotation3, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde_json::{Value, json};
use std::f64::consts::TAU;
use support::{Ran, file, gough, json, numbers, write};

fn problem(name: &str) -> Value {
    json(&file(&format!("problems/{name}.json")))
}

fn samples(problem: &mut Value) -> &mut Vec<Value> {
    problem["data"]["samples"].as_array_mut().unwrap()
}

fn checked(problem: &Value) -> Ran {
    let folder = tempfile::tempdir().unwrap();
    gough("check {0}", &[&write(folder.path(), "spoiled.json", problem)])
}

/// Readings of one actuator, or of all, changed.
fn read(problem: &mut Value, which: Option<usize>, change: impl Fn(f64) -> f64) {
    for sample in samples(problem) {
        let all: Vec<f64> = numbers(&sample["actuators"]);
        let one = |(i, v): (usize, &f64)| if which.is_none_or(|w| w == i) { change(*v) } else { *v };
        sample["actuators"] = json!(all.iter().enumerate().map(one).collect::<Vec<f64>>());
    }
}

/// One suspicion and no other, with these words.
#[track_caller]
fn says(problem: &Value, words: &str) -> Ran {
    let ran = checked(problem);
    let lines: Vec<&str> = ran.stdout.lines().filter(|line| line.starts_with("suspicious")).collect();
    assert!(ran.status == 1 && ran.stderr.is_empty() && lines.len() == 1, "{words}: {}", ran.stdout);
    assert!(lines[0].contains(words), "{words}: {}", ran.stdout);
    ran
}

/// The problem with data of a machine drawn from `distance` tolerances.
fn simulated(name: &str, distance: &str, poses: &str, noise: &str) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("measured.json");
    let line =
        format!("simulate {{0}} --poses {poses} --seed 4 --distance {distance} --noise {noise} -o {{1}}");
    let ran = gough(&line, &[&file(&format!("problems/{name}.json")), &out]);
    assert_eq!(ran.status, 0, "{ran:?}");
    json(&out)
}

#[test]
fn all_actuators_reversed() {
    let mut spoiled = problem("hexapod-6ups");
    read(&mut spoiled, None, |v| -v);
    says(&spoiled, "all actuators look reversed: negate");
    // About what they read at home.
    let mut spoiled = problem("hexapod-6ups");
    for limb in spoiled["mechanism"]["limbs"].as_array_mut().unwrap() {
        for joint in limb["joints"].as_array_mut().unwrap() {
            if joint["actuated"] == json!(true) {
                joint["home"] = json!(0.9);
                joint.as_object_mut().unwrap().remove("range");
            }
        }
    }
    read(&mut spoiled, None, |v| 0.9 - v);
    spoiled.as_object_mut().unwrap().remove("truth");
    says(&spoiled, "all actuators look reversed about their homes");
}

#[test]
fn readings_in_turns() {
    let mut spoiled = problem("serial-puma560");
    read(&mut spoiled, None, |v| v / TAU);
    says(&spoiled, "readings of turning actuators look like turns where the file means rad");
    let mut spoiled = problem("serial-kuka-lbr");
    assert_eq!(spoiled["units"]["angle"], "deg");
    read(&mut spoiled, Some(3), |v| v / 360.0);
    says(&spoiled, " look like turns where the file means degrees");
}

#[test]
fn screws_of_the_other_hand() {
    for (name, words) in [
        ("serial-scara-screw", "quill looks of the other hand"),
        ("hexapod-ballscrew", ".screw look of the other hand"),
    ] {
        let mut spoiled = problem(name);
        for limb in spoiled["mechanism"]["limbs"].as_array_mut().unwrap() {
            for joint in limb["joints"].as_array_mut().unwrap() {
                if let Some(pitch) = joint["pitch"].as_f64() {
                    joint["pitch"] = json!(-pitch);
                }
            }
        }
        spoiled.as_object_mut().unwrap().remove("truth");
        says(&spoiled, words);
    }
}

#[test]
fn a_screw_that_is_read_within_one_turn() {
    let mut spoiled = problem("serial-scara-screw");
    read(&mut spoiled, Some(2), |v| v.rem_euclid(360.0));
    says(&spoiled, "quill look counted within one turn");
    let mut spoiled = problem("serial-scara-screw");
    read(&mut spoiled, Some(2), |v| (v + 180.0).rem_euclid(360.0) - 180.0);
    says(&spoiled, "quill look counted within one turn");
}

/// Three targets of the tool, measured at every posture instead of its pose, with normal noise of `own` each and `common`
/// to a posture, m; stated are 5e-5 m each.
fn three_targets(own: f64, common: f64) -> Value {
    let mut problem = simulated("serial-puma560", "1", "50", "0");
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut normal = |size: f64| size * Vector3::from_fn(|_, _| StandardNormal.sample(&mut rng));
    let offsets = [("a", [0.15, 0.0, 0.02]), ("b", [-0.06, 0.12, 0.0]), ("c", [-0.07, -0.11, 0.03])];
    let measured: Vec<Value> = samples(&mut problem)
        .iter()
        .flat_map(|sample| {
            let vector = |key: &str| Vector3::from_column_slice(&numbers(&sample["pose"][key]));
            let (p, r) = (vector("position"), Rotation3::from_scaled_axis(vector("rotation")));
            let common = normal(common);
            let mut of = |(name, at): &(&str, [f64; 3])| {
                let p = p + r * Vector3::from(*at) + common + normal(own);
                json!({"actuators": sample["actuators"], "pose": {"position": p.as_slice()}, "target": name})
            };
            offsets.iter().map(&mut of).collect::<Vec<Value>>()
        })
        .collect();
    let targets: serde_json::Map<String, Value> =
        offsets.iter().map(|(name, at)| ((*name).to_owned(), json!({"offset": at}))).collect();
    let data = problem["data"].as_object_mut().unwrap();
    data.remove("holdout");
    data.insert("kind".into(), json!("position"));
    data.insert("noise".into(), json!({"length": 5e-5}));
    data.insert("instrument".into(), json!({"targets": targets}));
    data.insert("samples".into(), json!(measured));
    problem.as_object_mut().unwrap().remove("truth");
    problem
}

#[test]
fn targets_that_are_exchanged() {
    let clean = three_targets(5e-5, 0.0);
    let ran = checked(&clean);
    assert!(ran.status == 0 && ran.stdout.ends_with("\nnothing suspicious\n"), "{}", ran.stdout);
    let mut spoiled = clean;
    for sample in samples(&mut spoiled) {
        let other = match sample["target"].as_str() {
            Some("a") => "c",
            Some("c") => "a",
            _ => "b",
        };
        sample["target"] = json!(other);
    }
    says(&spoiled, "targets a and c look exchanged");
}

#[test]
fn targets_that_few_postures_exchange() {
    let mut spoiled = three_targets(5e-5, 0.0);
    samples(&mut spoiled).truncate(3 * 24);
    for sample in samples(&mut spoiled) {
        let other = match sample["target"].as_str() {
            Some("b") => "c",
            Some("c") => "b",
            _ => "a",
        };
        sample["target"] = json!(other);
    }
    says(&spoiled, "targets b and c look exchanged");
}

#[test]
fn tolerances_and_noise_that_are_stated_too_small() {
    for name in ["serial-puma560", "hexapod-6ups"] {
        let found = says(&simulated(name, "6", "60", "1"), "tolerances look too small");
        assert!(found.stdout.contains("suspicious: the deviations are "), "{}", found.stdout);
        let mut spoiled = simulated(name, "1", "60", "1");
        for key in ["angle", "length"] {
            let noise = &mut spoiled["data"]["noise"][key];
            *noise = json!(noise.as_f64().unwrap() / 5.0);
        }
        says(&spoiled, "noise understated");
    }
}

#[test]
fn what_the_targets_of_a_posture_share() {
    // Not stated: it is estimated, and nothing else is blamed.
    let mut problem = three_targets(5e-5, 2e-4);
    let ran = checked(&problem);
    assert!(ran.stdout.contains("have errors of ") && ran.stdout.contains(" in common"), "{}", ran.stdout);
    assert!(!ran.stdout.contains("look"), "{}", ran.stdout);
    // Stated five times too small.
    problem["data"]["posture_noise"] = json!({"length": 4e-5});
    let ran = checked(&problem);
    assert!(ran.status == 1 && ran.stdout.contains("correct data.posture_noise"), "{}", ran.stdout);
}

#[test]
fn what_targets_share_is_not_accused_of_other_faults() {
    // Rightly stated, where the noise is not.
    let mut problem = three_targets(2.5e-4, 2e-4);
    problem["data"]["posture_noise"] = json!({"length": 2e-4});
    let ran = says(&problem, "noise understated");
    assert!(!ran.stdout.contains("posture_noise"), "{}", ran.stdout);
    // Where one posture stands out: it, and nothing that it spoils.
    let mut problem = three_targets(5e-5, 2e-4);
    problem["data"]["posture_noise"] = json!({"length": 2e-4});
    for sample in &mut samples(&mut problem)[18..21] {
        let p = &mut sample["pose"]["position"];
        p[1] = json!(p[1].as_f64().unwrap() + 0.01);
    }
    let ran = says(&problem, "stand");
    assert!(
        !ran.stdout.contains("posture_noise") && !ran.stdout.contains("tolerances look"),
        "{}",
        ran.stdout
    );
}
