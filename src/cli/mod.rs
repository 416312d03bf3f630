//! The command line: one file a command.

pub mod analysis;
pub mod analyze;
pub mod dispatch;
pub mod error;
pub mod identify;
pub mod predict;
pub mod progress;
pub mod result;
pub mod simulate;
pub mod solvers;
pub mod summary;
pub mod warnings;

pub use dispatch::run;
