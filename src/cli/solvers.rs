//! `gough solvers`.

use super::dispatch::Ending;
use super::error::CliError;
use crate::files::Output;
use crate::solve::registry;

/// Lists the registered identifiers.
pub fn run() -> Result<Ending, CliError> {
    let all = registry::all();
    let width = all.iter().map(|identifier| identifier.name().len()).max().unwrap_or(0);
    let mut text = String::new();
    for identifier in &all {
        text.push_str(&format!("{:width$}  {}\n", identifier.name(), identifier.summary()));
    }
    Output::Stdout.write(text.as_bytes())?;
    Ok(Ending::Done)
}
