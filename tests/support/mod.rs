//! What several of the acceptance tests need: the command, the files of the repository, poses as nalgebra reads them.

// Each test file is a crate of its own and uses a part of this.
#![allow(dead_code)]

use assert_cmd::Command;
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::time::Duration;

pub const GOLDEN: [&str; 4] = ["hexapod-6ups", "hexapod-6pus", "serial-6r", "tripod-3rps"];

/// Figures of a comparison on serial-puma560 and serial-scara, at two noises from two starts.
pub const COMPARISON_FIGURES: [&str; 9] = [
    "success",
    "performance-evaluations",
    "performance-time",
    "data-profile",
    "accuracy-time",
    "consistency",
    "success-start",
    "error-noise-serial-puma560",
    "error-noise-serial-scara",
];

/// A file of the repository.
pub fn file(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

pub fn golden(case: &str, name: &str) -> PathBuf {
    file("tests/data/golden").join(case).join(name)
}

/// The drawings of problems/ that bring their own data, by name.
pub fn problems() -> Vec<PathBuf> {
    let entries = std::fs::read_dir(file("problems")).unwrap().map(|entry| entry.unwrap().path());
    let is_problem = |path: &PathBuf| path.extension().is_some_and(|extension| extension == "json");
    let mut paths: Vec<PathBuf> = entries.filter(is_problem).collect();
    paths.sort();
    assert!(paths.len() >= 20);
    paths
}

pub fn name(path: &Path) -> String {
    path.file_stem().unwrap().to_string_lossy().into_owned()
}

pub fn json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

pub fn write(folder: &Path, name: &str, value: &Value) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, value.to_string()).unwrap();
    path
}

/// What a run of the command left.
#[derive(Debug)]
pub struct Ran {
    pub status: i32,
    pub stdout: String,
    pub stderr: String,
}

pub fn command() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gough"));
    command.timeout(Duration::from_secs(20)).env("GOUGH_SHARED", "no such folder");
    command
}

pub fn ran(command: &mut Command) -> Ran {
    let output = command.output().unwrap();
    Ran {
        status: output.status.code().unwrap_or(-1),
        stdout: String::from_utf8(output.stdout).unwrap(),
        stderr: String::from_utf8(output.stderr).unwrap(),
    }
}

/// Runs `gough`; blanks divide the arguments, paths are `{0}`, `{1}`...
pub fn gough(line: &str, paths: &[&Path]) -> Ran {
    let arguments = line.split_whitespace().map(|word| {
        let index = word.strip_prefix('{').and_then(|rest| rest.strip_suffix('}'));
        index.map_or_else(
            || word.into(),
            |index| paths[index.parse::<usize>().unwrap()].as_os_str().to_owned(),
        )
    });
    ran(command().args(arguments))
}

/// The same, and it must have succeeded.
#[track_caller]
pub fn done(line: &str, paths: &[&Path]) -> Ran {
    let ran = gough(line, paths);
    assert!(ran.status == 0 && ran.stderr.is_empty(), "{line} {paths:?}: {ran:?}");
    ran
}

/// A pose in rad and m.
#[derive(Clone, Copy, Debug)]
pub struct Pose {
    pub r: Matrix3<f64>,
    pub p: Vector3<f64>,
}

/// Lengths (m) and angles (rad) of one unit of the file.
pub fn units(file: &Value) -> (f64, f64) {
    let is = |key: &str, name: &str| file["units"][key].as_str().unwrap() == name;
    (if is("length", "mm") { 1e-3 } else { 1.0 }, if is("angle", "deg") { 1f64.to_radians() } else { 1.0 })
}

pub fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

pub fn pose(value: &Value, (length, angle): (f64, f64)) -> Pose {
    let p = Vector3::from_column_slice(&numbers(&value["position"])) * length;
    let r = match value.get("quaternion") {
        Some(q) => {
            let q = numbers(q);
            UnitQuaternion::from_quaternion(Quaternion::new(q[0], q[1], q[2], q[3])).to_rotation_matrix()
        }
        None => Rotation3::from_scaled_axis(Vector3::from_column_slice(&numbers(&value["rotation"])) * angle),
    };
    Pose { r: r.into_inner(), p }
}

/// The poses of `samples`, as one finds them in data, hold-outs and predictions.
pub fn poses(samples: &Value, units: (f64, f64)) -> Vec<Pose> {
    samples["samples"].as_array().unwrap().iter().map(|sample| pose(&sample["pose"], units)).collect()
}

/// Angle (rad) and distance (m) between two poses, exact where they are small.
pub fn apart(a: &Pose, b: &Pose) -> (f64, f64) {
    let r = a.r * b.r.transpose();
    let sine = Vector3::new(r[(2, 1)] - r[(1, 2)], r[(0, 2)] - r[(2, 0)], r[(1, 0)] - r[(0, 1)]).norm() / 2.0;
    (sine.atan2((r.trace() - 1.0) / 2.0), (a.p - b.p).norm())
}

/// Sizes of angles (rad) and distances (m) between poses in pairs.
#[derive(Clone, Copy, Debug, Default)]
pub struct Errors {
    pub rotation_rms: f64,
    pub rotation_max: f64,
    pub position_rms: f64,
    pub position_max: f64,
}

#[track_caller]
pub fn errors(a: &[Pose], b: &[Pose]) -> Errors {
    assert_eq!(a.len(), b.len());
    let pairs: Vec<(f64, f64)> = a.iter().zip(b).map(|(a, b)| apart(a, b)).collect();
    let rms = |of: fn(&(f64, f64)) -> f64| {
        (pairs.iter().map(|pair| of(pair).powi(2)).sum::<f64>() / pairs.len() as f64).sqrt()
    };
    let max = |of: fn(&(f64, f64)) -> f64| pairs.iter().map(of).fold(0.0, f64::max);
    Errors {
        rotation_rms: rms(|pair| pair.0),
        rotation_max: max(|pair| pair.0),
        position_rms: rms(|pair| pair.1),
        position_max: max(|pair| pair.1),
    }
}
