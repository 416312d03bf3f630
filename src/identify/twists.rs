//! How the poses of closed postures answer to the deviations of the links (docs/theory.md (10.3)).

use crate::calibration::{ByPosture, Calibration, Sample};
use crate::lie::Se3;
use crate::measure::Pose;
use crate::model::Mechanism;
use crate::problem::{EvalError, Form, Problem};
use faer::Mat;
use nalgebra::Matrix6;
use std::sync::Arc;

/// Tool twists `[w; dp]` (rad and m, {S} axes, dp that of the tool point), six rows a posture in the order given, by the
/// coordinates of `form` at link deviations `at` (rad, m; six per link).
///
/// A posture is given by its actuator variables (rad, m) and by the pose that it has there: closing begins at that pose,
/// so that the branch is the known one. The error names the posture that does not close.
pub fn twists_by_links(
    mechanism: &Mechanism,
    postures: &[(&[f64], Se3)],
    form: Form,
    at: &[f64],
) -> Result<Mat<f64>, EvalError> {
    let sample = |(k, (actuators, pose)): (usize, &(&[f64], Se3))| {
        let measurement = Pose::new(*pose, [true; 6], &Matrix6::identity());
        let measurement = Arc::new(measurement.map_err(|why| EvalError(why.to_string()))?);
        Ok(Sample { name: format!("posture {}", k + 1), actuators: actuators.to_vec(), measurement })
    };
    let samples = postures.iter().enumerate().map(sample).collect::<Result<Vec<_>, EvalError>>()?;
    // Postures given more than once would be taken together: row by row in the order given, each by itself.
    let parts = ByPosture::of(&samples).apart();
    let mut out: Option<Mat<f64>> = None;
    for part in &parts {
        let own: Vec<Sample> = part.iter().map(|i| samples[*i].clone()).collect();
        let problem = Calibration::new(mechanism, &own, form, at);
        if let Some(aside) = problem.set_aside().first() {
            return Err(EvalError(format!("{}: {}", aside.name, aside.reason.unitless())));
        }
        let jac = problem.linearize(&problem.coordinates().nearest(at))?.jac;
        if parts.len() == 1 {
            return Ok(jac);
        }
        let all = out.get_or_insert_with(|| Mat::zeros(6 * samples.len(), jac.ncols()));
        for (k, i) in part.iter().enumerate() {
            all.as_mut().subrows_mut(6 * i, 6).copy_from(jac.as_ref().subrows(6 * k, 6));
        }
    }
    out.ok_or_else(|| EvalError("no postures".into()))
}
