//! A table as a drawing.

use super::row::{Convention, Row, RowKind, chain};
use crate::files::Units;
use crate::files::units::AngleUnit;
use crate::files::units::LARGEST;
use crate::formats::Imported;
use crate::formats::error::{FormatError, Wrong, quoted};
use crate::formats::xml::listed;
use csv::StringRecord;
use std::f64::consts::TAU;

/// Name of the only limb.
const LIMB: &str = "arm";
/// Columns that a table may have.
pub(super) const COLUMNS: [&str; 8] = ["joint", "type", "theta", "d", "a", "alpha", "min", "max"];

/// Reads a table with lengths and angles in `units`; `file` names the text.
pub fn read(file: &str, text: &str, convention: Convention, units: Units) -> Result<Imported, FormatError> {
    let rows = rows(file, text, units)?;
    let name = match convention {
        Convention::Standard => "standard",
        Convention::Modified => "modified",
    };
    let (chain, mut notes) = chain(&rows, convention).gathered(units);
    notes.extend(no_radians(&rows, units));
    Ok(Imported {
        name: None,
        description: format!("Denavit-Hartenberg table, {name} convention; home is the zero of all joints."),
        units,
        mechanism: chain.draw(LIMB, units),
        notes,
    })
}

/// What to say of angles that no table in radians has.
fn no_radians(rows: &[Row], units: Units) -> Option<String> {
    let angles = || rows.iter().flat_map(|row| [(row, "theta", row.theta), (row, "alpha", row.alpha)]);
    let beyond: Vec<_> = angles().filter(|(_, _, v)| v.abs() > TAU).collect();
    let (row, column, value) = beyond.first().filter(|_| units.angle == AngleUnit::Radian)?;
    let name = quoted(&row.name);
    Some(format!(
        "{} of {} angles of this table are beyond 2 pi, such as {column} of {name} with {value} rad: angles beyond 2 pi are \
         not radians; if they are degrees, import with --angle deg",
        beyond.len(),
        angles().count()
    ))
}

fn rows(file: &str, text: &str, units: Units) -> Result<Vec<Row>, FormatError> {
    let whole = |wrong| FormatError { at: file.to_owned(), wrong };
    let broken = |why: csv::Error| whole(Wrong::Table(why.to_string()));
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut reader =
        csv::ReaderBuilder::new().flexible(true).trim(csv::Trim::All).from_reader(text.as_bytes());
    let header: Vec<String> = reader.headers().map_err(broken)?.iter().map(str::to_lowercase).collect();
    let head = |wrong| FormatError { at: format!("{file} line 1"), wrong };
    for (i, name) in header.iter().enumerate() {
        if !COLUMNS.contains(&name.as_str()) {
            return Err(head(Wrong::UnknownColumn { found: quoted(name), known: COLUMNS.join(", ") }));
        }
        if header.iter().take(i).any(|other| other == name) {
            return Err(head(Wrong::Twice(quoted(name))));
        }
    }
    let mut columns = [None; COLUMNS.len()];
    for (column, name) in columns.iter_mut().zip(COLUMNS) {
        *column = header.iter().position(|found| found == name);
    }
    for name in ["theta", "d", "a", "alpha"] {
        if !header.iter().any(|found| found == name) {
            let found = listed(header.iter().map(String::as_str));
            return Err(head(Wrong::NoColumn { wanted: name, found }));
        }
    }
    let mut rows: Vec<Row> = Vec::new();
    for record in reader.records() {
        let record = record.map_err(broken)?;
        let line = record.position().map_or(0, csv::Position::line);
        let cells = Cells { record: &record, columns, units };
        let row = cells.row(header.len(), rows.len()).and_then(|row| {
            let taken = row.kind != RowKind::Fixed && rows.iter().any(|other| other.name == row.name);
            if taken { Err(Wrong::Twice(quoted(&row.name))) } else { Ok(row) }
        });
        rows.push(row.map_err(|wrong| FormatError { at: format!("{file} line {line}"), wrong })?);
    }
    if rows.iter().all(|row| row.kind == RowKind::Fixed) {
        return Err(whole(Wrong::NoRows));
    }
    Ok(rows)
}

struct Cells<'a> {
    record: &'a StringRecord,
    columns: [Option<usize>; COLUMNS.len()],
    units: Units,
}

impl Cells<'_> {
    /// Text of a column, `None` where it is empty or not there.
    fn text(&self, name: &str) -> Option<&str> {
        let at = COLUMNS.iter().position(|column| *column == name)?;
        let column = self.columns.get(at).copied().flatten()?;
        self.record.get(column).filter(|text| !text.is_empty())
    }

    /// Number of a column, in units of the table.
    fn number(&self, column: &'static str) -> Result<Option<f64>, Wrong> {
        let Some(text) = self.text(column) else { return Ok(None) };
        match text.parse::<f64>() {
            Ok(value) if value.abs() <= LARGEST => Ok(Some(value)),
            Ok(value) if value.is_finite() => Err(Wrong::Huge { column, value }),
            _ => Err(Wrong::NotNumber { column, found: quoted(text) }),
        }
    }

    fn needed(&self, column: &'static str) -> Result<f64, Wrong> {
        self.number(column)?.ok_or_else(|| Wrong::NotNumber { column, found: "an empty cell".into() })
    }

    fn row(&self, width: usize, before: usize) -> Result<Row, Wrong> {
        let found = self.record.len();
        if found != width {
            let size = if found < width { "short" } else { "long" };
            return Err(Wrong::CellCount { found, wanted: width, size });
        }
        let kind = match self.text("type") {
            None => RowKind::Revolute,
            Some(text) => RowKind::of_letter(text).ok_or_else(|| Wrong::RowType(quoted(text)))?,
        };
        let joint = |value: f64| match kind {
            RowKind::Prismatic => self.units.to_metres(value),
            RowKind::Revolute | RowKind::Fixed => self.units.to_radians(value),
        };
        let range = match (self.number("min")?, self.number("max")?) {
            (None, None) => None,
            (Some(low), Some(high)) if low > high => return Err(Wrong::RangeOrder(low, high)),
            (Some(low), Some(high)) => Some((joint(low), joint(high))),
            _ => return Err(Wrong::HalfRange),
        };
        Ok(Row {
            name: self.text("joint").map_or_else(|| format!("j{}", before + 1), str::to_owned),
            kind,
            theta: self.units.to_radians(self.needed("theta")?),
            d: self.units.to_metres(self.needed("d")?),
            a: self.units.to_metres(self.needed("a")?),
            alpha: self.units.to_radians(self.needed("alpha")?),
            range,
        })
    }
}
