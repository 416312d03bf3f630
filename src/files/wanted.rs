//! Wanted poses, and the actuator readings that lead to them.

use super::bytes::{first_byte, read_bytes};
use super::error::FileError;
use super::fault::Fault;
use super::json;
use super::place::Place;
use super::pose::PoseDrawing;
use super::poses::{PosesFormat, poses_text};
use super::problem::Model;
use super::readings::variables;
use super::table::{self, OtherColumns, PoseColumns, TableRequest};
use super::units::Units;
use crate::lie::Se3;
use nalgebra::Vector6;
use serde::{Deserialize, Serialize};
use std::io;
use std::path::Path;

/// A pose to be commanded.
#[derive(Clone, Debug, PartialEq)]
pub struct WantedPose {
    /// `sample 12`, or `poses.csv line 14`.
    pub name: String,
    /// The pose, rad and m.
    pub pose: Se3,
    /// Joint variables (reading - home, rad or m) near which to seek, where the file gives readings.
    pub near: Option<Vec<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WantedFile {
    samples: Vec<Wanted>,
}

/// Other keys are left aside, so that predicted poses can be read too.
#[derive(Deserialize)]
struct Wanted {
    pose: PoseDrawing,
    #[serde(default)]
    actuators: Option<Vec<f64>>,
}

/// Reads the poses of `path` for `model`, whose units govern it: CSV, or JSON with `samples`. A file that begins with a
/// brace is JSON. Without `turned` positions are enough: rotations are left aside, and poses have that of home.
pub fn read_wanted(path: &Path, model: &Model, turned: bool) -> Result<Vec<WantedPose>, FileError> {
    let file = path.display().to_string();
    let is_json = |bytes: &[u8]| {
        matches!(first_byte(bytes), Some(b'{' | b'['))
            || path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"))
    };
    let bytes = read_bytes(path, |beginning| match is_json(beginning) {
        true => json::check_beginning(&file, beginning),
        false => table::check_beginning(&file, beginning),
    })?;
    if is_json(&bytes) {
        return from_json(&file, &bytes, model, turned).map_err(how_to_do_without);
    }
    let short = path.file_name().map_or_else(|| file.clone(), |name| name.to_string_lossy().into_owned());
    from_table(&file, &short, &bytes, model, turned).map_err(how_to_do_without)
}

/// Positions alone are commanded where rotations are given up.
fn how_to_do_without(mut why: FileError) -> FileError {
    if matches!(why.fault, Fault::NoRotation | Fault::NoDrawnRotation) {
        why.fault = Fault::NoWantedRotation;
    }
    why
}

/// The pose that is wanted.
fn wanted_pose(drawing: &PoseDrawing, model: &Model, turned: bool, at: &Place<'_>) -> Result<Se3, FileError> {
    if turned {
        return drawing.complete(model.units, at);
    }
    let seen = drawing.position_only(model.units, at)?;
    if seen.position != [true; 3] {
        return Err(at.error(Fault::Incomplete));
    }
    let home = model.mechanism.nominal().home_frames(0).pop().unwrap_or_else(Se3::identity);
    Ok(Se3 { r: home.r, ..seen.pose })
}

fn from_json(file: &str, bytes: &[u8], model: &Model, turned: bool) -> Result<Vec<WantedPose>, FileError> {
    let content: WantedFile = json::parse(file, bytes)?;
    let whole = Place::file(file);
    let list = whole.key("samples");
    if content.samples.is_empty() {
        return Err(list.error(Fault::NoRows(String::new())));
    }
    let mut wanted = Vec::with_capacity(content.samples.len());
    for (i, sample) in content.samples.into_iter().enumerate() {
        let name = format!("sample {}", i + 1);
        let entry = list.index(i);
        let here = entry.named(&name);
        let pose = wanted_pose(&sample.pose, model, turned, &here.key("pose"))?;
        let near = sample
            .actuators
            .map(|readings| variables(&model.mechanism, model.units, &readings, &here.key("actuators")))
            .transpose()?;
        wanted.push(WantedPose { name: name.clone(), pose, near });
    }
    Ok(wanted)
}

fn from_table(
    file: &str,
    short: &str,
    bytes: &[u8],
    model: &Model,
    turned: bool,
) -> Result<Vec<WantedPose>, FileError> {
    let names = model.mechanism.actuator_names();
    let parse = |actuators: &[String]| {
        let others = OtherColumns::default();
        let poses = if turned { PoseColumns::Complete } else { PoseColumns::Position };
        let request = TableRequest { actuators, columns: None, filter: None, poses, others };
        table::parse(file, bytes, &request)
    };
    let (table, has_readings) = match parse(&names) {
        Ok(table) => (table, true),
        // Readings are not asked for. Where they are there, the first error is the one to tell.
        Err(first) => match parse(&[]) {
            Ok(table) => (table, false),
            Err(FileError { fault: Fault::UnknownColumn { .. }, .. }) => return Err(first),
            Err(second) => return Err(second),
        },
    };
    let whole = Place::file(file);
    let mut wanted = Vec::with_capacity(table.len());
    for row in table {
        let line = whole.line(row.line);
        let near = has_readings
            .then(|| variables(&model.mechanism, model.units, &row.readings, &line))
            .transpose()?;
        wanted.push(WantedPose {
            name: format!("{short} line {}", row.line),
            pose: wanted_pose(&row.pose, model, turned, &line)?,
            near,
        });
    }
    Ok(wanted)
}

/// Readings for one wanted pose.
#[derive(Clone, Debug, PartialEq)]
pub struct CommandedPose {
    /// Readings in units of the file.
    pub readings: Vec<f64>,
    /// The pose that they lead to, rad and m.
    pub pose: Se3,
    /// From there to the wanted pose, rotation first, rad and m.
    pub residual: Vector6<f64>,
}

#[derive(Serialize)]
struct CommandedFile<'a> {
    samples: Vec<CommandedSample<'a>>,
}

#[derive(Serialize)]
struct CommandedSample<'a> {
    actuators: &'a [f64],
    pose: PoseDrawing,
    residual: Residual,
}

#[derive(Serialize)]
struct Residual {
    rotation: [f64; 3],
    position: [f64; 3],
}

/// The file of commands: CSV with a column for each actuator and the pose that is reached, or JSON, where each sample has
/// also its `residual` (rotation vector and displacement from the reached to the wanted pose).
pub fn commands_text(
    format: PosesFormat,
    actuators: &[String],
    commands: &[CommandedPose],
    units: Units,
) -> io::Result<Vec<u8>> {
    match format {
        PosesFormat::Csv => {
            let poses: Vec<(Vec<f64>, Se3)> = commands.iter().map(|c| (c.readings.clone(), c.pose)).collect();
            poses_text(format, actuators, &poses, units)
        }
        PosesFormat::Json => {
            let sample = |c: &'_ CommandedPose| {
                let r = &c.residual;
                Residual {
                    rotation: [r[0], r[1], r[2]].map(|v| units.from_radians(v)),
                    position: [r[3], r[4], r[5]].map(|v| units.from_metres(v)),
                }
            };
            let samples = commands.iter().map(|c| CommandedSample {
                actuators: &c.readings,
                pose: PoseDrawing::of(&c.pose, units),
                residual: sample(c),
            });
            Ok(json::text(&CommandedFile { samples: samples.collect() })?)
        }
    }
}
