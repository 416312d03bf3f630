//! Data that other people measured or published. They are not part of the crate: without them the tests
//! are ignored (docs/real-data.md names the sources).

mod shared;
mod support;

use nalgebra::Vector3;
use serde_json::{Value, json};
use std::path::Path;
use support::{Errors, Pose, command, done, errors, file, numbers, pose, poses, ran, write};

/// Columns of the rows of a table that have these texts in these columns.
fn rows_where(table: &Path, wanted: &[(&str, &str)], columns: &[&str]) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(table).unwrap();
    let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let head = lines.next().unwrap();
    let at = |name: &str| head.iter().position(|column| *column == name).unwrap_or_else(|| panic!("{name}"));
    let columns: Vec<usize> = columns.iter().map(|name| at(name)).collect();
    let wanted: Vec<(usize, &str)> = wanted.iter().map(|(name, text)| (at(name), *text)).collect();
    lines
        .filter(|row| wanted.iter().all(|(column, text)| row[*column] == *text))
        .map(|row| columns.iter().map(|column| row[*column].parse().unwrap()).collect())
        .collect()
}

/// Columns of the test rows of a table, by name.
fn test_rows(table: &Path, columns: &[&str]) -> Vec<Vec<f64>> {
    let rows = rows_where(table, &[("split", "test")], columns);
    assert!(rows.len() > 20);
    rows
}

/// Poses of rows x, y, z (mm), qw, qx, qy, qz.
fn measured(table: &Path, columns: [&str; 7]) -> Vec<Pose> {
    let pose_of = |row: &Vec<f64>| pose(&json!({"position": row[..3], "quaternion": row[3..]}), (1e-3, 1.0));
    test_rows(table, &columns).iter().map(pose_of).collect()
}

/// The result of `gough identify` with these further arguments, and what it said on stderr.
fn identified(problem: &str, data: &Path, arguments: &str, out: &Path) -> (Value, String) {
    let mut run = command();
    run.arg("identify").arg(file(problem)).arg("--data-dir").arg(data).arg("-o").arg(out);
    let ran = ran(run.args(arguments.split_whitespace()));
    assert!(ran.status == 0, "{ran:?}");
    eprintln!("{}", ran.stdout);
    let result = support::json(out);
    assert_eq!(result["converged"], true);
    (result, ran.stderr)
}

/// Tool poses, mm and rad, that a machine predicts at these readings.
fn predicted(model: &Path, readings: &[Vec<f64>]) -> Vec<Pose> {
    let folder = tempfile::tempdir().unwrap();
    let samples: Vec<Value> = readings.iter().map(|row| json!({"actuators": row})).collect();
    let readings = write(folder.path(), "readings.json", &json!({"samples": samples}));
    let ran = done("predict {0} --actuators {1}", &[model, &readings]);
    let predicted = serde_json::from_str(&ran.stdout).unwrap();
    poses(&predicted, (1.0, support::units(&support::json(model)).1))
}

/// Errors of the problem's machine and of the identified one on the test rows, mm and rad; and the result.
fn before_and_after(
    problem: &str,
    data: &Path,
    readings: &[Vec<f64>],
    truth: &[Pose],
) -> (Errors, Errors, Value) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("result.json");
    let (result, _) = identified(problem, data, "", &out);
    let score = |model: &Path| {
        let seen = predicted(model, readings).into_iter().map(|pose| Pose { p: pose.p * 1e-3, ..pose });
        let found = errors(&seen.collect::<Vec<_>>(), truth);
        Errors { position_rms: found.position_rms * 1e3, position_max: found.position_max * 1e3, ..found }
    };
    (score(&file(problem)), score(&out), result)
}

/// A camera on the arm, base and tool anywhere: 114 poses, those of the test rows never used.
#[test]
#[cfg_attr(not(shared_data), ignore = "no folder data in GOUGH_SHARED (default ../shared)")]
fn franka_fr3() {
    let data = shared::directory("data");
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
}

