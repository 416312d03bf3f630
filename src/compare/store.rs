//! Result lines on disk: written as each run ends, read again to resume and to merge.

use super::line::{RUN_FORMAT, RunKey, RunLine};
use crate::files::{Fault, FileError, Location, json, ledger};
use std::collections::{BTreeMap, HashMap};
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Lines of one file.
#[derive(Clone, Debug, Default)]
pub struct Lines {
    /// Those that are whole, with their numbers from 1.
    pub lines: Vec<(usize, RunLine)>,
    /// Bytes up to the end of the last of them.
    pub whole: u64,
    /// Number of a last line whose end is missing: the program was stopped while it was written.
    pub torn: Option<usize>,
}

/// A file to which lines are added; nobody else may add to it meanwhile.
pub struct Store {
    path: PathBuf,
    file: File,
}

fn failed(path: &Path, why: impl ToString) -> FileError {
    FileError::whole(path.display().to_string(), Fault::Write(why.to_string()))
}

fn at_line(path: &Path, number: usize, fault: Fault) -> FileError {
    let (file, path) = (path.display().to_string(), format!("line {number}"));
    FileError { location: Box::new(Location { file, path, name: String::new() }), fault }
}

/// Reads a file of result lines.
pub fn read(path: &Path) -> Result<Lines, FileError> {
    ledger::reads(path)?;
    parse(path, &bytes(path)?)
}

fn bytes(path: &Path) -> Result<Vec<u8>, FileError> {
    fs::read(path).map_err(|why| FileError::whole(path.display().to_string(), Fault::Read(why)))
}

fn parse(path: &Path, bytes: &[u8]) -> Result<Lines, FileError> {
    let mut found = Lines::default();
    for (index, text) in bytes.split_inclusive(|byte| *byte == b'\n').enumerate() {
        let number = index + 1;
        if text.last() != Some(&b'\n') {
            found.torn = Some(number);
            break;
        }
        found.whole += text.len() as u64;
        if text.iter().all(u8::is_ascii_whitespace) {
            continue;
        }
        let line: RunLine = json::parse("", text).map_err(|why| {
            let why = why.to_string().trim_start_matches([':', ' ']).to_owned();
            at_line(path, number, Fault::ResultLine(why))
        })?;
        if line.format != RUN_FORMAT {
            let found = crate::files::error::quoted(&line.format);
            return Err(at_line(path, number, Fault::Format { found, expected: RUN_FORMAT }));
        }
        found.lines.push((number, line));
    }
    Ok(found)
}

impl Store {
    /// Opens the file, or makes it, and cuts off a torn last line. Returns the lines that it has.
    pub fn open(path: &Path) -> Result<(Self, Lines), FileError> {
        let fail = |why: std::io::Error| failed(path, why);
        ledger::writes(path)?;
        let file = OpenOptions::new().append(true).create(true).open(path).map_err(fail)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(failed(path, "another comparison is writing to it")),
            // Some file systems have no locks.
            Err(TryLockError::Error(_)) => {}
        }
        let lines = parse(path, &bytes(path)?)?;
        file.set_len(lines.whole).map_err(fail)?;
        Ok((Self { path: path.to_owned(), file }, lines))
    }

    /// Adds a line and sees it off to the system.
    pub fn add(&mut self, line: &RunLine) -> Result<(), FileError> {
        let bytes = text(&self.path, std::slice::from_ref(line))?;
        self.file.write_all(&bytes).and_then(|()| self.file.flush()).map_err(|why| failed(&self.path, why))
    }
}

/// The lines as a file holds them.
pub fn text(path: &Path, lines: &[RunLine]) -> Result<Vec<u8>, FileError> {
    let mut bytes = Vec::new();
    for line in lines {
        serde_json::to_writer(&mut bytes, line).map_err(|why| failed(path, why))?;
        bytes.push(b'\n');
    }
    Ok(bytes)
}

/// The lines of the runs in `order`, then the others as they stood.
pub fn in_order(lines: Vec<RunLine>, order: &[RunKey]) -> Vec<RunLine> {
    let rank: HashMap<String, usize> = order.iter().enumerate().map(|(i, key)| (key.text(), i)).collect();
    let mut ranked: Vec<(usize, RunLine)> = lines
        .into_iter()
        .map(|line| (rank.get(&line.run.text()).copied().unwrap_or(usize::MAX), line))
        .collect();
    ranked.sort_by_key(|(rank, _)| *rank);
    ranked.into_iter().map(|(_, line)| line).collect()
}

/// Lines of all files, each run once, in an order that does not depend on that of the files. Lines of one run that
/// differ in more than time and memory are an error that names both.
pub fn merge(files: &[(PathBuf, Lines)]) -> Result<Vec<RunLine>, FileError> {
    let mut merged: BTreeMap<String, (&Path, usize, &RunLine, String)> = BTreeMap::new();
    for (path, found) in files {
        for (number, line) in &found.lines {
            let (key, text) = (line.run.text(), line.reproducible());
            match merged.get_mut(&key) {
                None => {
                    merged.insert(key, (path, *number, line, text));
                }
                Some((other, at, _, before)) if *before != text => {
                    let other = format!("{} line {at}", other.display());
                    return Err(at_line(path, *number, Fault::OtherResult(other)));
                }
                // Of two that differ in time only, the quicker: any rule will do that no order can change.
                Some((_, _, kept, _)) => {
                    let time = |line: &RunLine| (line.cost.wall, line.cost.cpu, line.cost.memory);
                    if time(line) < time(kept) {
                        *kept = line;
                    }
                }
            }
        }
    }
    Ok(merged.into_values().map(|(_, _, line, _)| line.clone()).collect())
}
