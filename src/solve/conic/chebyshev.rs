//! The largest residual: the loss of tolerances that must hold everywhere.

use super::here::{Here, Quadratic, complement};
use super::loss::{Frame, Loss};
use super::program::{Owner, Program, Solution};
use crate::linalg;
use std::ops::Range;

/// `max |r_i|`.
#[derive(Clone, Copy, Debug)]
pub struct Chebyshev;

/// Excess over the largest written-out residual that calls for another row.
const EXCESS: f64 = 1e-7;

/// Row and sign of a side: the even ones are the residuals, the odd ones their opposites.
fn side(index: usize) -> (usize, f64) {
    (index / 2, if index.is_multiple_of(2) { 1.0 } else { -1.0 })
}

/// Value of a side.
fn at(r: &[f64], index: usize) -> f64 {
    let (row, sign) = side(index);
    sign * r[row]
}

impl Loss for Chebyshev {
    fn name(&self) -> &'static str {
        "minimax"
    }

    fn smooth(&self) -> bool {
        false
    }

    fn arranged(&self, _blocks: &[Range<usize>], _rows: usize, _prior: usize) -> Box<dyn Loss> {
        Box::new(*self)
    }

    fn merit(&self, r: &[f64]) -> f64 {
        r.iter().fold(0.0, |a, v| a.max(v.abs()))
    }

    /// Not unique where several residuals are largest: this one blames the first; see `dual_influence`.
    fn influence(&self, r: &[f64]) -> Vec<f64> {
        let largest = self.merit(r);
        let mut blame = vec![0.0; r.len()];
        if let Some(first) = r.iter().position(|v| v.abs() == largest) {
            blame[first] = 1f64.copysign(r[first]);
        }
        blame
    }

    fn at_scale(&self, _r: &[f64]) -> Box<dyn Loss> {
        Box::new(*self)
    }

    /// The sides that are largest, twice as many as a vertex of the program can have.
    fn working_set(&self, here: &Here) -> Vec<usize> {
        let mut order: Vec<usize> = (0..2 * here.r.len()).collect();
        order.sort_by(|&a, &b| at(&here.r, b).total_cmp(&at(&here.r, a)));
        order.truncate(2 * (here.x.len() + 1));
        order.sort_unstable();
        order
    }

    fn pose(&self, program: &mut Program, frame: &Frame, working: &[usize]) {
        let size = self.merit(&frame.here.r).max(f64::MIN_POSITIVE);
        let largest = program.variable(0.0, size);
        for &index in working {
            let (row, sign) = side(index);
            let step = (0..frame.unit.len())
                .map(|j| (j, sign * frame.here.jac[(row, j)] * frame.unit[j] / size))
                .chain([(largest, -1.0)]);
            program.at_most(step, -sign * frame.here.r[row] / size, Owner::Nobody);
        }
    }

    fn missing(&self, predicted: &[f64], working: &[usize]) -> Vec<usize> {
        let held = working.iter().fold(0.0f64, |a, &index| a.max(at(predicted, index)));
        complement(working, 2 * predicted.len())
            .into_iter()
            .filter(|&index| at(predicted, index) > held * (1.0 + EXCESS))
            .collect()
    }

    fn quadratic(&self, _here: &Here, _predicted: &[f64]) -> Option<Quadratic> {
        None
    }

    /// `weights . r`: no more than `max |r|` while the weights' magnitudes add up to at most one.
    fn supported(&self, r: &[f64], weights: &[f64]) -> Option<f64> {
        Some(linalg::dot(weights, r))
    }

    fn dual_influence(&self, here: &Here, working: &[usize], solution: &Solution) -> Option<Vec<f64>> {
        let size = self.merit(&here.r).max(f64::MIN_POSITIVE);
        let mut blame = vec![0.0; here.r.len()];
        for (&index, dual) in working.iter().zip(&solution.z) {
            let (row, sign) = side(index);
            blame[row] += sign * dual / size;
        }
        // They add up to one but for the solver's rounding; more would be no bound.
        let sum: f64 = blame.iter().map(|v| v.abs()).sum();
        if sum > 1.0 {
            blame.iter_mut().for_each(|v| *v /= sum);
        }
        Some(blame)
    }
}