/// Published nominal and true tables; poses simulated from the true one with 0.01 mm, which the truth has not.
#[test]
#[cfg_attr(not(shared_data), ignore = "no folder data in GOUGH_SHARED (default ../shared)")]
fn hexapod_of_nategh_and_agheli() {
    let data = shared::directory("data");
    let table = data.join("simulated_hexapod_nategh_agheli/data.csv");
    let names: Vec<String> = (1..=6).map(|i| format!("dl{i}_mm")).collect();
    let readings = test_rows(&table, &names.iter().map(String::as_str).collect::<Vec<_>>());
    let columns = ["x_true_mm", "y_true_mm", "z_true_mm", "qw_true", "qx_true", "qy_true", "qz_true"];
    let truth = measured(&table, columns);
    let problem = "problems/real/hexapod-nategh-agheli.json";
    let (before, after, _) = before_and_after(problem, &data, &readings, &truth);
    eprintln!("nategh-agheli: {:.2} -> {:.4} mm rms", before.position_rms, after.position_rms);
    assert!((before.position_rms - 44.4).abs() < 0.1, "{before:?}");
    assert!(after.position_rms <= 0.01, "{after:?}");
}

/// Root mean square and mean distance, mm, between the reflector of an identified arm and where the tracker saw it.
fn tracked(problem: &str, data: &str, joints: usize) -> [(f64, f64); 2] {
    let data_dir = shared::directory("data");
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("result.json");
    let (result, warned) = identified(problem, &data_dir, "", &out);
    // What the joints do beyond the model is seen.
    assert!(
        warned.lines().count() == 1
            && warned.contains("errors follow the reading of")
            && warned.contains("arm.joint"),
        "{warned}"
    );
    let offset: Vec<f64> = (0..3).map(|i| result["instrument"][i]["value"].as_f64().unwrap()).collect();
    let mut columns: Vec<String> = (1..=joints).map(|i| format!("q{i}_rad")).collect();
    columns.extend(["x_mm", "y_mm", "z_mm"].map(str::to_owned));
    let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
    let scores = ["test", "extra_test"].map(|split| {
        let rows = rows_where(&data_dir.join(data), &[("split", split)], &columns);
        assert!(rows.len() >= 20);
        let readings: Vec<Vec<f64>> = rows.iter().map(|row| row[..joints].to_vec()).collect();
        let apart = predicted(&out, &readings).into_iter().zip(&rows).map(|(pose, row)| {
            let at = pose.r * Vector3::from_column_slice(&offset) + pose.p;
            (at - Vector3::from_column_slice(&row[joints..])).norm()
        });
        let apart: Vec<f64> = apart.collect();
        let count = apart.len() as f64;
        let rms = (apart.iter().map(|e| e * e).sum::<f64>() / count).sqrt();
        (rms, apart.iter().sum::<f64>() / count)
    });
    // What the report says of the hold-out is what the result predicts.
    let reported = result["holdout"]["after"]["position_rms"].as_f64().unwrap();
    assert!((reported - scores[0].0).abs() < 1e-9, "{reported} {scores:?}");
    eprintln!("{problem}: rms and mean on test and extra_test rows, mm: {scores:?}");
    scores
}

/// A laser tracker and one reflector: published 0.155 mm mean.
#[test]
#[cfg_attr(not(shared_data), ignore = "no folder data in GOUGH_SHARED (default ../shared)")]
fn ur5() {
    let table = "jacobi_ur5_laser_tracker/data.csv";
    let [test, extra] = tracked("problems/real/ur5.json", table, 6);
    assert!(test.0 <= 0.1129 && test.1 <= 0.103, "{test:?}");
    assert!(extra.1 <= 0.103, "{extra:?}");
}

/// The same on a cable-driven arm, whose joints give way: published 2.918 mm mean, reference fit 2.190 mm.
#[test]
#[cfg_attr(not(shared_data), ignore = "no folder data in GOUGH_SHARED (default ../shared)")]
fn wam() {
    let table = "jacobi_wam_laser_tracker/data.csv";
    let [test, extra] = tracked("problems/real/wam.json", table, 7);
    assert!(test.0 <= 2.4517 && test.1 <= 2.190, "{test:?}");
    assert!(extra.0 <= 3.2604, "{extra:?}");
}

