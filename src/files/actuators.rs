//! Actuator readings to predict with: CSV, or JSON with `samples`.

use super::columns::ColumnsDrawing;
use super::error::FileError;
use super::fault::Fault;
use super::json;
use super::place::Place;
use super::problem::Model;
use super::readings::variables;
use super::table::{PoseColumns, TableRequest, read_table};
use serde::Deserialize;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Readings of one posture.
#[derive(Clone, Debug, PartialEq)]
pub struct ActuatorRow {
    /// `sample 12`, or `data.csv line 14`.
    pub name: String,
    /// As written, in actuator order and units of the model's file.
    pub readings: Vec<f64>,
    /// Joint variables, reading - home, rad or m.
    pub variables: Vec<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ActuatorFile {
    samples: Vec<Readings>,
}

/// Other keys are left aside, so that measured samples and predicted poses can be read too.
#[derive(Deserialize)]
struct Readings {
    actuators: Vec<f64>,
}

/// Reads the postures of `path` for `model`, whose units govern it. A file that begins with a brace is JSON.
pub fn read_actuators(path: &Path, model: &Model) -> Result<Vec<ActuatorRow>, FileError> {
    if begins_as_json(path)? { from_json(path, model) } else { from_table(path, model) }
}

fn begins_as_json(path: &Path) -> Result<bool, FileError> {
    let fail = |why| FileError::whole(path.display().to_string(), Fault::Read(why));
    let mut beginning = Vec::new();
    File::open(path).map_err(fail)?.take(256).read_to_end(&mut beginning).map_err(fail)?;
    let text = beginning.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&beginning);
    let json = matches!(text.iter().find(|byte| !byte.is_ascii_whitespace()), Some(b'{' | b'['));
    Ok(json || path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json")))
}

fn from_json(path: &Path, model: &Model) -> Result<Vec<ActuatorRow>, FileError> {
    let file = path.display().to_string();
    let content: ActuatorFile = json::parse(&file, &json::read_bytes(path)?)?;
    let whole = Place::file(&file);
    let list = whole.key("samples");
    if content.samples.is_empty() {
        return Err(list.error(Fault::NoRows(String::new())));
    }
    let mut rows = Vec::with_capacity(content.samples.len());
    for (i, sample) in content.samples.into_iter().enumerate() {
        let name = format!("sample {}", i + 1);
        let entry = list.index(i);
        let here = entry.named(&name);
        let variables = variables(&model.mechanism, model.units, &sample.actuators, &here.key("actuators"))?;
        rows.push(ActuatorRow { name: name.clone(), readings: sample.actuators, variables });
    }
    Ok(rows)
}

fn from_table(path: &Path, model: &Model) -> Result<Vec<ActuatorRow>, FileError> {
    let names = model.mechanism.actuator_names();
    let request =
        |columns| TableRequest { actuators: &names, columns, filter: None, poses: PoseColumns::Ignored };
    let ours = read_table(path, &request(None));
    let table = match (ours, &model.columns) {
        // The file that the model's own data come from has its own names.
        (Err(error), Some(columns)) => {
            let columns: &ColumnsDrawing = columns;
            read_table(path, &request(Some(columns))).map_err(|_| error)?
        }
        (ours, _) => ours?,
    };
    let file = path.display().to_string();
    let whole = Place::file(&file);
    let short = path.file_name().map_or_else(|| file.clone(), |name| name.to_string_lossy().into_owned());
    let mut rows = Vec::with_capacity(table.len());
    for row in table {
        let variables = variables(&model.mechanism, model.units, &row.readings, &whole.line(row.line))?;
        rows.push(ActuatorRow {
            name: format!("{short} line {}", row.line),
            readings: row.readings,
            variables,
        });
    }
    Ok(rows)
}
