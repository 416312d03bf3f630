//! Text files of foreign formats.

use super::bytes::read_bytes;
use super::error::FileError;
use super::fault::Fault;
use std::io::{Error, ErrorKind};
use std::path::Path;

/// The text of a file, which must be UTF-8.
pub fn read_text(path: &Path) -> Result<String, FileError> {
    let bytes = read_bytes(path, |_| Ok(()))?;
    String::from_utf8(bytes).map_err(|_| {
        let why = Error::new(ErrorKind::InvalidData, "it is not UTF-8 text");
        FileError::whole(path.display().to_string(), Fault::Read(why))
    })
}
