//! `gough check` and gross errors of single readings, copies, free links and ends.

mod support;

use serde_json::{Value, json};
use support::{Ran, file, gough, json, numbers, write};

fn kind(name: &str) -> Value {
    json(&file(&format!("problems/kinds/{name}.json")))
}

fn samples(problem: &mut Value) -> &mut Vec<Value> {
    problem["data"]["samples"].as_array_mut().unwrap()
}

fn checked(problem: &Value) -> Ran {
    let folder = tempfile::tempdir().unwrap();
    gough("check {0}", &[&write(folder.path(), "spoiled.json", problem)])
}

/// Sample 3 and no other is named.
#[track_caller]
fn third_stands_out(problem: &Value, kind: &str) {
    let ran = checked(problem);
    let lines: Vec<&str> = ran.stdout.lines().filter(|line| line.starts_with("suspicious")).collect();
    let words = format!("suspicious: 1 sample of kind {kind} stands out from the others");
    assert!(ran.status == 1 && lines.len() == 1 && lines[0].contains(&words), "{}", ran.stdout);
    assert!(lines[0].contains("is explained): sample 3 ("), "{}", lines[0]);
}

#[test]
fn a_reading_that_stands_out_is_named() {
    for (name, key, by, words) in [
        ("hexapod-6ups-distance", "distance", 0.05, "distance"),
        ("delta-3puu-separation", "distance", 20.0, "distance"),
        ("hexapod-6ups-plane", "height", 0.05, "height above a plane"),
    ] {
        let mut spoiled = kind(name);
        let value = &mut samples(&mut spoiled)[2][key];
        *value = json!(value.as_f64().unwrap_or(0.0) + by);
        third_stands_out(&spoiled, words);
    }
    let mut spoiled = kind("hexapod-6ups-passive");
    let value = &mut samples(&mut spoiled)[2]["joints"][0];
    *value = json!(value.as_f64().unwrap() + 0.3);
    third_stands_out(&spoiled, "passive joint (angle)");
}

#[test]
fn a_third_of_the_readings_of_another_target_is_named() {
    let mut spoiled = kind("hexapod-6ups-distance");
    let mut renamed = 0;
    for sample in samples(&mut spoiled) {
        if sample["target"] == "left" {
            sample["target"] = json!("front");
            renamed += 1;
        }
    }
    assert_eq!(renamed, 50);
    let ran = checked(&spoiled);
    assert!(ran.status == 1 && ran.stdout.contains("of kind distance stand out from the others"), "{ran:?}");
    let line = ran.stdout.lines().find(|line| line.starts_with("suspicious")).unwrap();
    let named: usize = line.split(' ').nth(1).unwrap().parse().unwrap();
    assert!((30..=50).contains(&named), "{line}");
}

#[test]
fn distances_below_zero_are_refused_where_no_gauge_reads_them() {
    let mut spoiled = kind("hexapod-6ups-distance");
    samples(&mut spoiled)[6]["distance"] = json!(-1.0);
    let ran = checked(&spoiled);
    assert!(ran.status == 2 && ran.stdout.is_empty() && ran.stderr.lines().count() == 1, "{ran:?}");
    assert!(
        ran.stderr.contains("distance (sample 7): -1 is below zero") && ran.stderr.contains("-0.1"),
        "{ran:?}"
    );
    let mut spoiled = kind("delta-3puu-separation");
    samples(&mut spoiled)[0]["distance"] = json!(-0.5);
    let ran = checked(&spoiled);
    assert!(ran.status == 2 && ran.stderr.contains("distance (sample 1): -0.5 is below zero"), "{ran:?}");
    // A gauge that counts from wherever it was switched on may read anything.
    let mut counted = kind("hexapod-6ups-distance");
    for key in ["truth", "truth_instrument"] {
        counted.as_object_mut().unwrap().remove(key);
    }
    counted["data"]["instrument"]["gauges"]["wire"] = json!({"zero_tolerance": "free"});
    for part in ["/data", "/data/holdout"] {
        for sample in counted.pointer_mut(part).unwrap()["samples"].as_array_mut().unwrap() {
            sample["distance"] = json!(sample["distance"].as_f64().unwrap() - 3.0);
        }
    }
    let ran = checked(&counted);
    assert!(ran.status == 0 && ran.stdout.ends_with("\nnothing suspicious\n"), "{ran:?}");
}

