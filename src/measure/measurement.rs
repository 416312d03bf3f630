//! The interface between an instrument's readings and the kinematics.

use crate::lie::Se3;
use std::sync::Arc;

/// One whitened residual and its derivative by the tool twist `[w; dp]` (rad, m; {S} axes, at the tool point).
#[derive(Clone, Copy, Debug, Default)]
pub struct Row {
    /// Predicted minus measured, in standard deviations.
    pub r: f64,
    /// Derivative by the tool twist.
    pub by_tool: [f64; 6],
}

impl Row {
    /// The rows, each times its residual, added up: `|r|^2` with the derivative of `|r|^2 / 2`.
    pub fn weighted_sum(rows: &[Row]) -> Row {
        let mut sum = Row::default();
        for row in rows {
            sum.r += row.r * row.r;
            for (total, by) in sum.by_tool.iter_mut().zip(row.by_tool) {
                *total += row.r * by;
            }
        }
        sum
    }
}

/// Weights by which a measurement's residuals may be multiplied instead of its stated noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Weights {
    /// None: residuals in rad and m, displacements those of the tool point.
    Unit,
    /// None, and the unweighted spatial twist in place of the tool point's displacement (30).
    SpatialTwist,
    /// Isotropic noise of one standard deviation.
    Isotropic {
        /// Of each rotation component, rad.
        angle: f64,
        /// Of each length, m.
        length: f64,
    },
}

/// Distance between a predicted pose and the measured one, of the parts that were measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseError {
    /// Angle of the rotation between them, rad.
    pub rotation: Option<f64>,
    /// Displacement of the tool point, m.
    pub position: Option<f64>,
}

/// Readings of one posture. The chain rule through the tool twist is all that it shares with the kinematics,
/// so that a new kind of measurement never touches them.
pub trait Measurement: std::fmt::Debug + Send + Sync {
    /// Number of residuals.
    fn rows(&self) -> usize;

    /// Residuals at the predicted tool pose, written over `rows` (of that number).
    fn evaluate(&self, tool: &Se3, rows: &mut [Row]);

    /// The measured pose, where there is a whole one: the posture is sought from it.
    fn pose(&self) -> Option<&Se3>;

    /// The same readings with no pose to start from, for an instrument whose frame is not known yet.
    fn without_pose(&self) -> Arc<dyn Measurement>;

    /// The measured position of the tool point, where there is one.
    fn position(&self) -> Option<nalgebra::Vector3<f64>>;

    /// How far the predicted tool pose is from the measured one.
    fn error(&self, tool: &Se3) -> PoseError;

    /// What the same instrument would read at this tool pose without noise.
    fn expected(&self, tool: &Se3) -> Arc<dyn Measurement>;

    /// The same readings, weighted otherwise.
    fn reweighted(&self, weights: Weights) -> Arc<dyn Measurement>;
}
