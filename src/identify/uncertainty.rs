//! Linear theory of the estimate: what it leaves open, of links and of poses (docs/theory.md section 10).

use super::counts::Visibility;
use crate::calibration::{Calibration, Sample};
use crate::linalg;
use crate::measure::Pose;
use crate::model::{Mechanism, Posture};
use crate::problem::{EvalError, Form, Problem};
use crate::simulate::close;
use crate::solve::Estimate;
use crate::solve::split::prior_weight;
use faer::Mat;
use nalgebra::Matrix6;
use std::sync::Arc;

/// Weight of the prior on a direction of singular value `s`; `None` where linear theory does not apply.
///
/// Least squares without any prior has no finite error along directions that the data cannot see; there the
/// tolerance stands in for it.
pub fn weight(estimate: Estimate, s: f64) -> Option<f64> {
    match estimate {
        Estimate::Split { threshold } => Some(prior_weight(s / threshold)),
        Estimate::Ridge { weight } => Some(weight),
        Estimate::LeastSquares => Some(if s > 1e-6 { 0.0 } else { 1.0 }),
        Estimate::Other => None,
    }
}

/// Square root `V (S^2 + W)^-1/2` of the covariance of the minimal coordinates, a column per direction in the order
/// of the singular values; `None` where linear theory does not apply.
pub fn root(seen: &Visibility, estimate: Estimate) -> Option<Mat<f64>> {
    let mut root = seen.directions.clone();
    for (k, s) in seen.singular_values.iter().enumerate() {
        let scale = 1.0 / (s * s + weight(estimate, *s)?).sqrt();
        root.as_mut().col_mut(k).iter_mut().for_each(|v| *v *= scale);
    }
    Some(root)
}

/// What the uncertainty of the links makes of a predicted pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseSpread {
    /// The predicted tool point, m.
    pub tool: nalgebra::Vector3<f64>,
    /// Root mean square displacement of the tool point, m.
    pub position: f64,
    /// Root mean square angle, rad.
    pub rotation: f64,
}

/// Predicted poses at these actuator variables (rad, m), with their uncertainty, for links deviating by `at` with a
/// covariance of square root `root`. Postures that do not close are left out.
pub fn pose_spreads(
    mechanism: &Mechanism,
    at: &[f64],
    root: &Mat<f64>,
    actuators: &[Vec<f64>],
) -> Result<Vec<PoseSpread>, EvalError> {
    let geometry = mechanism.deviated(at);
    let mut postures: Vec<(&Vec<f64>, Posture)> = Vec::with_capacity(actuators.len());
    for actuators in actuators {
        if let Ok(posture) = close(mechanism, &geometry, actuators) {
            postures.push((actuators, posture));
        }
    }
    let mut samples = Vec::with_capacity(postures.len());
    for (actuators, posture) in &postures {
        let unit = Pose::new(posture.tool(), [true; 6], &Matrix6::identity());
        let unit = unit.map_err(|why| EvalError(why.to_string()))?;
        samples.push(Sample {
            name: String::new(),
            actuators: actuators.to_vec(),
            measurement: Arc::new(unit),
        });
    }
    let problem = Calibration::new(mechanism, &samples, Form::Minimal, at);
    let jac = problem.linearize(&problem.coordinates().nearest(at))?.jac;
    let aside: Vec<usize> = problem.set_aside().iter().map(|s| s.sample).collect();
    let kept = samples.iter().zip(&postures).enumerate().filter(|(k, _)| !aside.contains(k));
    let mut spreads = Vec::with_capacity(samples.len());
    for (block, (_, (_, (_, posture)))) in kept.enumerate() {
        let part = |first: usize| {
            let rows = (first..first + 3).map(|i| {
                let row: Vec<f64> = jac.row(6 * block + i).iter().copied().collect();
                linalg::norm(&linalg::mul_transpose(root.as_ref(), &row))
            });
            linalg::norm(&rows.collect::<Vec<_>>())
        };
        spreads.push(PoseSpread { tool: posture.tool().p, rotation: part(0), position: part(3) });
    }
    Ok(spreads)
}
