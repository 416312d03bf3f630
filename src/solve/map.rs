//! `map`: the maximum-a-posteriori estimate, data and stated tolerances together.

use super::anchored::Anchored;
use super::identifier::{Identifier, SettingError, Stop};
use super::levenberg::minimise;
use super::minimal::Minimal;
use super::report::{Estimate, Failure, Outcome, Report};
use super::settings;
use super::split::Split;
use crate::problem::{Problem, cost};

/// Part of the iterations, one in so many, that Levenberg's method has.
const FIRST: usize = 4;
/// Iterations that it has at least.
const LEAST: usize = 12;

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
        ridge(problem, self.weight, start, stop, report)
    }
}

/// The optimum under the full prior times `weight`, from `start`; `report` is of the estimate. Far from it the radius of
/// Levenberg's method is what leads there. After a part of the iterations the rest is left to steps that know the curvature of
/// flat valleys.
pub(super) fn ridge(
    problem: &dyn Problem,
    weight: f64,
    start: &[f64],
    stop: &Stop,
    report: Report,
) -> Report {
    let first = Stop { iterations: stop.iterations.div_ceil(FIRST).max(LEAST).min(stop.iterations), ..*stop };
    let found = minimise(&Anchored::ridge(problem, weight), start, &first);
    let report = Report { x: found.x, outcome: found.outcome, trace: found.trace, ..report };
    if report.outcome == Outcome::OutOfIterations {
        return Minimal::default().iterate(problem, Some(Split::ridge(start.len(), weight)), stop, report);
    }
    Report { cost: problem.residual(&report.x).map_or(f64::INFINITY, |r| cost(&r)), ..report }
}
