//! Where public test data that are not part of the crate lie.

use std::path::{Path, PathBuf};

/// The folder `name` below `GOUGH_SHARED` (default `../shared` beside the crate). Tests that ask for it are ignored where
/// it is absent (build.rs).
pub fn directory(name: &str) -> PathBuf {
    let root = std::env::var_os("GOUGH_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let directory = root.join(name);
    assert!(directory.is_dir(), "no data in {} (set GOUGH_SHARED)", directory.display());
    directory
}
