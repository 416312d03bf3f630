//! Predicted poses, written as JSON or CSV in units of the model's file.

use super::json;
use super::pose::PoseDrawing;
use super::units::Units;
use crate::cells::inert;
use crate::lie::Se3;
use nalgebra::Matrix6;
use serde::Serialize;
use std::io;
use std::path::Path;

/// Format of a file of poses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PosesFormat {
    /// `{"samples": [{"actuators": ..., "pose": ...}]}`
    #[default]
    Json,
    /// One column per actuator, then x, y, z, rx, ry, rz; with uncertainty also sx, sy, sz, srx, sry, srz.
    Csv,
}

impl PosesFormat {
    /// By the extension: `csv`, and JSON for all others.
    pub fn of(path: &Path) -> Self {
        match path.extension() {
            Some(extension) if extension.eq_ignore_ascii_case("csv") => Self::Csv,
            _ => Self::Json,
        }
    }
}

#[derive(Serialize)]
struct PosesFile<'a> {
    samples: Vec<PoseSample<'a>>,
}

#[derive(Serialize)]
struct PoseSample<'a> {
    actuators: &'a [f64],
    pose: PoseDrawing,
    #[serde(skip_serializing_if = "Option::is_none")]
    std: Option<PoseStd>,
    #[serde(skip_serializing_if = "Option::is_none")]
    covariance: Option<[[f64; 6]; 6]>,
}

/// Standard deviations of a pose, per component: {S} axes, displacement of the tool point, rotation vector of the error.
#[derive(Clone, Copy, Serialize)]
struct PoseStd {
    position: [f64; 3],
    rotation: [f64; 3],
}

impl PoseStd {
    fn of(covariance: &Matrix6<f64>, units: Units) -> Self {
        let sigma = |i: usize| covariance[(i, i)].max(0.0).sqrt();
        Self {
            position: [3, 4, 5].map(|i| units.from_metres(sigma(i))),
            rotation: [0, 1, 2].map(|i| units.from_radians(sigma(i))),
        }
    }
}

/// The file of poses (rad and m), each with its readings in units of the file, by actuators of these names.
pub fn poses_text(
    format: PosesFormat,
    actuators: &[String],
    poses: &[(Vec<f64>, Se3)],
    units: Units,
) -> io::Result<Vec<u8>> {
    text(format, actuators, poses, None, units)
}

/// The same with the covariance of each pose error `[w; dp]` (rad and m, {S} axes): in JSON `std` and `covariance` (rotation
/// first), in CSV the standard deviations `sx, sy, sz, srx, sry, srz`.
pub fn uncertain_poses_text(
    format: PosesFormat,
    actuators: &[String],
    poses: &[(Vec<f64>, Se3)],
    covariances: &[Matrix6<f64>],
    units: Units,
) -> io::Result<Vec<u8>> {
    text(format, actuators, poses, Some(covariances), units)
}

fn text(
    format: PosesFormat,
    actuators: &[String],
    poses: &[(Vec<f64>, Se3)],
    covariances: Option<&[Matrix6<f64>]>,
    units: Units,
) -> io::Result<Vec<u8>> {
    let covariance = |k: usize| covariances.and_then(|all| all.get(k));
    match format {
        PosesFormat::Json => {
            let samples = poses.iter().enumerate().map(|(k, (readings, pose))| PoseSample {
                actuators: readings,
                pose: PoseDrawing::of(pose, units),
                std: covariance(k).map(|c| PoseStd::of(c, units)),
                covariance: covariance(k).map(|c| units.from_covariance(c)),
            });
            Ok(json::text(&PosesFile { samples: samples.collect() })?)
        }
        PosesFormat::Csv => {
            let mut writer = csv::Writer::from_writer(Vec::new());
            let pose_names = ["x", "y", "z", "rx", "ry", "rz"];
            let std_names = ["sx", "sy", "sz", "srx", "sry", "srz"];
            let std_names = std_names.iter().copied().filter(|_| covariances.is_some());
            let names = actuators.iter().map(String::as_str).chain(pose_names).chain(std_names);
            writer.write_record(names.map(|name| inert(name).into_owned()))?;
            for (k, (readings, pose)) in poses.iter().enumerate() {
                let (position, rotation) = units.from_pose(pose);
                let mut row: Vec<f64> = readings.iter().copied().chain(position).chain(rotation).collect();
                if let Some(covariance) = covariance(k) {
                    let std = PoseStd::of(covariance, units);
                    row.extend(std.position.into_iter().chain(std.rotation));
                }
                writer.serialize(row)?;
            }
            writer.into_inner().map_err(|error| error.into_error())
        }
    }
}
