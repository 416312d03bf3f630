//! Curved valleys: steps led back to their floor.

use super::split::Model;
use crate::problem::Problem;

/// Steps back to the floor.
const STEPS: usize = 3;
/// Part of the merit before, up to which another step is worth its evaluation.
const FALLING: f64 = 0.5;

/// Where a step ended.
pub struct End {
    /// The point.
    pub x: Vec<f64>,
    /// `|r|^2 / 2` there.
    pub cost: f64,
    /// Of the cost.
    pub gradient: Vec<f64>,
}

/// The step `dx` from `x` with its end led back to the floor of the valley, and that end. The curvature of directions that
/// the data know well, over a long step along those that they hardly know, costs more than the step gains; a step of the
/// model at its end takes that away. `None` where the merit stays above `merit`.
pub fn floor(
    problem: &dyn Problem,
    model: &Model,
    (x, merit): (&[f64], f64),
    mut dx: Vec<f64>,
    damping: f64,
) -> Option<(Vec<f64>, End)> {
    let mut before = f64::INFINITY;
    for _ in 0..STEPS {
        let at: Vec<f64> = x.iter().zip(&dx).map(|(x, dx)| x + dx).collect();
        let here = problem.compress(&at).ok()?;
        // The split is that of the step, so that the merit is one and the same; its threshold is of no account.
        let there = Model::at(&here, &at, 1.0, true, Some(model.split.clone()))?;
        let back = there.fresh_step(damping)?;
        let end: Vec<f64> = at.iter().zip(&back).map(|(x, dx)| x + dx).collect();
        dx.iter_mut().zip(&back).for_each(|(dx, back)| *dx += back);
        let (cost, gradient) = problem.gradient(&end).ok()?;
        let reached = cost + model.split.penalty(&end);
        if reached <= merit {
            return Some((dx, End { x: end, cost, gradient }));
        }
        if reached > FALLING * before {
            break;
        }
        before = reached;
    }
    None
}
