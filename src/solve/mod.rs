//! Identifiers: interchangeable ways to minimise one [`crate::problem::Problem`].

pub mod anchored;
pub mod argmin_adapter;
pub mod argmin_lbfgs;
pub mod argmin_lm;
pub mod argmin_trust_region;
mod bend;
pub mod complete;
pub mod conic;
pub mod damped;
pub mod identifier;
pub mod levenberg;
pub mod limbwise;
pub mod map;
pub mod minimal;
pub mod objective;
pub mod radius;
pub mod reduced;
pub mod registry;
pub mod report;
pub mod settings;
pub mod split;
pub mod textbook;
mod valley;

pub use identifier::{Identifier, SettingError, Stop};
pub use objective::Objective;
pub use report::{ActiveBound, Criterion, Estimate, Failure, Iterate, Outcome, Report, WeightPoint};
