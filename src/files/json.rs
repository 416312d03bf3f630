//! JSON text: read with the place of whatever is wrong, written with arrays of numbers on one line.

use super::bytes::{FIRST_LOOK, first_byte, read_bytes, without_mark};
use super::error::{FileError, quoted};
use super::fault::Fault;
use super::place::Place;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use serde_json::error::Category;
use std::io::{self, Write};
use std::path::Path;

/// The bytes of a JSON file. A file that does not begin as an object is refused before the rest is read.
pub fn read(path: &Path) -> Result<Vec<u8>, FileError> {
    let name = path.display().to_string();
    read_bytes(path, |beginning| check_beginning(&name, beginning))
}

/// Refuses what does not begin as an object.
pub(super) fn check_beginning(file: &str, bytes: &[u8]) -> Result<(), FileError> {
    match first_byte(bytes) {
        Some(b'{') => Ok(()),
        None if bytes.len() as u64 >= FIRST_LOOK => {
            Err(FileError::whole(file, Fault::NotJson("it begins with blanks only".into())))
        }
        None => Err(FileError::whole(file, Fault::Empty)),
        Some(_) => {
            let text =
                String::from_utf8_lossy(bytes.get(..bytes.len().min(20)).unwrap_or(bytes)).into_owned();
            let why = format!("it begins with {} where an object begins with {{", quoted(&text));
            Err(FileError::whole(file, Fault::NotJson(why)))
        }
    }
}

/// The value that `bytes` of the file called `file` hold.
pub fn parse<T: DeserializeOwned>(file: &str, bytes: &[u8]) -> Result<T, FileError> {
    check_beginning(file, bytes)?;
    let bytes = without_mark(bytes);
    let mut deserializer = serde_json::Deserializer::from_slice(bytes);
    let value = serde_path_to_error::deserialize(&mut deserializer).map_err(|error| {
        let path = match error.path().to_string() {
            path if path == "." => String::new(),
            path => path,
        };
        let inner = error.into_inner();
        // Where the syntax breaks off there is no key yet: the line and column in the message say where.
        let path = path.strip_suffix(".?").or(path.strip_suffix('?')).map_or(path.clone(), str::to_owned);
        let mut located = Place::file(file).error(match inner.classify() {
            Category::Data => Fault::Schema(schema(&inner.to_string())),
            Category::Syntax | Category::Eof | Category::Io => {
                Fault::NotJson(syntax(bytes, inner.line(), inner.column(), &inner.to_string()))
            }
        });
        located.location.name = name_of(bytes, &path);
        located.location.path = path;
        located
    })?;
    match deserializer.end() {
        Ok(()) => Ok(value),
        Err(error) => Err(FileError::whole(file, Fault::NotJson(error.to_string()))),
    }
}

/// What a value should have been, in the words of the format and not in those of the program that reads it.
fn schema(why: &str) -> String {
    let why = why.replace(
        "invalid type: null, expected struct PoseDrawing",
        "it is null; leave the key out, or give \
        position and rotation, with null for what was not measured",
    );
    if !why.contains("expected struct ") {
        return why;
    }
    let (before, after) = why.split_once("expected struct ").unwrap_or_default();
    let rest = after.split_once(' ').map_or("", |(_, rest)| rest);
    format!("{before}expected an object {rest}")
}

/// Where the syntax breaks off: with what JSON says of numbers that it does not have.
fn syntax(bytes: &[u8], line: usize, column: usize, why: &str) -> String {
    let text = bytes.split(|byte| *byte == b'\n').nth(line.saturating_sub(1)).unwrap_or_default();
    let from = text.get(column.saturating_sub(1)..).unwrap_or_default();
    let token = ["NaN", "Infinity", "-Infinity", "-NaN", "nan", "inf", "-inf"].into_iter().find(|token| {
        [from, text.get(column.saturating_sub(2)..).unwrap_or_default()]
            .iter()
            .any(|t| t.starts_with(token.as_bytes()))
    });
    match token {
        Some(token) => format!(
            "{token} is no number of JSON (line {line} column {column}): give a finite number, or null where a component \
             was not measured"
        ),
        None if why.starts_with("number out of range") => {
            format!("a number is too large (line {line} column {column}); are the units right?")
        }
        None if why.starts_with("invalid unicode code point") => {
            format!("it is not UTF-8 text (line {line} column {column}): JSON is UTF-8; save it so")
        }
        None => why.to_owned(),
    }
}

/// What people call the limb, joint or sample that a JSON path goes through; empty where it has no name.
fn name_of(bytes: &[u8], path: &str) -> String {
    let Ok(mut at) = serde_json::from_slice::<Value>(bytes) else { return String::new() };
    let mut names: Vec<String> = Vec::new();
    for part in path.split('.') {
        let (key, index) = match part.split_once('[') {
            Some((key, rest)) => (key, rest.split(']').next().and_then(|i| i.parse::<usize>().ok())),
            None => (part, None),
        };
        at = at.get_mut(key).map(Value::take).unwrap_or_default();
        let Some(index) = index else { continue };
        at = at.get_mut(index).map(Value::take).unwrap_or_default();
        let stated = at.get("name").and_then(Value::as_str).map(str::to_owned);
        match key {
            "limbs" => names.push(stated.unwrap_or_else(|| format!("limb{}", index + 1))),
            "joints" => names.push(stated.unwrap_or_else(|| format!("j{}", index + 1))),
            "samples" => names.push(format!("sample {}", index + 1)),
            _ => {}
        }
    }
    names.join(".")
}

/// Text of a value, objects over several lines, arrays on one unless they hold objects.
pub fn text<T: Serialize>(value: &T) -> Result<Vec<u8>, serde_json::Error> {
    let mut out = Vec::new();
    value.serialize(&mut serde_json::Serializer::with_formatter(&mut out, Layout { depth: 0 }))?;
    out.push(b'\n');
    Ok(out)
}

struct Layout {
    depth: usize,
}

impl Layout {
    fn line<W: ?Sized + Write>(&self, out: &mut W) -> io::Result<()> {
        write!(out, "\n{:1$}", "", 2 * self.depth)
    }
}

impl serde_json::ser::Formatter for Layout {
    fn begin_array_value<W: ?Sized + Write>(&mut self, out: &mut W, first: bool) -> io::Result<()> {
        out.write_all(if first { b"" } else { b", " })
    }

    fn begin_object<W: ?Sized + Write>(&mut self, out: &mut W) -> io::Result<()> {
        self.depth += 1;
        out.write_all(b"{")
    }

    fn begin_object_key<W: ?Sized + Write>(&mut self, out: &mut W, first: bool) -> io::Result<()> {
        out.write_all(if first { b"" } else { b"," })?;
        self.line(out)
    }

    fn begin_object_value<W: ?Sized + Write>(&mut self, out: &mut W) -> io::Result<()> {
        out.write_all(b": ")
    }

    fn end_object<W: ?Sized + Write>(&mut self, out: &mut W) -> io::Result<()> {
        self.depth = self.depth.saturating_sub(1);
        self.line(out)?;
        out.write_all(b"}")
    }
}
