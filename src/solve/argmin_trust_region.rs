//! `argmin-trust-region`: argmin's own trust-region method with Steihaug's conjugate gradients, a baseline.

use super::argmin_adapter::run;
use super::identifier::{Identifier, Stop};
use super::report::{Estimate, Failure, Report};
use crate::linalg::norm;
use crate::problem::Problem;
use argmin::solver::trustregion::{Steihaug, TrustRegion};

/// Trust region on `J'J` with a spherical radius: no scaling of the parameters.
#[derive(Clone, Copy, Debug, Default)]
pub struct ArgminTrustRegion;

/// Largest radius; argmin's default of 100 does not reach parameters of 1e5.
const LARGEST_RADIUS: f64 = 1e12;

impl Identifier for ArgminTrustRegion {
    fn name(&self) -> &'static str {
        "argmin-trust-region"
    }

    fn summary(&self) -> &'static str {
        "argmin's own trust region with Steihaug's steps on J'J (baseline: no scaling)"
    }

    fn identify(&self, problem: &dyn Problem, start: &[f64], stop: &Stop) -> Report {
        // The conjugate gradients end by themselves in exact arithmetic after n steps; rounding may take a few more.
        let steps = Steihaug::new().with_max_iters(2 * start.len() as u64 + 10);
        let method = TrustRegion::new(steps)
            .with_radius(norm(start).max(1.0))
            .and_then(|method| method.with_max_radius(LARGEST_RADIUS));
        match method {
            Ok(method) => run(self.name(), problem, start, stop, true, method),
            Err(why) => {
                Report::new(self.name(), start, Estimate::LeastSquares).fail(Failure::Inner(why.to_string()))
            }
        }
    }
}
