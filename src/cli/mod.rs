//! The command line: one file a command.

pub mod analysis;
pub mod analyze;
mod at;
pub mod check;
mod check_misfit;
mod check_stated;
pub mod command;
pub mod compare;
mod details;
pub mod dispatch;
mod elsewhere;
pub mod error;
mod estimate;
pub mod export;
pub mod identify;
mod import;
pub mod import_csv;
pub mod judged;
pub mod plan;
pub mod predict;
pub mod progress;
pub mod ranges;
pub mod report;
pub mod result;
pub mod simulate;
pub mod solvers;
pub mod summary;
mod threads;
mod tolerances;
pub mod warnings;
pub mod wording;

pub use dispatch::run;
