//! Actuator readings to predict with: CSV, or JSON with `samples`.

use super::bytes::{first_byte, read_bytes};
use super::columns::ColumnsDrawing;
use super::error::{FileError, quoted};
use super::fault::Fault;
use super::json;
use super::place::Place;
use super::problem::Model;
use super::readings::variables;
use super::table::{self, OtherColumns, PoseColumns, TableRequest};
use crate::cells::inert;
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::io;
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

/// `samples` by itself, or a problem file with samples in its `data`; the rest of that is left aside.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ActuatorFile {
    samples: Option<Vec<Readings>>,
    data: Option<ProblemData>,
    #[serde(rename = "format")]
    _format: Option<IgnoredAny>,
    #[serde(rename = "name")]
    _name: Option<IgnoredAny>,
    #[serde(rename = "description")]
    _description: Option<IgnoredAny>,
    #[serde(rename = "units")]
    _units: Option<IgnoredAny>,
    #[serde(rename = "mechanism")]
    _mechanism: Option<IgnoredAny>,
    #[serde(rename = "truth")]
    _truth: Option<IgnoredAny>,
    #[serde(rename = "truth_instrument")]
    _truth_instrument: Option<IgnoredAny>,
    #[serde(rename = "benchmark")]
    _benchmark: Option<IgnoredAny>,
}

/// Samples, or sets that hold them.
#[derive(Deserialize)]
struct ProblemData {
    samples: Option<Vec<Readings>>,
    sets: Option<Vec<ProblemData>>,
    file: Option<String>,
}

/// Other keys are left aside, so that measured samples and predicted poses can be read too.
#[derive(Deserialize)]
struct Readings {
    actuators: Vec<f64>,
}

/// A CSV file of readings in units of the file, one column for each actuator of these names.
pub fn actuators_text(names: &[String], rows: &[Vec<f64>]) -> io::Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(names.iter().map(|name| inert(name).into_owned()))?;
    for row in rows {
        writer.serialize(row)?;
    }
    writer.into_inner().map_err(|error| error.into_error())
}

/// Postures as CSV whose rows also name what is to be measured there: `named` has the headings of those columns.
pub fn planned_text(
    names: &[String],
    named: &[&str],
    rows: &[(Vec<f64>, Vec<String>)],
) -> io::Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let heads = names.iter().map(String::as_str).chain(named.iter().copied());
    writer.write_record(heads.map(|name| inert(name).into_owned()))?;
    for (readings, names) in rows {
        let names: Vec<_> = names.iter().map(|name| inert(name)).collect();
        writer.serialize((readings, names))?;
    }
    writer.into_inner().map_err(|error| error.into_error())
}

/// Reads the postures of `path` for `model`, whose units govern it. A file that begins with a brace is JSON.
pub fn read_actuators(path: &Path, model: &Model) -> Result<Vec<ActuatorRow>, FileError> {
    let file = path.display().to_string();
    let bytes = read_bytes(path, |beginning| {
        if is_json(path, beginning) {
            json::check_beginning(&file, beginning)
        } else {
            table::check_beginning(&file, beginning)
        }
    })?;
    if is_json(path, &bytes) {
        return from_json(&file, &bytes, model);
    }
    let short = path.file_name().map_or_else(|| file.clone(), |name| name.to_string_lossy().into_owned());
    from_table(&file, &short, &bytes, model)
}

fn is_json(path: &Path, bytes: &[u8]) -> bool {
    matches!(first_byte(bytes), Some(b'{' | b'['))
        || path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"))
}

fn from_json(file: &str, bytes: &[u8], model: &Model) -> Result<Vec<ActuatorRow>, FileError> {
    let content: ActuatorFile = json::parse(file, bytes)?;
    let whole = Place::file(file);
    let data = whole.key("data");
    let mut rows = Vec::new();
    match (content.samples, content.data) {
        (None, Some(ProblemData { sets: Some(sets), .. })) => {
            let list = data.key("sets");
            for (i, set) in sets.into_iter().enumerate() {
                set.add_rows(&format!("set {} ", i + 1), &list.index(i), model, &mut rows)?;
            }
        }
        (None, Some(stated)) => stated.add_rows("", &data, model, &mut rows)?,
        (samples, _) => {
            ProblemData { samples, sets: None, file: None }.add_rows("", &whole, model, &mut rows)?;
        }
    }
    Ok(rows)
}

impl ProblemData {
    fn add_rows(
        self,
        prefix: &str,
        at: &Place<'_>,
        model: &Model,
        rows: &mut Vec<ActuatorRow>,
    ) -> Result<(), FileError> {
        if let Some(table) = self.file {
            return Err(at.key("file").error(Fault::ReadingsElsewhere(quoted(&table))));
        }
        let list = at.key("samples");
        let samples = self.samples.unwrap_or_default();
        if samples.is_empty() {
            return Err(list.error(Fault::NoRows(String::new())));
        }
        for (i, sample) in samples.into_iter().enumerate() {
            let name = format!("{prefix}sample {}", i + 1);
            let entry = list.index(i);
            let here = entry.named(&name);
            let readings_at = here.key("actuators");
            let variables = variables(&model.mechanism, model.units, &sample.actuators, &readings_at)?;
            rows.push(ActuatorRow { name: name.clone(), readings: sample.actuators, variables });
        }
        Ok(())
    }
}

fn from_table(file: &str, short: &str, bytes: &[u8], model: &Model) -> Result<Vec<ActuatorRow>, FileError> {
    let names = model.mechanism.actuator_names();
    let parse = |columns: Option<&ColumnsDrawing>| {
        let request = TableRequest {
            actuators: &names,
            columns,
            filter: None,
            poses: PoseColumns::Ignored,
            others: OtherColumns::default(),
        };
        table::parse(file, bytes, &request)
    };
    let table = match (parse(None), &model.columns) {
        // The file that the model's own data come from has its own names.
        (Err(error), Some(columns)) => parse(Some(columns)).map_err(|_| error)?,
        (ours, _) => ours?,
    };
    let whole = Place::file(file);
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
