//! The iteration (31)-(33) of Chen et al. 2017 without any safeguard: a reference, not a recommendation.

use super::identifier::{Identifier, Stop};
use super::report::{Criterion, Estimate, Failure, Iterate, Outcome, Report};
use crate::linalg::{self, norm};
use crate::problem::{Compressed, Form, Problem, cost};

/// Full steps `dx = N M (Jp)^+ dY` with bases updated at every iterate; no tolerance, no acceptance test.
///
/// On geometries with meeting or parallel axes most singular values are zero at nominal and tiny after the
/// first step, so that it diverges (docs/theory.md section 5); it says so.
#[derive(Clone, Copy, Debug, Default)]
pub struct Textbook;

/// Growth of the residual norm over the start beyond which the iteration counts as diverged.
const DIVERGED: f64 = 1e6;

impl Identifier for Textbook {
    fn name(&self) -> &'static str {
        "textbook"
    }

    fn summary(&self) -> &'static str {
        "the published iteration: full pseudo-inverse steps on 4r+2p+6 unscaled parameters (reference; may diverge)"
    }

    fn form(&self) -> Form {
        Form::Plain
    }

    fn identify(&self, problem: &dyn Problem, start: &[f64], stop: &Stop) -> Report {
        let mut report = Report::new(self.name(), start, Estimate::LeastSquares);
        let first = match problem.residual(start) {
            Ok(r) => norm(&r),
            Err(why) => return report.fail(Failure::Start(why.0)),
        };
        for _ in 0..stop.iterations {
            let here = match problem.compress(&report.x) {
                Ok(here) => here,
                Err(why) => return report.fail(Failure::Evaluation(why.0)),
            };
            let Some(step) = minimal_step(problem, &report.x, &here) else {
                return report.fail(Failure::Diverged);
            };
            let length = norm(&step);
            for (x, dx) in report.x.iter_mut().zip(&step) {
                *x += dx;
            }
            report.cost = match problem.residual(&report.x) {
                Ok(r) => cost(&r),
                Err(why) => {
                    report.cost = f64::INFINITY;
                    return report.fail(Failure::Evaluation(why.0));
                }
            };
            report.trace.push(Iterate { cost: report.cost, step: length, kept: None });
            if !report.cost.is_finite()
                || (2.0 * report.cost).sqrt() > DIVERGED * first.max(f64::MIN_POSITIVE)
            {
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

/// `-N M (J N M)^+ r`: the pseudo-inverse on the orthogonal complement of the structural redundancy (31), (32).
fn minimal_step(problem: &dyn Problem, x: &[f64], here: &Compressed) -> Option<Vec<f64>> {
    let complement = linalg::complement(problem.redundant(x).as_ref())?;
    let rounding = f64::EPSILON * here.jac.ncols() as f64;
    let z = linalg::pseudo_inverse_step((&here.jac * &complement).as_ref(), &here.r, rounding)?;
    Some(linalg::mul(complement.as_ref(), &z))
}
