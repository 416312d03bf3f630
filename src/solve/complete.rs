//! `complete`: Gauss-Newton on every component of every link, with nothing chosen and nothing safeguarded.

use super::identifier::{Identifier, Stop};
use super::report::{Criterion, Estimate, Failure, Iterate, Outcome, Report};
use crate::linalg::{self, norm};
use crate::problem::{Form, Problem, cost};

/// Full steps `-J^+ r` with a pseudo-inverse at machine precision: what is done where no minimal model is at hand.
///
/// Directions that noise alone can move are taken for real, so that steps may grow without limit; it says so.
#[derive(Clone, Copy, Debug, Default)]
pub struct Complete;

/// Growth of the residual norm over the start beyond which the iteration counts as diverged.
const DIVERGED: f64 = 1e6;

impl Identifier for Complete {
    fn name(&self) -> &'static str {
        "complete"
    }

    fn summary(&self) -> &'static str {
        "full pseudo-inverse steps on all six deviations of every link (baseline; may diverge)"
    }

    fn form(&self) -> Form {
        Form::Complete
    }

    fn identify(&self, problem: &dyn Problem, start: &[f64], stop: &Stop) -> Report {
        let mut report = Report::new(self.name(), start, Estimate::LeastSquares);
        let mut here = match problem.compress(start) {
            Ok(here) => here,
            Err(why) => return report.fail(Failure::Start(why.0)),
        };
        report.cost = here.cost;
        let limit = DIVERGED * DIVERGED * here.cost.max(f64::MIN_POSITIVE);
        for _ in 0..stop.iterations {
            if here.cost == 0.0 {
                report.outcome = Outcome::Converged(Criterion::Zero);
                return report;
            }
            let rounding = f64::EPSILON * here.jac.ncols() as f64;
            let Some(step) = linalg::pseudo_inverse_step(here.jac.as_ref(), &here.r, rounding) else {
                return report.fail(Failure::Diverged);
            };
            let length = norm(&step);
            for (x, dx) in report.x.iter_mut().zip(&step) {
                *x += dx;
            }
            report.cost = problem.residual(&report.x).map_or(f64::INFINITY, |r| cost(&r));
            here = match problem.compress(&report.x) {
                Ok(there) => there,
                Err(why) => return report.fail(Failure::Evaluation(why.0)),
            };
            report.trace.push(Iterate { cost: report.cost, step: length, kept: None });
            if !report.cost.is_finite() || report.cost > limit {
                return report.fail(Failure::Diverged);
            }
            if stop.by_step(length, &report.x) {
                report.outcome = Outcome::Converged(Criterion::Step);
                return report;
            }
        }
        report
    }
}