/// Sizes of errors, mm: heights and distances.
struct Delta {
    data: &'static str,
    session: &'static str,
    /// Residuals of the firmware's own fit.
    firmware: [f64; 2],
    /// Leave-one-out of an unregularised fit of the firmware's nine parameters.
    left_out: Option<[f64; 2]>,
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let squares: Vec<f64> = values.map(|v| v * v).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// A printer's own record: heights and distances fit better than its firmware's, predict better what was left out, and
/// rods stay near 345 mm.
fn delta(known: &Delta) {
    let data = shared::directory("data");
    let (folder, session) = (tempfile::tempdir().unwrap(), known.session);
    let out = folder.path().join("result.json");
    let problem = format!("problems/real/delta-v400-{session}.json");
    let (result, warned) = identified(&problem, &data, "--cross-validate loo", &out);
    for part in ["a plane fixes {S} in height", "readings for 61 parameters"] {
        assert!(warned.contains(part), "{warned}");
    }
    let bed = result["instrument"][0]["value"].as_f64().unwrap();
    let table = data.join(known.data);
    let (q1, q2) = (["q1a_mm", "q1b_mm", "q1c_mm"], ["q2a_mm", "q2b_mm", "q2c_mm"]);
    let rows = |kind, columns: &[&str]| rows_where(&table, &[("session", session), ("kind", kind)], columns);
    let at = |kind, columns| predicted(&out, &rows(kind, columns)).into_iter().map(|pose| pose.p);
    let values = |kind| rows(kind, &["value_mm"]).into_iter().map(|row| row[0]);
    let heights = rms(at("height", &q1[..]).zip(values("height")).map(|(p, value)| p.z - bed - value));
    assert!(heights <= known.firmware[0], "{session}: {heights}");
    let reported = &result["fit"]["after"];
    assert!((reported["plane_rms"].as_f64().unwrap() - heights).abs() < 1e-9);
    let left_out = &result["cross_validation"]["errors"];
    if let Some(limits) = known.left_out {
        let pairs = at("distance", &q1[..]).zip(at("distance", &q2[..])).zip(values("distance"));
        let distances = rms(pairs.map(|((a, b), value)| (a - b).norm() - value));
        assert!(distances <= known.firmware[1], "{session}: {distances}");
        assert!((reported["distance_rms"].as_f64().unwrap() - distances).abs() < 1e-9);
        for (key, limit) in ["plane_rms", "distance_rms"].into_iter().zip(limits) {
            assert!(left_out[key].as_f64().unwrap() <= limit, "{session} {key}: {left_out}");
        }
    }
    for limb in result["mechanism"]["limbs"].as_array().unwrap() {
        let point = |joint: usize| Vector3::from_column_slice(&numbers(&limb["joints"][joint]["point"]));
        let rod = (point(3) - point(2)).norm();
        assert!((rod - 345.0).abs() < 1.25, "{session}: {rod}");
    }
}

#[test]
#[cfg_attr(not(shared_data), ignore = "no folder data in GOUGH_SHARED (default ../shared)")]
fn linear_deltas() {
    let fzechert = "v400_delta_fzechert/data.csv";
    let known = [
        (fzechert, "fc59bb0f", [0.0342, 0.0664], Some([0.1329, 0.1034])),
        (fzechert, "d28faffe", [0.0280, 0.0552], Some([0.1062, 0.0860])),
        (fzechert, "996d845b", [0.0041, 0.0], None),
        (fzechert, "e980adcc", [0.0063, 0.0], None),
        ("v400_delta_phnxdrgn/data.csv", "491e4ed6", [0.0183, 0.0356], Some([0.0612, 0.0540])),
    ];
    for (data, session, firmware, left_out) in known {
        delta(&Delta { data, session, firmware, left_out });
    }
}
