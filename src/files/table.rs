//! Tables of readings and poses: CSV, one posture a row.

use super::bytes::{FIRST_LOOK, first_byte, read_bytes};
use super::columns::{ColumnsDrawing, Layout};
use super::error::{FileError, quoted};
use super::fault::Fault;
use super::place::Place;
use super::pose::PoseDrawing;
use crate::cells::original;
use csv::StringRecord;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Which parts of poses a table must hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PoseColumns {
    /// Position and rotation.
    Complete,
    /// Position.
    Position,
    /// None; what is there is left aside.
    Ignored,
}

/// What is wanted of a table.
#[derive(Clone, Copy, Debug)]
pub struct TableRequest<'a> {
    /// Names `limb.joint` of the actuators.
    pub actuators: &'a [String],
    /// Names of the columns, where they are not ours.
    pub columns: Option<&'a ColumnsDrawing>,
    /// The rows that count.
    pub filter: Option<&'a BTreeMap<String, String>>,
    /// Of poses.
    pub poses: PoseColumns,
    /// What further kinds of measurement read.
    pub others: OtherColumns<'a>,
}

/// Columns that further kinds of measurement read.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OtherColumns<'a> {
    /// Actuators of a second posture.
    pub second: bool,
    /// A distance.
    pub distance: bool,
    /// A height, if there is one.
    pub height: bool,
    /// Sensed joints.
    pub joints: &'a [String],
    /// Names of target, point, plane and gauge, if there are any.
    pub names: bool,
}

/// A row, in units of the file.
#[derive(Clone, Debug)]
pub struct TableRow {
    /// Line of the file, from 1.
    pub line: u64,
    /// Readings in actuator order.
    pub readings: Vec<f64>,
    /// What was measured of a pose.
    pub pose: PoseDrawing,
    /// Readings of a second posture in actuator order.
    pub second: Vec<f64>,
    /// A distance.
    pub distance: Option<f64>,
    /// A height.
    pub height: Option<f64>,
    /// Sensed joints.
    pub joints: Vec<Option<f64>>,
    /// Names of target, point, plane and gauge.
    pub names: [Option<String>; 4],
    /// Weight of the sample.
    pub weight: Option<f64>,
}

/// Values of a column that a message lists.
const VALUES: usize = 10;

/// The bytes of a CSV file. What cannot be a table is refused before the rest is read.
pub fn read(path: &Path) -> Result<Vec<u8>, FileError> {
    let name = path.display().to_string();
    read_bytes(path, |beginning| check_beginning(&name, beginning))
}

fn reader(bytes: &[u8]) -> csv::Reader<&[u8]> {
    csv::ReaderBuilder::new().flexible(true).trim(csv::Trim::All).from_reader(bytes)
}

/// Names of the columns of the table that `bytes` of the file called `file` hold.
pub fn header(file: &str, bytes: &[u8]) -> Result<StringRecord, FileError> {
    checked_header(&mut reader(bytes), bytes, &Place::file(file))
}

/// Why a table cannot be read, and where it is not text.
fn unreadable(bytes: &[u8], why: &csv::Error) -> Fault {
    match (why.kind(), std::str::from_utf8(bytes)) {
        (csv::ErrorKind::Utf8 { .. }, Err(at)) => {
            let before = bytes.get(..at.valid_up_to()).unwrap_or(bytes);
            let line = 1 + before.iter().filter(|byte| **byte == b'\n').count();
            Fault::Table(format!("it is not UTF-8 text (line {line}); save it as UTF-8"))
        }
        _ => Fault::Table(why.to_string()),
    }
}

fn checked_header(
    reader: &mut csv::Reader<&[u8]>,
    bytes: &[u8],
    whole: &Place<'_>,
) -> Result<StringRecord, FileError> {
    let header = reader.headers().map_err(|why| whole.error(unreadable(bytes, &why)))?.clone();
    if let [only] = header.iter().collect::<Vec<_>>().as_slice()
        && let Some(separator) = [';', '\t', '|'].into_iter().find(|separator| only.contains(*separator))
    {
        return Err(whole.line(1).error(Fault::Separator(separator)));
    }
    Ok(header.iter().map(original).collect())
}

