//! Where public test data that are not part of the crate lie.

use std::path::{Path, PathBuf};

/// The folder `name` below `GOUGH_SHARED` (default `../shared` beside the crate), or a loud nothing.
pub fn directory(name: &str) -> Option<PathBuf> {
    let root = std::env::var_os("GOUGH_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let directory = root.join(name);
    if directory.is_dir() {
        return Some(directory);
    }
    eprintln!("SKIPPED: no data in {} (set GOUGH_SHARED)", directory.display());
    None
}
