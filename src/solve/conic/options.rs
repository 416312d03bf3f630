//! The settings of a conic identifier, read from text.

use super::loss::LOSSES;
use super::weight::WeightRule;
use crate::solve::identifier::SettingError;
use crate::solve::settings;

/// Which penalty is on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Regulariser {
    /// None.
    None,
    /// Squared deviation.
    Ridge,
    /// Sum of magnitudes.
    Lasso,
    /// Sum of link deviations.
    GroupLasso,
}

/// Regularisers by name.
const REGULARISERS: &[(&str, Regulariser)] = &[
    ("none", Regulariser::None),
    ("ridge", Regulariser::Ridge),
    ("lasso", Regulariser::Lasso),
    ("group-lasso", Regulariser::GroupLasso),
];

/// Settings of a conic identifier.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Name of the loss.
    pub loss: &'static str,
    /// Threshold of Huber's loss, in standard deviations.
    pub delta: f64,
    /// Penalty.
    pub regulariser: Regulariser,
    /// Its weight, or how to choose it.
    pub weight: WeightRule,
    /// Limit on every coordinate, in units of `x`; infinite for the problem's own bounds only.
    pub bounds: f64,
    /// Limit on the length of every group, in units of `x`; infinite for none.
    pub cone: f64,
}

impl Default for Options {
    /// Least squares within the problem's own bounds. Huber's 1.345 has 95 % efficiency on normal errors.
    fn default() -> Self {
        Self {
            loss: "least-squares",
            delta: 1.345,
            regulariser: Regulariser::None,
            weight: WeightRule::Given(1.0),
            bounds: f64::INFINITY,
            cone: f64::INFINITY,
        }
    }
}

/// Threshold of Huber's loss below which nearly every residual is beyond it: programs of absolute values in all but name,
/// whose steps lead anywhere.
const LEAST_DELTA: f64 = 1e-2;

const KEYS: &[&str] = &["loss", "delta", "regulariser", "weight", "bounds", "cone"];

impl Options {
    /// Changes one setting of the identifier `solver`.
    pub fn set(&mut self, solver: &'static str, key: &str, value: &str) -> Result<(), SettingError> {
        let one_of = |names: &[&str]| {
            settings::refuse(solver, key, value, &format!("it must be one of {}", names.join(", ")))
        };
        match key {
            "loss" => {
                self.loss = LOSSES.iter().find(|name| **name == value).ok_or_else(|| one_of(LOSSES))?;
            }
            "delta" => {
                self.delta = settings::positive(solver, key, value)?;
                if self.delta < LEAST_DELTA {
                    let why = format!("it must be at least {LEAST_DELTA} standard deviations");
                    return Err(settings::refuse(solver, key, value, &why));
                }
            }
            "regulariser" => {
                let names: Vec<&str> = REGULARISERS.iter().map(|(name, _)| *name).collect();
                let found = REGULARISERS.iter().find(|(name, _)| *name == value);
                self.regulariser = found.ok_or_else(|| one_of(&names))?.1;
            }
            "weight" => {
                self.weight = match value {
                    "cv" => WeightRule::CrossValidation,
                    "discrepancy" => WeightRule::Discrepancy,
                    _ => WeightRule::Given(settings::positive(solver, key, value).map_err(|_| {
                        settings::refuse(solver, key, value, "it must be a number above 0, cv or discrepancy")
                    })?),
                }
            }
            "bounds" => self.bounds = limit(solver, key, value)?,
            "cone" => self.cone = limit(solver, key, value)?,
            _ => return Err(settings::unknown(solver, key, KEYS)),
        }
        Ok(())
    }

    /// The settings in force.
    pub fn list(&self) -> Vec<(&'static str, String)> {
        let regulariser =
            REGULARISERS.iter().find(|(_, r)| *r == self.regulariser).map_or("none", |(n, _)| n);
        let limit = |v: f64| if v == f64::INFINITY { "none".into() } else { v.to_string() };
        vec![
            ("loss", self.loss.into()),
            ("delta", self.delta.to_string()),
            ("regulariser", regulariser.into()),
            ("weight", self.weight.to_string()),
            ("bounds", limit(self.bounds)),
            ("cone", limit(self.cone)),
        ]
    }
}

fn limit(solver: &'static str, key: &str, value: &str) -> Result<f64, SettingError> {
    if value == "none" {
        return Ok(f64::INFINITY);
    }
    settings::positive(solver, key, value)
        .map_err(|_| settings::refuse(solver, key, value, "it must be a number above 0, or none"))
}
