//! The strategy that turns a problem into parameters.

use super::report::Report;
use crate::linalg::norm;
use crate::problem::{Form, Problem};

/// When to stop; the same for every identifier.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Stop {
    /// Most iterations (accepted steps or outer loops).
    pub iterations: usize,
    /// Relative step `|dx| <= step (|x| + step)`.
    pub step: f64,
    /// Largest cosine between the residual and a column of the Jacobian (MINPACK's `gtol`). Where weak directions have a
    /// prior, which columns do not show, `argmin-lm` asks for a thousandth of it.
    pub gradient: f64,
    /// Relative reduction of the cost, actual and predicted (MINPACK's `ftol`).
    pub cost: f64,
}

impl Stop {
    /// Whether a step of this length to, or from, `x` ends the iteration.
    pub fn by_step(&self, length: f64, x: &[f64]) -> bool {
        length <= self.step * (norm(x) + self.step)
    }
}

impl Default for Stop {
    /// 200 iterations; 1e-9 on step and gradient, 1e-12 on the cost: well below any measurement noise.
    fn default() -> Self {
        Self { iterations: 200, step: 1e-9, gradient: 1e-9, cost: 1e-12 }
    }
}

/// A setting that an identifier was given and cannot take.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SettingError {
    /// No such setting.
    #[error("solver '{solver}' has no setting '{key}'{known}")]
    Unknown {
        /// Identifier.
        solver: &'static str,
        /// The setting's name.
        key: String,
        /// The settings it has, as text.
        known: String,
    },
    /// The setting exists, its value does not fit.
    #[error("solver '{solver}': setting '{key}' cannot be '{value}': {why}")]
    Value {
        /// Identifier.
        solver: &'static str,
        /// The setting's name.
        key: String,
        /// The value given.
        value: String,
        /// What it must be.
        why: String,
    },
}

/// A way to identify: a plain value of settings. Working state lives for one call of
/// [`identify`](Identifier::identify) only.
pub trait Identifier: Send + Sync {
    /// Registered name.
    fn name(&self) -> &'static str;

    /// One line for people.
    fn summary(&self) -> &'static str;

    /// The form of the problem that it wants.
    fn form(&self) -> Form {
        Form::Minimal
    }

    /// Whether no prediction depends on how {S} and the x axes of joint frames are turned: whether it looks at no single
    /// component of a deviation or of a residual. Bounds of single components in a problem do that besides.
    fn frame_free(&self) -> bool {
        true
    }

    /// Changes a setting; the default has none.
    fn set(&mut self, key: &str, _value: &str) -> Result<(), SettingError> {
        Err(SettingError::Unknown { solver: self.name(), key: key.into(), known: String::new() })
    }

    /// The settings in force, as `(key, value)`.
    fn settings(&self) -> Vec<(&'static str, String)> {
        Vec::new()
    }

    /// Runs from `start` until `stop`. Not converging is an outcome in the report, never a panic.
    fn identify(&self, problem: &dyn Problem, start: &[f64], stop: &Stop) -> Report;
}
