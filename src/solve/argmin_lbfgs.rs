//! `argmin-lbfgs`: argmin's own L-BFGS, a baseline that knows gradients only.

use super::argmin_adapter::run;
use super::identifier::{Identifier, Stop};
use super::report::Report;
use crate::problem::Problem;
use argmin::solver::linesearch::MoreThuenteLineSearch;
use argmin::solver::quasinewton::LBFGS;

/// Limited-memory BFGS with Moré and Thuente's line search.
///
/// The line search cannot turn back from a point without a value: there the run ends.
#[derive(Clone, Copy, Debug, Default)]
pub struct ArgminLbfgs;

/// Pairs of steps and gradient differences remembered, argmin's own example value.
const MEMORY: usize = 7;

impl Identifier for ArgminLbfgs {
    fn name(&self) -> &'static str {
        "argmin-lbfgs"
    }

    fn summary(&self) -> &'static str {
        "argmin's own L-BFGS on the gradient (baseline: many cheap steps, no scaling)"
    }

    fn identify(&self, problem: &dyn Problem, start: &[f64], stop: &Stop) -> Report {
        run(self.name(), problem, start, stop, false, |_| {
            Ok(LBFGS::new(MoreThuenteLineSearch::new(), MEMORY))
        })
    }
}
