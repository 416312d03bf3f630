//! Data that other people measured or published. They are not part of the crate: without them the tests say so and
//! skip (docs/real-data.md names the sources).

mod shared;
mod support;

use serde_json::{Value, json};
use std::path::Path;
use support::{Errors, Pose, command, done, errors, file, pose, poses, ran, write};

/// Columns of the test rows of a table, by name.
fn test_rows(table: &Path, columns: &[&str]) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(table).unwrap();
    let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let head = lines.next().unwrap();
    let at = |name: &str| head.iter().position(|column| *column == name).unwrap_or_else(|| panic!("{name}"));
    let (split, columns): (usize, Vec<usize>) = (at("split"), columns.iter().map(|name| at(name)).collect());
    let rows: Vec<Vec<f64>> = lines
        .filter(|row| row[split] == "test")
        .map(|row| columns.iter().map(|column| row[*column].parse().unwrap()).collect())
        .collect();
    assert!(rows.len() > 20);
    rows
}

/// Poses of rows x, y, z (mm), qw, qx, qy, qz.
fn measured(table: &Path, columns: [&str; 7]) -> Vec<Pose> {
    let pose_of = |row: &Vec<f64>| pose(&json!({"position": row[..3], "quaternion": row[3..]}), (1e-3, 1.0));
    test_rows(table, &columns).iter().map(pose_of).collect()
}

/// Errors of the problem's machine and of the identified one on the test rows, mm and rad; and the result.
fn before_and_after(
    problem: &str,
    data: &Path,
    readings: &[Vec<f64>],
    truth: &[Pose],
) -> (Errors, Errors, Value) {
    let folder = tempfile::tempdir().unwrap();
    let (problem, out) = (file(problem), folder.path().join("result.json"));
    let ran = ran(command().arg("identify").arg(&problem).arg("--data-dir").arg(data).arg("-o").arg(&out));
    assert!(ran.status == 0, "{ran:?}");
    eprintln!("{}", ran.stdout);
    let samples: Vec<Value> = readings.iter().map(|row| json!({"actuators": row})).collect();
    let readings = write(folder.path(), "readings.json", &json!({"samples": samples}));
    let score = |model: &Path| {
        let ran = done("predict {0} --actuators {1}", &[model, &readings]);
        let predicted = poses(&serde_json::from_str(&ran.stdout).unwrap(), (1e-3, 1.0));
        let found = errors(&predicted, truth);
        Errors { position_rms: found.position_rms * 1e3, position_max: found.position_max * 1e3, ..found }
    };
    (score(&problem), score(&out), support::json(&out))
}

/// A camera on the arm, base and tool anywhere: 114 poses, those of the test rows never used.
#[test]
fn franka_fr3() {
    let Some(data) = shared::directory("data") else { return };
    let table = data.join("franka_fr3_eye_in_hand/data.csv");
    let names: Vec<String> = (1..=7).map(|i| format!("q{i}_rad")).collect();
    let readings = test_rows(&table, &names.iter().map(String::as_str).collect::<Vec<_>>());
    let truth = measured(&table, ["x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz"]);
    let (_, after, result) = before_and_after("problems/real/franka-fr3.json", &data, &readings, &truth);
    eprintln!("franka-fr3: {:.3} mm rms on the test rows", after.position_rms);
    assert!(after.position_rms <= 1.6, "{after:?}");
    // What the report says of the hold-out is what the result predicts.
    let reported = result["holdout"]["after"]["position_rms"].as_f64().unwrap();
    assert!((reported - after.position_rms).abs() < 1e-9, "{reported} {after:?}");
    assert_eq!(result["converged"], true);
}

/// Published nominal and true tables; poses simulated from the true one with 0.01 mm, which the truth has not.
#[test]
fn hexapod_of_nategh_and_agheli() {
    let Some(data) = shared::directory("data") else { return };
    let table = data.join("simulated_hexapod_nategh_agheli/data.csv");
    let names: Vec<String> = (1..=6).map(|i| format!("dl{i}_mm")).collect();
    let readings = test_rows(&table, &names.iter().map(String::as_str).collect::<Vec<_>>());
    let columns = ["x_true_mm", "y_true_mm", "z_true_mm", "qw_true", "qx_true", "qy_true", "qz_true"];
    let truth = measured(&table, columns);
    let problem = "problems/real/hexapod-nategh-agheli.json";
    let (before, after, result) = before_and_after(problem, &data, &readings, &truth);
    eprintln!("nategh-agheli: {:.2} -> {:.4} mm rms", before.position_rms, after.position_rms);
    assert!((before.position_rms - 44.4).abs() < 0.1, "{before:?}");
    assert!(after.position_rms <= 0.01, "{after:?}");
    assert_eq!(result["converged"], true);
}
