//! `argmin-lm`: Levenberg-Marquardt under argmin's executor.

use super::identifier::{Identifier, Stop};
use super::levenberg::minimise;
use super::report::{Estimate, Report};
use crate::problem::Problem;

/// Plain least squares by [`super::levenberg::LevenbergMarquardt`]; no prior, no bounds.
///
/// It stays where it is in directions that no residual sees, so that a rank-deficient Jacobian is no obstacle.
#[derive(Clone, Copy, Debug, Default)]
pub struct ArgminLm;

impl Identifier for ArgminLm {
    fn name(&self) -> &'static str {
        "argmin-lm"
    }

    fn summary(&self) -> &'static str {
        "Levenberg-Marquardt run by argmin: QR of the augmented Jacobian, column scaling, gain-ratio damping"
    }

    fn identify(&self, problem: &dyn Problem, start: &[f64], stop: &Stop) -> Report {
        let found = minimise(problem, start, stop);
        Report {
            x: found.x,
            cost: found.cost,
            outcome: found.outcome,
            trace: found.trace,
            ..Report::new(self.name(), start, Estimate::LeastSquares)
        }
    }
}
