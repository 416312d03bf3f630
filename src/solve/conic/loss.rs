//! What a residual costs: the trait that every loss fulfils, and the losses by name.

use super::chebyshev::Chebyshev;
use super::here::{Here, Quadratic};
use super::huber::Huber;
use super::least_squares::LeastSquares;
use super::program::{Program, Solution};

use std::ops::Range;

/// The step variables of a program in terms of the point: `u_i = x_i + unit_i step_i`.
#[derive(Clone, Debug)]
pub struct Frame<'a> {
    /// The problem at the point.
    pub here: &'a Here,
    /// Size of one unit of each step variable, in units of `x`.
    pub unit: Vec<f64>,
}

/// A convex cost of residuals.
pub trait Loss: Send + Sync + std::fmt::Debug {
    /// Name in settings.
    fn name(&self) -> &'static str;

    /// Whether it looks at single residuals, so that rows cannot be compressed.
    fn needs_rows(&self) -> bool {
        true
    }

    /// Whether it has a derivative everywhere. Where not, linear programs creep along valleys whose curvature they
    /// do not see, and a run ends when it no longer gets on.
    fn smooth(&self) -> bool {
        true
    }

    /// The same for a residual of so many rows, of which the last `prior` are a prior's; `blocks` are those measured
    /// together, empty where every row stands for itself.
    fn arranged(&self, blocks: &[Range<usize>], rows: usize, prior: usize) -> Box<dyn Loss>;

    /// Cost of a residual (m, or compressed where rows are not needed).
    fn merit(&self, r: &[f64]) -> f64;

    /// Derivative of the cost by the residual.
    fn influence(&self, r: &[f64]) -> Vec<f64>;

    /// The loss to use while residuals are as large as `r`: an easier one far from the solution, or itself.
    fn at_scale(&self, r: &[f64]) -> Box<dyn Loss>;

    /// What to write out in the first program for a step from `here`, as ascending numbers that the loss alone
    /// interprets: rows, or sides of rows.
    fn working_set(&self, here: &Here) -> Vec<usize>;

    /// Writes the cost of the step into the program.
    fn pose(&self, program: &mut Program, frame: &Frame, working: &[usize]);

    /// What is missing from the working set, given the residual that the step predicts.
    fn missing(&self, predicted: &[f64], working: &[usize]) -> Vec<usize>;

    /// The quadratic that equals the cost about the predicted residual; `None` where there is no such.
    fn quadratic(&self, here: &Here, predicted: &[f64]) -> Option<Quadratic>;

    /// Least of the loss under the linear model along `weights`, a derivative by the residual as `dual_influence`
    /// gives it: the value at `r` of a supporting plane through zero. `None` where the loss has a derivative, which
    /// judges better.
    fn supported(&self, _r: &[f64], _weights: &[f64]) -> Option<f64> {
        None
    }

    /// Derivative by the residual from the dual variables of a solved program, where `influence` is not unique.
    fn dual_influence(&self, _here: &Here, _working: &[usize], _solution: &Solution) -> Option<Vec<f64>> {
        None
    }
}

/// Names of the losses.
pub const LOSSES: &[&str] = &["least-squares", "huber", "minimax"];

/// The loss of that name, before it is arranged; `delta` is Huber's threshold in standard deviations.
pub fn loss(name: &str, delta: f64) -> Option<Box<dyn Loss>> {
    match name {
        "least-squares" => Some(Box::new(LeastSquares)),
        "huber" => Some(Box::new(Huber { delta, blocks: None })),
        "minimax" => Some(Box::new(Chebyshev)),
        _ => None,
    }
}
