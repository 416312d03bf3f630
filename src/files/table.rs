//! Tables of readings and poses: CSV, one posture a row.

use super::columns::{ColumnsDrawing, Layout};
use super::error::{FileError, quoted};
use super::fault::Fault;
use super::place::Place;
use super::pose::PoseDrawing;
use csv::StringRecord;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

/// Bytes within which the header must end.
const LONGEST_HEADER: usize = 1 << 20;
/// Largest table that is read, MB.
const LARGEST_TABLE: u64 = 1024;

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
}

/// A row, in units of the file.
#[derive(Clone, Debug)]
pub struct TableRow {
    /// Line of the file, from 1.
    pub line: u64,
    /// Readings in actuator order.
    pub readings: Vec<f64>,
    /// What was measured.
    pub pose: PoseDrawing,
}

/// The rows of a CSV file that count.
pub fn read_table(path: &Path, request: &TableRequest<'_>) -> Result<Vec<TableRow>, FileError> {
    let name = path.display().to_string();
    let whole = Place::file(&name);
    let file = File::open(path).map_err(|why| whole.error(Fault::Read(why)))?;
    if file.metadata().is_ok_and(|data| data.len() > LARGEST_TABLE << 20) {
        return Err(whole.error(Fault::TooLarge(LARGEST_TABLE)));
    }
    let mut source = BufReader::with_capacity(LONGEST_HEADER, file);
    check_beginning(source.fill_buf().map_err(|why| whole.error(Fault::Read(why)))?, &whole)?;
    let mut reader = csv::ReaderBuilder::new().flexible(true).trim(csv::Trim::All).from_reader(source);
    let header = reader.headers().map_err(|why| whole.error(Fault::Table(why.to_string())))?.clone();
    let layout = Layout::find(header.iter().collect(), request, &whole.line(1))?;
    let mut rows = Vec::new();
    let mut record = StringRecord::new();
    while reader.read_record(&mut record).map_err(|why| whole.error(Fault::Table(why.to_string())))? {
        let line = record.position().map_or(0, csv::Position::line);
        let row = Row { header: &header, record: &record, at: whole.line(line) };
        if record.len() != header.len() {
            return Err(row.at.error(Fault::CellCount { found: record.len(), wanted: header.len() }));
        }
        if layout.filter.iter().all(|(column, text)| record.get(*column) == Some(text.as_str())) {
            rows.push(TableRow { line, readings: row.readings(&layout)?, pose: row.pose(&layout)? });
        }
    }
    if rows.is_empty() {
        let conditions: Vec<String> =
            request.filter.into_iter().flatten().map(|(name, text)| format!("{name} = {text}")).collect();
        let with =
            if conditions.is_empty() { String::new() } else { format!(" with {}", conditions.join(", ")) };
        return Err(whole.error(Fault::NoRows(with)));
    }
    Ok(rows)
}

/// Refuses what cannot be a table before much of it is read.
fn check_beginning(bytes: &[u8], at: &Place<'_>) -> Result<(), FileError> {
    if bytes.iter().all(u8::is_ascii_whitespace) {
        return Err(at.error(Fault::Empty));
    }
    if bytes.contains(&0) {
        return Err(at.error(Fault::Table("it holds zero bytes".into())));
    }
    if bytes.len() >= LONGEST_HEADER && !bytes.iter().any(|byte| matches!(byte, b'\n' | b'\r')) {
        return Err(at.error(Fault::Table("its first line does not end".into())));
    }
    Ok(())
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

    fn readings(&self, layout: &Layout) -> Result<Vec<f64>, FileError> {
        let columns = layout.actuators.iter();
        columns
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
