//! Predicted poses, written as JSON or CSV in units of the model's file.

use super::json;
use super::pose::PoseDrawing;
use super::units::Units;
use crate::lie::Se3;
use serde::Serialize;
use std::io;
use std::path::Path;

/// Format of a file of poses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PosesFormat {
    /// `{"samples": [{"actuators": ..., "pose": ...}]}`
    #[default]
    Json,
    /// One column per actuator, then x, y, z, rx, ry, rz.
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
}

/// The file of poses (rad and m), each with its readings in units of the file, by actuators of these names.
pub fn poses_text(
    format: PosesFormat,
    actuators: &[String],
    poses: &[(Vec<f64>, Se3)],
    units: Units,
) -> io::Result<Vec<u8>> {
    match format {
        PosesFormat::Json => {
            let samples = poses.iter().map(|(readings, pose)| PoseSample {
                actuators: readings,
                pose: PoseDrawing::of(pose, units),
            });
            Ok(json::text(&PosesFile { samples: samples.collect() })?)
        }
        PosesFormat::Csv => {
            let mut writer = csv::Writer::from_writer(Vec::new());
            let names = actuators.iter().map(String::as_str).chain(["x", "y", "z", "rx", "ry", "rz"]);
            writer.write_record(names)?;
            for (readings, pose) in poses {
                let (position, rotation) = units.from_pose(pose);
                let row: Vec<f64> = readings.iter().copied().chain(position).chain(rotation).collect();
                writer.serialize(row)?;
            }
            writer.into_inner().map_err(|error| error.into_error())
        }
    }
}
