//! Versions of the crates that do the numerical work.

use std::collections::BTreeMap;
use std::sync::LazyLock;

/// What cargo builds this crate with, in a checkout and by `cargo install --locked`.
const LOCK: &str = include_str!("../../Cargo.lock");

/// The crates that solve.
const NUMERICAL: [&str; 4] = ["argmin", "clarabel", "faer", "nalgebra"];

/// Version by name of argmin, clarabel, faer and nalgebra, as this crate's Cargo.lock has them. A build that resolves
/// versions of its own (`cargo install` without `--locked`, another crate that uses this library) may have others.
pub fn versions() -> &'static BTreeMap<String, String> {
    static VERSIONS: LazyLock<BTreeMap<String, String>> = LazyLock::new(|| {
        let entry = |name: &str| Some((name.to_owned(), locked(name)?.to_owned()));
        NUMERICAL.into_iter().filter_map(entry).collect()
    });
    &VERSIONS
}

/// The line after `name = "..."` is that of the version: cargo writes both in this order.
fn locked(name: &str) -> Option<&'static str> {
    let head = format!("name = \"{name}\"");
    let version = LOCK.lines().skip_while(|line| *line != head).nth(1)?;
    version.strip_prefix("version = \"")?.strip_suffix('"')
}
