//! `argmin-trust-region`: argmin's own trust-region method with Steihaug's conjugate gradients, a baseline.

use super::argmin_adapter::run;
use super::identifier::{Identifier, Stop};
use super::report::Report;
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
        run(self.name(), problem, start, stop, true, |from| {
            // The conjugate gradients end after n steps in exact arithmetic; rounding may take a few more.
            let steps = Steihaug::new().with_max_iters(2 * from.len() as u64 + 10);
            TrustRegion::new(steps).with_radius(norm(from).max(1.0))?.with_max_radius(LARGEST_RADIUS)
        })
    }
}
