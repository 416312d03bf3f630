//! Writing: a file is there as a whole, or not at all.

use super::error::FileError;
use super::fault::Fault;
use super::ledger;
use std::fs;
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// Where results go.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Output {
    /// Standard output.
    Stdout,
    /// A file.
    File(PathBuf),
}

impl Output {
    /// `-` and nothing mean standard output.
    pub fn named(path: Option<&Path>) -> Self {
        match path {
            None => Self::Stdout,
            Some(path) if path == Path::new("-") => Self::Stdout,
            Some(path) => Self::File(path.to_owned()),
        }
    }

    /// Refuses a file that cannot be written, before any work is done for it. Leaves nothing behind.
    pub fn check(&self) -> Result<(), FileError> {
        match self {
            Self::Stdout => Ok(()),
            Self::File(path) => check_writable(path),
        }
    }

    /// Writes all of `bytes`.
    pub fn write(&self, bytes: &[u8]) -> Result<(), FileError> {
        match self {
            Self::Stdout => {
                let mut out = io::stdout().lock();
                match out.write_all(bytes).and_then(|()| out.flush()) {
                    // A reader that has seen enough is no failure.
                    Err(why) if why.kind() == ErrorKind::BrokenPipe => Ok(()),
                    outcome => outcome
                        .map_err(|why| FileError::whole("standard output", Fault::Write(why.to_string()))),
                }
            }
            Self::File(path) => write_file(path, bytes),
        }
    }
}

fn failed(path: &Path, why: impl ToString) -> FileError {
    FileError::whole(path.display().to_string(), Fault::Write(why.to_string()))
}

/// Whether `path` is something other than a file that can be replaced: a device or a pipe.
fn is_special(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|data| !data.is_file() && !data.is_dir())
}

/// Refuses a path that cannot be written; nothing is left behind.
pub fn check_writable(path: &Path) -> Result<(), FileError> {
    ledger::writes(path)?;
    if is_special(path) { Ok(()) } else { prepare(path).map(drop) }
}

/// Writes `bytes` to a temporary file in the folder of `path` and moves it there in one step.
pub fn write_file(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    ledger::writes(path)?;
    if is_special(path) {
        return fs::write(path, bytes).map_err(|why| failed(path, why));
    }
    let (mut file, target) = prepare(path)?;
    file.write_all(bytes).and_then(|()| file.as_file().sync_all()).map_err(|why| failed(path, why))?;
    file.persist(target).map_err(|why| failed(path, why.error))?;
    Ok(())
}

/// An empty temporary file beside the file that `path` leads to, and that file's path.
fn prepare(path: &Path) -> Result<(NamedTempFile, PathBuf), FileError> {
    // Through symbolic links, so that the link stays one.
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    if target.is_dir() {
        return Err(failed(path, "it is a folder; name a file"));
    }
    let existing = fs::metadata(&target).ok().map(|data| data.permissions());
    if existing.as_ref().is_some_and(fs::Permissions::readonly) {
        return Err(failed(path, "it is read-only"));
    }
    if target.file_name().is_none() {
        return Err(failed(path, "it does not name a file"));
    }
    let folder = match target.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    if !folder.is_dir() {
        return Err(failed(path, format!("there is no folder {}", folder.display())));
    }
    let mut builder = tempfile::Builder::new();
    builder.prefix(".gough-");
    if let Some(permissions) = existing.or_else(usual_permissions) {
        builder.permissions(permissions);
    }
    let file = builder.tempfile_in(folder).map_err(|why| failed(path, why))?;
    Ok((file, target))
}

/// Those of a file that is made in the ordinary way; a temporary file is otherwise its owner's alone.
#[cfg(unix)]
fn usual_permissions() -> Option<fs::Permissions> {
    Some(std::os::unix::fs::PermissionsExt::from_mode(0o666))
}

#[cfg(not(unix))]
fn usual_permissions() -> Option<fs::Permissions> {
    None
}
