//! What a run of the command line reads and what it has promised to write: no file may be both.
//!
//! Files are told apart by device and inode, so that links and other spellings of a path do not hide them. The ledger is
//! kept from [`open`] on; a program that uses the library without it may write where it likes.

use super::error::FileError;
use super::fault::Fault;
use std::path::Path;
use std::sync::{Mutex, MutexGuard};

/// Identity of a file: device and inode, or its canonical path where the system has none.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Identity(#[cfg(unix)] [u64; 2], #[cfg(not(unix))] std::path::PathBuf);

/// What a run reads and writes.
#[derive(Debug, Default)]
struct Ledger {
    /// Whether it is kept.
    open: bool,
    read: Vec<Identity>,
    promised: Vec<Identity>,
}

static LEDGER: Mutex<Ledger> = Mutex::new(Ledger { open: false, read: Vec::new(), promised: Vec::new() });

fn ledger() -> MutexGuard<'static, Ledger> {
    LEDGER.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// Begins an empty ledger: what is read from here on is safe from what is written.
pub fn open() {
    *ledger() = Ledger { open: true, ..Ledger::default() };
}

/// Notes that the file is an input; refuses one that the run is to write.
pub fn reads(path: &Path) -> Result<(), FileError> {
    note(path, |ledger, file| {
        ledger.read.push(file.clone());
        ledger.promised.contains(&file)
    })
}

/// Notes that the file is to be written; refuses one that was read.
pub fn writes(path: &Path) -> Result<(), FileError> {
    note(path, |ledger, file| {
        ledger.promised.push(file.clone());
        ledger.read.contains(&file)
    })
}

fn note(path: &Path, both: impl FnOnce(&mut Ledger, Identity) -> bool) -> Result<(), FileError> {
    let mut ledger = ledger();
    let Some(file) = identity(path).filter(|_| ledger.open) else { return Ok(()) };
    match both(&mut ledger, file) {
        true => Err(FileError::whole(path.display().to_string(), Fault::InputAndOutput)),
        false => Ok(()),
    }
}

/// `None` for what is no ordinary file: pipes and devices are not destroyed, and what is not there cannot be.
#[cfg(unix)]
fn identity(path: &Path) -> Option<Identity> {
    use std::os::unix::fs::MetadataExt;
    let data = std::fs::metadata(path).ok()?;
    data.is_file().then(|| Identity([data.dev(), data.ino()]))
}

#[cfg(not(unix))]
fn identity(path: &Path) -> Option<Identity> {
    std::fs::metadata(path).ok().filter(|data| data.is_file())?;
    path.canonicalize().ok().map(Identity)
}
