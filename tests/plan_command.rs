//! `gough plan` as a user meets it.

mod support;

use serde_json::json;
use std::path::Path;
use support::{command, done, file, gough, json, ran, write};

fn lines(path: &Path) -> Vec<String> {
    std::fs::read_to_string(path).unwrap().lines().map(str::to_owned).collect()
}

#[test]
fn a_plan_is_a_file_of_readings() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let problem = file("problems/delta-3puu.json");
    for (criterion, options) in
        [("D", "--random 60"), ("a", "--grid 4"), ("E", "--random 60"), ("G", "--random 60")]
    {
        let line = format!("plan {{0}} --poses 8 {options} --criterion {criterion} -o {{1}}");
        let told = done(&line, &[&problem, &at("plan.csv")]).stdout;
        for words in ["-efficient", "directions beat the tolerances", "with it"] {
            assert!(told.contains(words), "{told}");
        }
        let plan = lines(&at("plan.csv"));
        assert_eq!(plan[0], "limb1.tower,limb2.tower,limb3.tower");
        assert_eq!(plan.len(), 9);
        for row in &plan[1..] {
            assert!(
                row.split(',').all(|v| (130.0 - 1e-9..=230.0 + 1e-9).contains(&v.parse::<f64>().unwrap()))
            );
        }
        // What is planned can be predicted, and chosen from in turn.
        done("predict {0} --actuators {1} -o {2}", &[&problem, &at("plan.csv"), &at("poses.csv")]);
        let told = done(
            "plan {0} --poses 8 --candidates {1} --workspace {1} -o {2}",
            &[&problem, &at("poses.csv"), &at("again.csv")],
        );
        assert!(told.stdout.contains("8 of 8 postures"), "{}", told.stdout);
        let (mut first, mut again) = (plan, lines(&at("again.csv")));
        first.sort();
        again.sort();
        assert_eq!(first, again);
    }
    let told = done("plan {0} --poses 4 --random 50 --add-to-measured -o {1}", &[&problem, &at("plan.csv")]);
    assert!(told.stdout.contains("added to the 60 measured ones"), "{}", told.stdout);
}

#[test]
fn threads_do_not_change_a_plan() {
    let problem = file("problems/tripod-3rps.json");
    let by = |threads: &str, seed: &str| {
        let mut command = command();
        command.env("RAYON_NUM_THREADS", threads).arg("plan").arg(&problem);
        let ran = ran(command.args(["--poses", "10", "--random", "200", "--seed", seed]));
        assert_eq!(ran.status, 0, "{ran:?}");
        assert!(ran.stderr.contains("-efficient"), "{ran:?}");
        (ran.stdout, ran.stderr)
    };
    assert_eq!(by("1", "4"), by("3", "4"));
    assert_ne!(by("2", "4").0, by("2", "5").0);
}

#[test]
fn what_cannot_be_planned_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = file("problems/hexapod-6ups.json");
    let refused = |line: &str, problem: &Path, words: &[&str]| {
        let ran = gough(&format!("plan {{0}} {line}"), &[problem]);
        assert!(ran.status == 2 && ran.stdout.is_empty(), "{line}: {ran:?}");
        for word in words {
            assert!(ran.stderr.contains(word), "{word}: {ran:?}");
        }
        // Usage errors of the parser have lines of their own.
        assert!(ran.stderr.contains("--help") || ran.stderr.trim_end().lines().count() == 1, "{ran:?}");
    };
    refused("--poses 30 --random 20", &path, &["20 candidates", "30 poses"]);
    refused("--poses 2 --criterion Z", &path, &["unknown criterion Z", "D, A, E, G"]);
    refused("--poses 2 --grid 40", &path, &["too many", "coarser grid"]);
    refused("--poses 0", &path, &["--poses"]);
    refused("--poses 2 --regularity 2", &path, &["--regularity"]);
    refused("--poses 2 --random 30 --regularity 0.9", &path, &["workspace is empty", "nearly singular"]);
    refused("--poses 2 --grid 2 --random 5", &path, &["cannot be used with"]);
    let with = |name: &str, change: &dyn Fn(&mut serde_json::Value)| {
        let mut problem = json(&path);
        change(&mut problem);
        write(folder.path(), name, &problem)
    };
    for noise in [0.0, -1e-5] {
        let noisy = with("noise.json", &|p| p["data"]["noise"]["length"] = json!(noise));
        refused("--poses 2", &noisy, &["data.noise.length", "positive standard deviation"]);
    }
    let silent = with("silent.json", &|p| {
        p["data"].as_object_mut().unwrap().remove("noise");
        p["data"].as_object_mut().unwrap().remove("holdout");
    });
    refused("--poses 2", &silent, &["data.noise is not stated"]);
    // Legs that never meet.
    let apart = with("apart.json", &|p| {
        for limb in p["mechanism"]["limbs"].as_array_mut().unwrap() {
            limb["joints"][1]["range"] = json!([3.0, 3.1]);
        }
        p["mechanism"]["limbs"][0]["joints"][1]["range"] = json!([-0.01, 0.0]);
    });
    refused("--poses 2 --random 10", &apart, &["workspace is empty", "posture"]);
    let held = with("held.json", &|p| p["mechanism"]["tolerance"] = json!({"angle": 0, "length": 0}));
    refused("--poses 2 --random 10", &held, &["every link is held"]);
}
