//! Identifiers: interchangeable ways to minimise one [`crate::problem::Problem`].

pub mod identifier;

pub mod minimal;
pub mod registry;
pub mod report;
pub mod split;
pub mod textbook;

pub use identifier::{Identifier, SettingError, Stop};
pub use report::{ActiveBound, Criterion, Estimate, Failure, Iterate, Outcome, Report, WeightPoint};
