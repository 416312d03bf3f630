//! How far a step may go: the radius of Moré's trust region and the damping that belongs to it.

use super::damped::{DampedStep, LEAST_DAMPING, damped_step, raise_scale, step_within};
use crate::linalg::norm;
use crate::problem::Compressed;
use serde::{Deserialize, Serialize};

/// Damping of the step that sets the first radius at the origin, relative to the squared column norms.
const FIRST_DAMPING: f64 = 1e-3;
/// First radius, relative to the length of that step, that is not too short to begin with.
const LEAST_RADIUS: f64 = 1e-6;
/// Ratio of successive steps up to which they count as converging.
const CONTRACTION: f64 = 0.9;
/// Undamped step, relative to every coordinate, that is short enough to call the point a solution.
const ARRIVED: f64 = 1e-7;

/// Scale, radius and damping of a run.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Region {
    radius: Option<f64>,
    damping: f64,
    scale: Vec<f64>,
    /// Whether coordinates count in tolerances, which need no other scale.
    tolerances: bool,
}

impl Default for Region {
    fn default() -> Self {
        Self { radius: None, damping: FIRST_DAMPING, scale: Vec::new(), tolerances: false }
    }
}

impl Region {
    /// Largest `|D dx|`; infinite before the first step.
    pub fn radius(&self) -> f64 {
        self.radius.unwrap_or(f64::INFINITY)
    }

    /// A region for coordinates in tolerances, or else in units that only the Jacobian knows.
    pub fn new(tolerances: bool) -> Self {
        Self { tolerances, ..Self::default() }
    }

    /// Raises the scale to the column norms of a new Jacobian.
    ///
    /// Coordinates in tolerances stay as they are: far from the solution a posture near a singularity has columns
    /// so long that a region shaped by them reaches hundreds of tolerances along the weak directions, to where
    /// loops no longer close.
    pub fn see(&mut self, here: &Compressed) {
        if self.tolerances {
            self.scale = vec![1.0; here.jac.ncols()];
        } else {
            raise_scale(&mut self.scale, &here.jac);
        }
    }

    /// The step within the radius, which at the start is the length of the point itself.
    pub fn step(&mut self, x: &[f64], here: &Compressed) -> Option<DampedStep> {
        let radius = match self.radius {
            Some(radius) => radius,
            None => {
                let scaled: Vec<f64> = x.iter().zip(&self.scale).map(|(x, d)| x * d).collect();
                // From the origin there is no length to compare with: a moderately damped step sets it. The same
                // where only coordinates without effect are away from zero.
                let damped = damped_step(here, &self.scale, FIRST_DAMPING)?.length;
                match norm(&scaled) {
                    0.0 => damped,
                    length => length.max(LEAST_RADIUS * damped),
                }
            }
        };
        self.radius = Some(radius);
        let step = step_within(here, &self.scale, radius, self.damping)?;
        self.damping = step.damping;
        Some(step)
    }

    /// The radius for the next step (Moré 1978, section 7, in the form of MINPACK's `lmder`).
    pub fn resize(&mut self, ratio: f64, step: &DampedStep) {
        let radius = self.radius.unwrap_or(step.length).min(10.0 * step.length);
        self.radius = Some(if ratio <= 0.25 {
            // The minimiser of the parabola through both costs and the slope, within [0.1, 0.5].
            let least = 1.0 / (2.0 * (1.0 - ratio.max(-1e3)));
            radius * least.clamp(0.1, 0.5)
        } else if ratio >= 0.75 || step.undamped {
            2.0 * step.length
        } else {
            radius
        });
    }

    /// Whether the next step is shorter than the last: the sign of convergence that rounding does not hide.
    pub fn contracts(&self, there: &Compressed, step: &DampedStep) -> bool {
        damped_step(there, &self.scale, step.damping)
            .is_some_and(|next| next.length <= CONTRACTION * step.length)
    }

    /// Whether even the undamped step is short: a cost of rounding errors only has cosines that mean nothing.
    pub fn arrived(&self, x: &[f64], here: &Compressed) -> bool {
        damped_step(here, &self.scale, LEAST_DAMPING)
            .is_some_and(|free| free.dx.iter().zip(x).all(|(dx, x)| dx.abs() <= ARRIVED * x.abs()))
    }
}
