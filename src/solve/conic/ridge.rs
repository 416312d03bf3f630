//! Ridge: the squared deviation, in tolerance units.

use super::loss::Frame;
use super::program::Program;

/// `|x|^2 / 2`.
pub fn merit(x: &[f64]) -> f64 {
    0.5 * x.iter().map(|v| v * v).sum::<f64>()
}

/// Adds `weight |u|^2 / 2`.
pub fn pose(program: &mut Program, frame: &Frame, weight: f64) {
    for (j, unit) in frame.unit.iter().enumerate() {
        program.quadratic[(j, j)] += weight * unit * unit;
        program.linear[j] += weight * unit * frame.here.x[j];
    }
}
