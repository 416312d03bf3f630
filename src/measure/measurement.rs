//! The interface between an instrument's readings and the kinematics.

use crate::lie::Se3;

/// One whitened residual and its derivative by the tool twist `[w; dp]` (rad, m; {S} axes, at the tool point).
#[derive(Clone, Copy, Debug, Default)]
pub struct Row {
    /// Predicted minus measured, in standard deviations.
    pub r: f64,
    /// Derivative by the tool twist.
    pub by_tool: [f64; 6],
}

/// Readings of one posture. The chain rule through the tool twist is all that it shares with the kinematics,
/// so that a new kind of measurement never touches them.
pub trait Measurement: std::fmt::Debug + Send + Sync {
    /// Number of residuals.
    fn rows(&self) -> usize;

    /// Residuals at the predicted tool pose, written over `rows` (of that number).
    fn evaluate(&self, tool: &Se3, rows: &mut [Row]);

    /// The measured pose, where there is one: the posture is sought from it.
    fn pose(&self) -> Option<&Se3>;
}
