//! Box: limits on single coordinates; a coordinate whose limits coincide is held.

use super::loss::Frame;
use super::program::{Owner, Program};

/// Adds `lower <= u <= upper`.
pub fn pose(program: &mut Program, frame: &Frame, lower: &[f64], upper: &[f64]) {
    let x = &frame.here.x;
    for (j, unit) in frame.unit.iter().enumerate() {
        if lower[j] == upper[j] {
            program.equal([(j, 1.0)], (upper[j] - x[j]) / unit, Owner::Param(j));
        }
    }
    for (j, unit) in frame.unit.iter().enumerate() {
        if lower[j] < upper[j] {
            if upper[j] < f64::INFINITY {
                program.at_most([(j, 1.0)], (upper[j] - x[j]) / unit, Owner::Param(j));
            }
            if lower[j] > f64::NEG_INFINITY {
                program.at_most([(j, -1.0)], (x[j] - lower[j]) / unit, Owner::Param(j));
            }
        }
    }
}
