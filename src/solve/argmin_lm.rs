//! `argmin-lm`: Levenberg-Marquardt under argmin's executor.

use super::anchored::{SETTLED, settle};
use super::identifier::{Identifier, SettingError, Stop};
use super::levenberg::minimise;
use super::report::Report;
use super::settings;
use crate::problem::Problem;

/// Least squares by [`super::levenberg::LevenbergMarquardt`].
///
/// Where the problem has a prior it stands, as in `minimal`, on the directions that the tolerance knows better than
/// the data: both minimise the same, by different steps. A rank-deficient Jacobian is no obstacle to either.
#[derive(Clone, Copy, Debug)]
pub struct ArgminLm {
    /// Signal-to-noise ratio up to which a direction has the prior's full weight.
    pub threshold: f64,
}

/// How much smaller a gradient must be where weak directions have a prior.
const WEAK: f64 = 1e-3;

impl Default for ArgminLm {
    fn default() -> Self {
        Self { threshold: 1.0 }
    }
}

impl Identifier for ArgminLm {
    fn name(&self) -> &'static str {
        "argmin-lm"
    }

    fn summary(&self) -> &'static str {
        "Levenberg-Marquardt run by argmin: QR of the augmented Jacobian, column scaling, trust-region damping"
    }

    fn set(&mut self, key: &str, value: &str) -> Result<(), SettingError> {
        match key {
            "threshold" => {
                self.threshold = settings::positive(self.name(), key, value)?;
                Ok(())
            }
            _ => Err(settings::unknown(self.name(), key, &["threshold"])),
        }
    }

    fn settings(&self) -> Vec<(&'static str, String)> {
        vec![("threshold", self.threshold.to_string())]
    }

    fn identify(&self, problem: &dyn Problem, start: &[f64], stop: &Stop) -> Report {
        let estimate = settings::estimate(problem, self.threshold);
        let report = Report::new(self.name(), start, estimate);
        settle(problem, start, self.threshold, SETTLED, stop, report, |problem, from, stop| {
            // A gradient that is nothing by the columns of the Jacobian leaves weak directions short of where the prior
            // has them: the cost or the step ends a run there.
            let gradient = if problem.has_prior() { WEAK * stop.gradient } else { stop.gradient };
            let found = minimise(problem, from, &Stop { gradient, ..*stop });
            Report {
                x: found.x,
                cost: found.cost,
                outcome: found.outcome,
                trace: found.trace,
                ..Report::new(self.name(), from, estimate)
            }
        })
    }
}
