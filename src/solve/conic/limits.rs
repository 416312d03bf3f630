//! The limits in force: where they come from, and which hold with equality.

use super::loss::Frame;
use super::program::Program;
use super::{bounds, cones};
use crate::problem::{Group, Problem};

/// How nearly a cone is reached to count as active.
const REACHED: f64 = 1e-10;

/// Box and cones on `x`.
#[derive(Clone, Debug)]
pub struct Limits {
    /// Lower limit of every coordinate, may be infinite.
    pub lower: Vec<f64>,
    /// Upper limit of every coordinate, may be infinite.
    pub upper: Vec<f64>,
    /// Limit on the length of every group, infinite where there is none.
    pub cone: f64,
}

impl Limits {
    /// The problem's own bounds, narrowed to `|x_i| <= width` and `|x_group| <= cone`; the names of the coordinates
    /// whose limits exclude each other where there are such.
    pub fn of(problem: &dyn Problem, width: f64, cone: f64) -> Result<Self, Vec<String>> {
        let params = problem.params();
        let lower: Vec<f64> = params.iter().map(|p| p.bounds.0.max(-width)).collect();
        let upper: Vec<f64> = params.iter().map(|p| p.bounds.1.min(width)).collect();
        // Clarabel calls a gap of 1e-9 solved: what can be seen is not left to it. A bound of NaN excludes all.
        let reversed: Vec<String> = params
            .iter()
            .filter(|p| p.bounds.0.is_nan() || p.bounds.1.is_nan())
            .chain(params.iter().zip(lower.iter().zip(&upper)).filter(|(_, (l, u))| l > u).map(|(p, _)| p))
            .map(|p| p.name.clone())
            .collect();
        if reversed.is_empty() { Ok(Self { lower, upper, cone }) } else { Err(reversed) }
    }

    /// No limits on `n` coordinates.
    pub fn unlimited(n: usize) -> Self {
        Self { lower: vec![f64::NEG_INFINITY; n], upper: vec![f64::INFINITY; n], cone: f64::INFINITY }
    }

    /// Whether there are none.
    pub fn none(&self) -> bool {
        self.cone.is_infinite() && self.lower.iter().chain(&self.upper).all(|limit| limit.is_infinite())
    }

    /// Writes the limits into the program.
    pub fn pose(&self, program: &mut Program, frame: &Frame, groups: &[Group]) {
        bounds::pose(program, frame, &self.lower, &self.upper);
        if self.cone < f64::INFINITY {
            cones::pose(program, frame, self.cone, groups);
        }
    }

    /// Whether a group of this length is at the limit of its cone.
    pub fn reaches_cone(&self, length: f64) -> bool {
        self.cone < f64::INFINITY && length >= self.cone * (1.0 - REACHED)
    }

    /// Puts a group on the limit of its cone, its coordinates that are `held` staying exactly where they are; `false` where
    /// these alone are beyond it, or nothing else is left to move.
    pub fn onto_cone(&self, x: &mut [f64], group: &Group, held: impl Fn(usize, f64) -> bool) -> bool {
        let (fixed, free): (Vec<usize>, Vec<usize>) = group.members.iter().partition(|&&i| held(i, x[i]));
        let square = |of: &[usize]| of.iter().map(|&i| x[i] * x[i]).sum::<f64>();
        let (left, reach) = (self.cone.powi(2) - square(&fixed), square(&free));
        if left <= 0.0 || reach <= 0.0 {
            return false;
        }
        let scale = (left / reach).sqrt();
        free.iter().for_each(|&i| x[i] *= scale);
        true
    }

    /// Moves `x` into the box.
    pub fn clamp(&self, x: &mut [f64]) {
        for (x, (lower, upper)) in x.iter_mut().zip(self.lower.iter().zip(&self.upper)) {
            *x = x.max(*lower).min(*upper);
        }
    }

    /// Largest distance by which `x` oversteps a limit.
    pub fn violation(&self, x: &[f64], groups: &[Group]) -> f64 {
        let outside = x
            .iter()
            .zip(self.lower.iter().zip(&self.upper))
            .map(|(x, (lower, upper))| (lower - x).max(x - upper).max(0.0));
        let beyond =
            groups.iter().filter(|_| self.cone < f64::INFINITY).map(|group| group.length(x) - self.cone);
        outside.chain(beyond).fold(0.0, f64::max)
    }
}
