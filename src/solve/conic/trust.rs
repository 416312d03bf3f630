//! Trust region: a limit on the step, because the program believes its linear model.

use super::loss::Frame;
use super::program::{Owner, Program};

/// Length of a step in the metric of the trust region.
pub fn length(metric: &[f64], from: &[f64], to: &[f64]) -> f64 {
    metric.iter().zip(from.iter().zip(to)).map(|(d, (a, b))| (d * (b - a)).powi(2)).sum::<f64>().sqrt()
}

/// Adds `|metric (u - x)| <= radius`.
pub fn pose(program: &mut Program, frame: &Frame, metric: &[f64], radius: f64) {
    let tail = frame.unit.iter().zip(metric).enumerate().map(|(j, (unit, d))| (j, d * unit / radius, 0.0));
    program.within((None, 1.0), tail, Owner::Nobody);
}
