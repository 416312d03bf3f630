//! The bytes of a file, refused early where they cannot be what is looked for.

use super::error::FileError;
use super::fault::Fault;
use super::ledger;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Bytes that are read before a file may be refused.
pub(super) const FIRST_LOOK: u64 = 1 << 20;
/// Largest file that is read, MB.
const LARGEST_FILE: u64 = 1024;

/// All bytes of the file, if `look` takes its beginning. It is opened once, so that it may be a pipe.
pub(super) fn read_bytes(
    path: &Path,
    look: impl Fn(&[u8]) -> Result<(), FileError>,
) -> Result<Vec<u8>, FileError> {
    let name = path.display().to_string();
    let fail = |why| FileError::whole(name.clone(), Fault::Read(why));
    let mut file = File::open(path).map_err(fail)?;
    ledger::reads(path)?;
    let mut bytes = Vec::new();
    (&mut file).take(FIRST_LOOK).read_to_end(&mut bytes).map_err(fail)?;
    look(&bytes)?;
    file.take(LARGEST_FILE << 20).read_to_end(&mut bytes).map_err(fail)?;
    if bytes.len() as u64 > LARGEST_FILE << 20 {
        return Err(FileError::whole(name, Fault::TooLarge(LARGEST_FILE)));
    }
    Ok(bytes)
}

/// The bytes behind a byte order mark, which some editors write.
pub(super) fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)
}

/// The first byte that is not blank.
pub(super) fn first_byte(bytes: &[u8]) -> Option<u8> {
    without_mark(bytes).iter().copied().find(|byte| !byte.is_ascii_whitespace())
}
