//! Half the sum of squares: the loss that needs no rows.

use super::here::{Here, Quadratic};
use super::loss::{Frame, Loss};
use super::program::Program;
use crate::linalg;
use crate::problem::cost;
use faer::{Accum, Mat, MatRef, Par};
use std::ops::Range;

/// `|r|^2 / 2`.
#[derive(Clone, Copy, Debug)]
pub struct LeastSquares;

impl Loss for LeastSquares {
    fn name(&self) -> &'static str {
        "least-squares"
    }

    fn needs_rows(&self) -> bool {
        false
    }

    fn arranged(&self, _blocks: &[Range<usize>], _rows: usize, _prior: usize) -> Box<dyn Loss> {
        Box::new(*self)
    }

    fn merit(&self, r: &[f64]) -> f64 {
        cost(r)
    }

    fn influence(&self, r: &[f64]) -> Vec<f64> {
        r.to_vec()
    }

    fn at_scale(&self, _r: &[f64]) -> Box<dyn Loss> {
        Box::new(*self)
    }

    fn working_set(&self, _here: &Here) -> Vec<usize> {
        Vec::new()
    }

    fn pose(&self, program: &mut Program, frame: &Frame, _working: &[usize]) {
        pose_squares(program, frame, frame.here.jac.as_ref(), &frame.here.r);
    }

    fn missing(&self, _predicted: &[f64], _working: &[usize]) -> Vec<usize> {
        Vec::new()
    }

    fn quadratic(&self, here: &Here, _predicted: &[f64]) -> Option<Quadratic> {
        Some(Quadratic { jac: here.jac.clone(), r: here.r.clone(), linear: vec![0.0; here.x.len()] })
    }
}

/// Adds `|jac (u - x) + r|^2 / 2` to the program.
///
/// The product `J'J` only tells the interior-point method where to look: variables for the residual on the
/// compressed rows cost half as much again, and the last digits come from the QR of the polish.
pub fn pose_squares(program: &mut Program, frame: &Frame, jac: MatRef<'_, f64>, r: &[f64]) {
    let n = program.steps();
    let scaled = Mat::from_fn(jac.nrows(), n, |i, j| jac[(i, j)] * frame.unit[j]);
    faer::linalg::matmul::matmul(
        program.quadratic.as_mut(),
        Accum::Add,
        scaled.transpose(),
        scaled.as_ref(),
        1.0,
        Par::Seq,
    );
    for (q, g) in program.linear.iter_mut().zip(linalg::mul_transpose(scaled.as_ref(), r)) {
        *q += g;
    }
}