/// The rows that count of the table that `bytes` of the file called `file` hold.
pub fn parse(file: &str, bytes: &[u8], request: &TableRequest<'_>) -> Result<Vec<TableRow>, FileError> {
    check_beginning(file, bytes)?;
    let whole = Place::file(file);
    let mut lines = Lines { bytes, byte: 0, line: 1 };
    let mut reader = reader(bytes);
    let header = checked_header(&mut reader, bytes, &whole)?;
    let layout = Layout::find(header.iter().collect(), request, &whole.line(1))?;
    let mut rows = Vec::new();
    let mut met: Vec<BTreeSet<String>> = vec![BTreeSet::new(); layout.filter.len()];
    let mut record = StringRecord::new();
    while reader.read_record(&mut record).map_err(|why| whole.error(unreadable(bytes, &why)))? {
        let line = lines.of(record.position().map_or(0, csv::Position::byte));
        let row = Row { header: &header, record: &record, at: whole.line(line) };
        if record.len() != header.len() {
            return Err(row.at.error(Fault::CellCount { found: record.len(), wanted: header.len() }));
        }
        for (values, (column, _)) in met.iter_mut().zip(&layout.filter) {
            values.insert(record.get(*column).unwrap_or_default().to_owned());
        }
        if layout.filter.iter().all(|(column, text)| record.get(*column) == Some(text.as_str())) {
            rows.push(TableRow {
                line,
                readings: row.readings(&layout.actuators)?,
                pose: row.pose(&layout)?,
                second: row.readings(&layout.second)?,
                distance: row.optional(layout.distance)?,
                height: row.optional(layout.height)?,
                joints: layout.joints.iter().map(|column| row.number(*column)).collect::<Result<_, _>>()?,
                names: layout.names.map(|column| row.text(column)),
                weight: row.optional(layout.weight)?,
            });
        }
    }
    if rows.is_empty() {
        let conditions: Vec<String> =
            request.filter.into_iter().flatten().map(|(name, text)| format!("{name} = {text}")).collect();
        let with =
            if conditions.is_empty() { String::new() } else { format!(" with {}", conditions.join(", ")) };
        let held = |((name, _), values): ((&String, &String), &BTreeSet<String>)| {
            let shown: Vec<String> = values.iter().take(VALUES).map(|value| quoted(value)).collect();
            let more = if values.len() > VALUES { ", ..." } else { "" };
            format!("; {name} holds {}{more}", shown.join(", "))
        };
        let values: String = request.filter.into_iter().flatten().zip(&met).map(held).collect();
        return Err(whole.error(Fault::NoRows(with + &values)));
    }
    Ok(rows)
}

/// Refuses what cannot be a table.
pub(super) fn check_beginning(file: &str, bytes: &[u8]) -> Result<(), FileError> {
    let at = Place::file(file);
    let beginning = bytes.get(..FIRST_LOOK as usize).unwrap_or(bytes);
    if first_byte(bytes).is_none() {
        return Err(at.error(Fault::Empty));
    }
    if beginning.contains(&0) {
        return Err(at.error(Fault::Table("it holds zero bytes".into())));
    }
    if bytes.len() as u64 >= FIRST_LOOK && !beginning.iter().any(|byte| matches!(byte, b'\n' | b'\r')) {
        return Err(at.error(Fault::Table("its first line does not end".into())));
    }
    Ok(())
}

/// Counts lines. The reader's own count is that of the blank lines before a record, and lags where lines end in
/// carriage return and line feed.
struct Lines<'a> {
    bytes: &'a [u8],
    byte: usize,
    line: u64,
}

impl Lines<'_> {
    /// Line of the record that begins at `byte`, or behind the line ends there. Records come in order.
    fn of(&mut self, byte: u64) -> u64 {
        while let Some(here) = self.bytes.get(self.byte) {
            let ends = match here {
                b'\n' => true,
                b'\r' => self.bytes.get(self.byte + 1) != Some(&b'\n'),
                _ => false,
            };
            if self.byte as u64 >= byte && !matches!(here, b'\n' | b'\r') {
                break;
            }
            self.line += u64::from(ends);
            self.byte += 1;
        }
        self.line
    }
}

struct Row<'a> {
    header: &'a StringRecord,
    record: &'a StringRecord,
    at: Place<'a>,
}

impl Row<'_> {
    /// The number in a column, `None` where the cell is empty.
    fn number(&self, column: usize) -> Result<Option<f64>, FileError> {
        let text = self.record.get(column).unwrap_or_default();
        if text.is_empty() {
            return Ok(None);
        }
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(Some(value)),
            Ok(value) => Err(self.error(column, Fault::NotFinite(value))),
            Err(_) => Err(self.error(column, Fault::NotNumber(quoted(text)))),
        }
    }

    fn error(&self, column: usize, fault: Fault) -> FileError {
        let name = format!("column {}", quoted(self.header.get(column).unwrap_or_default()));
        self.at.key(&name).error(fault)
    }

    fn optional(&self, column: Option<usize>) -> Result<Option<f64>, FileError> {
        column.map_or(Ok(None), |column| self.number(column))
    }

    /// The text in a column, `None` where the cell is empty.
    fn text(&self, column: Option<usize>) -> Option<String> {
        column.and_then(|column| self.record.get(column)).filter(|text| !text.is_empty()).map(str::to_owned)
    }

    fn readings(&self, columns: &[usize]) -> Result<Vec<f64>, FileError> {
        columns
            .iter()
            .map(|&column| self.number(column)?.ok_or_else(|| self.error(column, Fault::NoReading)))
            .collect()
    }

    fn pose(&self, layout: &Layout) -> Result<PoseDrawing, FileError> {
        Ok(PoseDrawing {
            position: self.numbers(layout.position.as_ref())?,
            rotation: self.numbers(layout.rotation.as_ref())?,
            quaternion: self.numbers(layout.quaternion.as_ref())?,
        })
    }

    fn numbers<const N: usize>(
        &self,
        columns: Option<&[usize; N]>,
    ) -> Result<Option<[Option<f64>; N]>, FileError> {
        let Some(columns) = columns else { return Ok(None) };
        let mut numbers = [None; N];
        for (number, column) in numbers.iter_mut().zip(columns) {
            *number = self.number(*column)?;
        }
        Ok(Some(numbers))
    }
}
