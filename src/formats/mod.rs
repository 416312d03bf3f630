//! Foreign formats: machines as other programs describe them, read into drawings and written from machines.
//!
//! Everything here is text to data and data to text; files are opened by the commands.

pub mod chain;
pub mod dh;
pub mod error;
pub mod mjcf;
pub mod urdf;
mod xml;

use crate::files::tolerance::ToleranceDrawing;
use crate::files::{MechanismDrawing, ProblemDrawing, Units, problem::PROBLEM_FORMAT};
use std::collections::BTreeMap;

pub use chain::{Axis, Chain};
pub use error::{FormatError, Wrong};

/// A machine that was read from a foreign format.
#[derive(Clone, Debug)]
pub struct Imported {
    /// Name of the machine, where the format has one.
    pub name: Option<String>,
    /// Where it comes from and what was chosen, for the problem's description.
    pub description: String,
    /// Of the drawing.
    pub units: Units,
    /// The machine.
    pub mechanism: MechanismDrawing,
    /// What was left aside, in words.
    pub notes: Vec<String>,
}

impl Imported {
    /// The problem file of this machine, without data; `tolerance` of every link where it is known.
    pub fn problem(self, name: String, tolerance: Option<ToleranceDrawing>) -> ProblemDrawing {
        ProblemDrawing {
            format: PROBLEM_FORMAT.to_owned(),
            name: Some(self.name.unwrap_or(name)),
            description: Some(self.description),
            units: self.units,
            mechanism: MechanismDrawing { tolerance, ..self.mechanism },
            data: None,
            truth: None,
            benchmark: None,
            truth_instrument: BTreeMap::new(),
        }
    }
}
