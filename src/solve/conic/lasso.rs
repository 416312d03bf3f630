//! Lasso: the sum of magnitudes, which leaves most coordinates at exactly nominal.

use super::loss::Frame;
use super::program::{Owner, Program};

/// `sum |x_i|`.
pub fn merit(x: &[f64]) -> f64 {
    x.iter().map(|v| v.abs()).sum()
}

/// Adds `weight sum |u_i|` through `|u_i| <= |x_i| + t_i`, which the point itself satisfies with `t = 0`.
pub fn pose(program: &mut Program, frame: &Frame, weight: f64) {
    for (j, unit) in frame.unit.iter().enumerate() {
        let size = program.variable(0.0, weight * unit);
        let at = frame.here.x[j] / unit;
        program.at_most([(j, 1.0), (size, -1.0)], at.abs() - at, Owner::Nobody);
        program.at_most([(j, -1.0), (size, -1.0)], at.abs() + at, Owner::Nobody);
    }
}
