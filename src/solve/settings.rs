//! What identifiers share of their settings: reading values with one wording, and what a threshold means.

use super::identifier::SettingError;
use super::report::Estimate;
use crate::problem::Problem;

/// The error for a key that `solver` does not have.
pub fn unknown(solver: &'static str, key: &str, known: &[&str]) -> SettingError {
    SettingError::Unknown { solver, key: key.into(), known: format!("; it has: {}", known.join(", ")) }
}

/// The error for a value that does not fit.
pub fn refuse(solver: &'static str, key: &str, value: &str, why: &str) -> SettingError {
    SettingError::Value { solver, key: key.into(), value: value.into(), why: why.into() }
}

/// A finite number above 0.
pub fn positive(solver: &'static str, key: &str, value: &str) -> Result<f64, SettingError> {
    match value.parse::<f64>() {
        Ok(v) if v.is_finite() && v > 0.0 => Ok(v),
        _ => Err(refuse(solver, key, value, "it must be a finite number above 0")),
    }
}

/// What least squares estimates: with the prior on weak directions where the problem has one.
pub fn estimate(problem: &dyn Problem, threshold: f64) -> Estimate {
    if problem.has_prior() { Estimate::Split { threshold } } else { Estimate::LeastSquares }
}
