//! Comparisons where no truth is known, or where limits exclude it; tables and folders that say what they hold.

mod support;

use serde_json::{Value, json as value};
use std::fs;
use std::path::Path;
use support::*;

fn lines(folder: &Path) -> Vec<Value> {
    let text = fs::read_to_string(folder.join("runs.jsonl")).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

fn verified(line: &Value) -> bool {
    line["verified"]["success"].as_bool().unwrap()
}

/// Data with errors that the model does not have, and no truth: nothing is verified, and nothing is said of a truth.
#[test]
fn an_unexplained_residual_is_not_verified() {
    let folder = tempfile::tempdir().unwrap();
    let problem = file("tests/data/cases/compare/own-data-no-truth.json");
    let line = "compare {0} --own-data --solvers minimal,map --seeds 1 -o {1}";
    let ran = gough(line, &[&problem, folder.path()]);
    assert_eq!(ran.status, 0, "{ran:?}");
    assert!(!ran.stdout.contains("costs no more than the truth does,"), "{}", ran.stdout);
    for line in lines(folder.path()) {
        assert!(!verified(&line), "{line}");
        assert_eq!(line["verified"]["explained"], false, "{line}");
        assert!(line["verified"]["reason"].as_str().unwrap().contains("chi-square"), "{line}");
        let residual = &line["score"]["residual"];
        let at = |key: &str| residual[key].as_f64().unwrap();
        assert!(at("chi_square") > 10.0 * at("freedom"), "{residual}");
    }
}

/// Results that are right are verified without a truth as well.
#[test]
fn clean_data_without_a_truth() {
    let folder = tempfile::tempdir().unwrap();
    let mut passed = 0;
    for seed in 1..=20 {
        let simulated = folder.path().join("s.json");
        done(
            &format!("simulate {{0}} --poses 40 --seed {seed} -o {{1}}"),
            &[&file("problems/serial-scara.json"), &simulated],
        );
        let mut problem = json(&simulated);
        problem.as_object_mut().unwrap().remove("truth");
        let problem = write(folder.path(), "p.json", &problem);
        let out = folder.path().join(format!("{seed}"));
        gough("compare {0} --own-data --solvers minimal,map,argmin-lm --seeds 1 -o {1}", &[&problem, &out]);
        passed += lines(&out).iter().filter(|line| verified(line)).count();
    }
    assert!(passed >= 59, "{passed} of 60");
}

/// Limits of half a tolerance exclude most truths: the bound on predictions does not hold there, and optima pass.
#[test]
fn limits_that_exclude_the_truth() {
    let folder = tempfile::tempdir().unwrap();
    let mut some = false;
    for bounds in ["0.5", "1.5"] {
        let out = folder.path().join(bounds);
        let line = format!(
            "compare {{0}} --solvers conic-bounded --set conic-bounded.bounds={bounds} --seeds 6 -o {{1}}"
        );
        gough(&line, &[&file("problems/serial-scara.json"), &out]);
        for line in lines(&out) {
            assert!(verified(&line), "{bounds}: {line}");
            let excluded =
                !line["score"]["objective"].is_null() && line["score"]["objective_reference"].is_null();
            some |= excluded;
            assert_eq!(line["verified"]["prediction"].is_null(), excluded, "{line}");
        }
    }
    assert!(some);
}

#[test]
fn tables_hold_whole_intervals_and_profiles() {
    let folder = tempfile::tempdir().unwrap();
    done(
        "compare {0} --solvers minimal,map --seeds 3 -o {1}",
        &[&file("problems/serial-scara.json"), folder.path()],
    );
    for table in ["by-problem.csv", "claims.csv", "by-accuracy.csv", "runs.csv"] {
        let text = fs::read_to_string(folder.path().join(table)).unwrap();
        let header = csv::Reader::from_reader(text.as_bytes()).headers().unwrap().clone();
        let mut names: Vec<&str> = header.iter().collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), header.len(), "{table}: {header:?}");
    }
    let text = fs::read_to_string(folder.path().join("by-problem.csv")).unwrap();
    let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
    let column = |name: &str| rows[0].iter().position(|found| found.trim_matches('"') == name).expect(name);
    let [low, high] = ["position: quartile 1", "position: quartile 3"].map(column);
    for row in &rows[1..] {
        let number = |at: usize| row[at].parse::<f64>().unwrap();
        assert!(number(low) <= number(high), "{row:?}");
    }
    for profile in ["performance-evaluations.csv", "performance-time.csv", "data-profile.csv"] {
        let text = fs::read_to_string(folder.path().join(profile)).unwrap();
        assert!(text.starts_with("series,x,y") && text.contains("minimal,"), "{profile}: {text}");
    }
}

/// A problem whose content changed since does not go into the old folder: its lines could not be merged.
#[test]
fn a_changed_problem_needs_a_folder_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let mut problem = json(&file("problems/serial-scara.json"));
    let path = write(folder.path(), "p.json", &problem);
    let line = "compare {0} --solvers minimal --seeds 1 -o {1}";
    done(line, &[&path, &out]);
    let before = fs::read(out.join("runs.jsonl")).unwrap();
    problem["data"]["noise"] = value!({ "angle": 1e-3, "length": 1e-3 });
    write(folder.path(), "p.json", &problem);
    let ran = gough(line, &[&path, &out]);
    assert_eq!(ran.status, 2, "{ran:?}");
    for part in ["runs.jsonl", "content of problem", "folder of its own"] {
        assert!(ran.stderr.contains(part), "{part}: {}", ran.stderr);
    }
    assert_eq!(fs::read(out.join("runs.jsonl")).unwrap(), before);
}
