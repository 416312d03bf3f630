//! The error of every file: where it is, and what is wrong there.

use super::fault::Fault;
use std::fmt;

/// Where something stands: the file, the place in it, and what people call that place.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Location {
    /// The file, as it was named.
    pub file: String,
    /// JSON path such as `mechanism.limbs[2].joints[0].axis`, or `line 14, column x`; empty for the whole file.
    pub path: String,
    /// Name such as `limb3.ball` or `sample 12`; empty where there is none.
    pub name: String,
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (path, name) = (one_line(&self.path), one_line(&self.name));
        f.write_str(&one_line(&self.file))?;
        match (path.is_empty(), name.is_empty()) {
            (true, true) => Ok(()),
            (false, true) => write!(f, ": {path}"),
            (true, false) => write!(f, ": {name}"),
            (false, false) => write!(f, ": {path} ({name})"),
        }
    }
}

/// Something wrong with a file. Its message names the file, the place, what is wrong and what to do.
#[derive(Debug)]
pub struct FileError {
    /// Where.
    pub location: Box<Location>,
    /// What.
    pub fault: Fault,
}

impl FileError {
    /// A fault of the file as a whole.
    pub fn whole(file: impl Into<String>, fault: Fault) -> Self {
        Self { location: Box::new(Location { file: file.into(), ..Location::default() }), fault }
    }
}

impl fmt::Display for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.location, self.fault)
    }
}

// The message holds the fault's own, so the fault is not repeated as a source.
impl std::error::Error for FileError {}

/// Text of a file as it may be quoted in a message: one line, not too long.
pub fn quoted(text: &str) -> String {
    const LONGEST: usize = 60;
    let mut short = one_line(&text.chars().take(LONGEST).collect::<String>());
    if text.chars().nth(LONGEST).is_some() {
        short.push_str("...");
    }
    format!("`{short}`")
}

/// The text without its control characters, which would act on a terminal or begin a line of their own.
fn one_line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { '\u{fffd}' } else { c }).collect()
}
