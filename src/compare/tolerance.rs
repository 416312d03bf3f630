//! Named tolerances: one name sets the rules by which identifiers stop and the check of what they return.

use crate::solve::Stop;
use serde::{Deserialize, Serialize};

/// Rules to stop by, and limits of the check that follows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tolerance {
    /// `fast`, `default` or `tight`.
    pub name: String,
    /// Every identifier's rules.
    pub stop: Stop,
    /// Largest relative offset (docs/theory.md (13.1)): distance from the stationary point, in units of the
    /// uncertainty of the estimate.
    pub offset: f64,
    /// Part by which the cost may exceed that of the truth with its prior (13.2).
    pub cost: f64,
    /// Largest error of predicted poses, in units of the Cramer-Rao bound.
    pub prediction: f64,
}

impl Tolerance {
    /// The names there are.
    pub const NAMES: [&str; 3] = ["fast", "default", "tight"];

    /// The tolerance of that name; `None` where there is none.
    ///
    /// The limit of 1e-3 on the offset is that of Bates and Watts (1981). A prediction three times as far off as the
    /// bound is rarer than one in a thousand even where three directions decide it.
    pub fn named(name: &str) -> Option<Self> {
        let (stop, offset) = match name {
            "fast" => (Stop { iterations: 50, step: 1e-4, gradient: 1e-4, cost: 1e-5 }, 0.3),
            "default" => (Stop::default(), 0.1),
            "tight" => (Stop { iterations: 1000, step: 1e-12, gradient: 1e-12, cost: 1e-15 }, 1e-3),
            _ => return None,
        };
        Some(Self { name: name.into(), stop, offset, cost: 0.01, prediction: 3.0 })
    }
}
