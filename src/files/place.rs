//! The way to a place in a file, kept while reading and put into words only when something is wrong there.

use super::error::{FileError, Location};
use super::fault::Fault;
use std::fmt::Write;

#[derive(Clone, Copy, Debug)]
enum Step<'a> {
    File(&'a str),
    Key(&'a str),
    Index(usize),
    Line(u64),
}

/// A place: one step, and the place that it was taken from.
#[derive(Clone, Copy, Debug)]
pub struct Place<'a> {
    up: Option<&'a Place<'a>>,
    step: Step<'a>,
    name: Option<&'a str>,
}

impl<'a> Place<'a> {
    /// The whole file.
    pub fn file(file: &'a str) -> Self {
        Self { up: None, step: Step::File(file), name: None }
    }

    /// The value of a key of an object here.
    pub fn key(&'a self, key: &'a str) -> Self {
        Self { up: Some(self), step: Step::Key(key), name: None }
    }

    /// An entry of an array here, from 0.
    pub fn index(&'a self, index: usize) -> Self {
        Self { up: Some(self), step: Step::Index(index), name: None }
    }

    /// A line of a table, from 1.
    pub fn line(&'a self, line: u64) -> Self {
        Self { up: Some(self), step: Step::Line(line), name: None }
    }

    /// The same place, with the name that people use for it.
    pub fn named(self, name: &'a str) -> Self {
        Self { name: Some(name), ..self }
    }

    /// The place in words.
    pub fn location(&self) -> Location {
        let mut location = match self.up {
            Some(up) => up.location(),
            None => Location::default(),
        };
        if let Some(name) = self.name {
            location.name = name.to_owned();
        }
        let path = &mut location.path;
        // Writing to a string cannot fail.
        let _ = match self.step {
            Step::File(file) => {
                location.file = file.to_owned();
                Ok(())
            }
            Step::Key(key) if path.is_empty() => write!(path, "{key}"),
            Step::Key(key) if path.starts_with("line ") => write!(path, ", {key}"),
            Step::Key(key) => write!(path, ".{key}"),
            Step::Index(index) => write!(path, "[{index}]"),
            Step::Line(line) => write!(path, "line {line}"),
        };
        location
    }

    /// A fault here.
    pub fn error(&self, fault: Fault) -> FileError {
        FileError { location: Box::new(self.location()), fault }
    }
}
