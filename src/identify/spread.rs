//! Uncertainty of predicted poses over a workspace, in one number for position and one for rotation.

use crate::calibration::{Calibration, Sample};
use crate::linalg;
use crate::measure::Pose;
use crate::model::{Mechanism, Posture};
use crate::problem::{EvalError, Form, Problem};
use crate::simulate::close;
use faer::Mat;
use nalgebra::Matrix6;
use std::sync::Arc;

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
