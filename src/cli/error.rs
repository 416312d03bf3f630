//! Everything that ends a command with exit status 2.

use crate::design::DesignError;
use crate::files::FileError;
use crate::formats::FormatError;
use crate::model::mobility::MobilityError;
use crate::problem::EvalError;
use crate::simulate::SimulateError;
use crate::solve::SettingError;
use crate::solve::registry::UnknownSolver;

/// Bad input or usage, in one message.
#[derive(Debug, thiserror::Error)]
pub enum CliError {
    /// A file.
    #[error(transparent)]
    File(#[from] FileError),
    /// A foreign file.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// A machine that the model does not describe.
    #[error("{file}: mechanism: {why}")]
    Mobility {
        /// The file.
        file: String,
        /// What is wrong.
        why: MobilityError,
    },
    /// Nothing to identify, or nothing to identify it from.
    #[error("{file}: {why}")]
    Identify {
        /// The file.
        file: String,
        /// What is wrong, in units of the file.
        why: String,
    },
    /// A posture.
    #[error("{file}: {sample}: {why}")]
    Posture {
        /// The file.
        file: String,
        /// The sample.
        sample: String,
        /// Why it does not close, in units of the file.
        why: String,
    },
    /// Postures were set aside although none may be.
    #[error("{file}: {sample} takes no part: {why} (--require-all refuses that)")]
    SetAside {
        /// The file.
        file: String,
        /// The sample.
        sample: String,
        /// Why it does not close, in units of the file.
        why: String,
    },
    /// Simulation.
    #[error("{file}: {why}")]
    Simulate {
        /// The file.
        file: String,
        /// What is wrong.
        why: SimulateError,
    },
    /// A plan.
    #[error("{file}: {why}")]
    Design {
        /// The file.
        file: String,
        /// What is wrong.
        why: DesignError,
    },
    /// Identifiability.
    #[error("{file}: {why}")]
    Evaluate {
        /// The file.
        file: String,
        /// What is wrong.
        why: EvalError,
    },
    /// No such identifier.
    #[error(transparent)]
    Solver(#[from] UnknownSolver),
    /// A setting of an identifier.
    #[error(transparent)]
    Setting(#[from] SettingError),
    /// Any other misuse of the command line.
    #[error("{0}")]
    Usage(String),
}
