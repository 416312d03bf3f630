//! `map`: the maximum-a-posteriori estimate, data and stated tolerances together.

use super::anchored::Anchored;
use super::identifier::{Identifier, SettingError, Stop};
use super::levenberg::minimise;
use super::report::{Estimate, Failure, Report};
use super::settings;
use crate::problem::{Problem, cost};

/// `min |r(x)|^2 + weight |x|^2` with x in tolerances: at weight 1 the Bayesian estimate for Gaussian noise and
/// tolerances (docs/theory.md section 6). Steps are accepted on this merit, not on the linear model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Map {
    /// Factor on the prior, dimensionless; 1 trusts the stated tolerances.
    pub weight: f64,
}

impl Default for Map {
    fn default() -> Self {
        Self { weight: 1.0 }
    }
}

impl Identifier for Map {
    fn name(&self) -> &'static str {
        "map"
    }

    fn summary(&self) -> &'static str {
        "maximum a posteriori: residual and deviation in tolerances together, a unit ridge"
    }

    fn set(&mut self, key: &str, value: &str) -> Result<(), SettingError> {
        match key {
            "weight" => {
                self.weight = settings::positive(self.name(), key, value)?;
                Ok(())
            }
            _ => Err(settings::unknown(self.name(), key, &["weight"])),
        }
    }

    fn settings(&self) -> Vec<(&'static str, String)> {
        vec![("weight", self.weight.to_string())]
    }

    fn identify(&self, problem: &dyn Problem, start: &[f64], stop: &Stop) -> Report {
        let report = Report::new(self.name(), start, Estimate::Ridge { weight: self.weight });
        if !problem.has_prior() {
            return report.fail(Failure::Unsuited(
                "its parameters have no tolerances that could serve as prior".into(),
            ));
        }
        let found = minimise(&Anchored::ridge(problem, self.weight), start, stop);
        Report {
            cost: problem.residual(&found.x).map_or(f64::INFINITY, |r| cost(&r)),
            x: found.x,
            outcome: found.outcome,
            trace: found.trace,
            ..report
        }
    }
}
