//! The command line: one file a command.

pub mod analyze;
pub mod dispatch;
pub mod error;
mod estimate;
pub mod identify;
pub mod predict;
pub mod progress;
pub mod report;
pub mod simulate;
pub mod solvers;
pub mod summary;

pub use dispatch::run;
