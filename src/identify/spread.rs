//! Uncertainty of predicted poses over a workspace, in one number for position and one for rotation.

use super::twists::twists_by_links;
use crate::lie::Se3;
use crate::linalg;
use crate::model::{Mechanism, Posture};
use crate::problem::{EvalError, Form};
use crate::simulate::close;
use faer::Mat;

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
    let known: Vec<(&[f64], Se3)> =
        postures.iter().map(|(q, posture)| (q.as_slice(), posture.tool())).collect();
    let jac = twists_by_links(mechanism, &known, Form::Minimal, at)?;
    let spread = |(k, (_, posture)): (usize, &(&Vec<f64>, Posture))| {
        let part = |first: usize| {
            let rows = (first..first + 3).map(|i| {
                let row: Vec<f64> = jac.row(6 * k + i).iter().copied().collect();
                linalg::norm(&linalg::mul_transpose(root.as_ref(), &row))
            });
            linalg::norm(&rows.collect::<Vec<_>>())
        };
        PoseSpread { tool: posture.tool().p, rotation: part(0), position: part(3) }
    };
    Ok(postures.iter().enumerate().map(spread).collect())
}
