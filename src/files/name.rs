//! Names of machines, limbs, joints and things of the instrument.

use super::error::{FileError, quoted};
use super::fault::Fault;
use super::place::Place;

/// Refuses a name that is empty or has control characters: a name is shown on terminals and stands in tables.
pub(super) fn check(name: &str, at: &Place<'_>) -> Result<(), FileError> {
    if name.trim().is_empty() {
        return Err(at.error(Fault::EmptyName));
    }
    check_characters(name, at)
}

/// Refuses control characters.
pub(super) fn check_characters(name: &str, at: &Place<'_>) -> Result<(), FileError> {
    match name.chars().find(|c| c.is_control()) {
        Some(found) => Err(at.error(Fault::ControlCharacter { name: quoted(name), code: u32::from(found) })),
        None => Ok(()),
    }
}