#[test]
fn free_links_explain_what_they_make() {
    let mut free = json(&file("examples/my-hexapod.json"));
    free["mechanism"]["tolerance"] = json!("free");
    let folder = tempfile::tempdir().unwrap();
    let measured = folder.path().join("measured.json");
    let mut stated = json(&file("examples/my-hexapod.json"));
    let ran =
        gough("simulate {0} --poses 40 --seed 1 -o {1}", &[&file("examples/my-hexapod.json"), &measured]);
    assert_eq!(ran.status, 0, "{ran:?}");
    free["data"] = json(&measured)["data"].clone();
    let ran = checked(&free);
    assert!(ran.status == 0 && ran.stdout.contains("\"free\" links explain any misfit of theirs"), "{ran:?}");
    // Gross mistakes are found all the same, unless free ends take them up.
    free["mechanism"] = stated["mechanism"].clone();
    for limb in free["mechanism"]["limbs"].as_array_mut().unwrap() {
        limb["joints"][1]["tolerance"] = json!("free");
    }
    for sample in samples(&mut free) {
        sample["pose"]["position"] =
            json!(numbers(&sample["pose"]["position"]).iter().map(|v| 1e-3 * v).collect::<Vec<_>>());
    }
    let ran = checked(&free);
    assert!(ran.status == 1 && ran.stdout.contains("measured positions look like m where"), "{ran:?}");
    // With free ends, the worst postures are those of the machine that the median is of.
    stated["data"] = json(&measured)["data"].clone();
    for limb in stated["mechanism"]["limbs"].as_array_mut().unwrap() {
        limb["joints"][0]["tolerance"] = json!("free");
    }
    for sample in samples(&mut stated) {
        let mut p = numbers(&sample["pose"]["position"]);
        p[0] += 1000.0;
        sample["pose"]["position"] = json!(p);
    }
    let ran = checked(&stated);
    let line =
        ran.stdout.lines().find(|line| line.contains("with free ends where the data place them: ")).unwrap();
    let worst: Vec<f64> = line.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    assert!(ran.status == 0 && worst.len() >= 6 && worst.iter().all(|w| *w < 50.0), "{ran:?}");
}

#[test]
fn copies_are_no_repeats() {
    let folder = tempfile::tempdir().unwrap();
    let mut copied = json(&file("problems/hexapod-6ups.json"));
    let first = samples(&mut copied)[0].clone();
    *samples(&mut copied) = vec![first; 20];
    let path = write(folder.path(), "copied.json", &copied);
    let ran = gough("check {0}", &[&path]);
    assert!(ran.status == 1 && ran.stdout.contains("these repeats are identical"), "{ran:?}");
    assert!(!ran.stdout.contains("of that") && !ran.stdout.contains("inf"), "{}", ran.stdout);
    let ran = gough("identify {0}", &[&path]);
    assert!(ran.stdout.contains("the residual is less than 0.001 times what the stated noise"), "{ran:?}");
}

#[test]
fn samples_of_weight_zero_are_said_to_be_there() {
    let folder = tempfile::tempdir().unwrap();
    let mut unused = json(&file("problems/hexapod-6ups.json"));
    let count = samples(&mut unused).len();
    samples(&mut unused).iter_mut().for_each(|sample| sample["weight"] = json!(0));
    let path = write(folder.path(), "unused.json", &unused);
    let ran = gough("identify {0}", &[&path]);
    assert!(
        ran.status == 2 && ran.stderr.contains(&format!("all {count} samples are of weight 0")),
        "{ran:?}"
    );
    let ran = gough("check {0}", &[&path]);
    assert!(ran.stdout.contains(&format!("with: {count} samples of weight 0")), "{ran:?}");
}
