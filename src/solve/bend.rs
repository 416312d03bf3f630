//! Curvature of the merit that Gauss-Newton does not see, along directions that the data hardly know.
//!
//! The second derivative of the cost is `J'J + sum_i r_i d2r_i`. Along a direction of signal-to-noise ratio `s` the first part
//! is `s^2`, the prior adds its weight, and the second is the pull of the residual on what is curved: where tolerances are
//! wide it is of order one, and a valley that the prior closes by 1 may be closed by 0.01 in truth. Steps that do not know
//! contract by 0.99.

use super::split::{FADED, Model};
use crate::linalg;
use crate::problem::{Compressed, Problem};
use faer::{Mat, Side};
use rayon::prelude::*;

/// Half the distance, tolerances, over which the gradient is differenced: the square of what the residual bends on the way,
/// some tens of standard deviations a squared tolerance, is nothing then, and rounding is far below.
const STEP: f64 = 1e-3;
/// Least curvature, of a prior's 1, that a step counts with.
const FLATTEST: f64 = 1e-2;

/// The model at `x`, where the problem is `here`, with the curvature of the merit itself along all directions with a
/// singular value below ten thresholds, that is, with a prior. Where the merit bends down a step counts with the magnitude.
/// `model` as it was where that cannot be evaluated.
pub fn bent(problem: &dyn Problem, x: &[f64], here: &Compressed, model: Model, threshold: f64) -> Model {
    let Some(svd) = linalg::svd(here.jac.as_ref()) else { return model };
    let strong = svd.s.iter().filter(|s| **s >= threshold * FADED).count();
    let weak = svd.v.get(.., strong..).to_owned();
    let Some(bend) = curvature(problem, x, &weak, &model) else { return model };
    let rows = Mat::from_fn(strong, x.len(), |k, j| svd.s[k] * svd.v[(j, k)]);
    model.bent(&rows, &weak, &bend)
}

/// Root `C` of the second derivative `C'C` of the merit along `weak`, from central differences of its gradient.
fn curvature(problem: &dyn Problem, x: &[f64], weak: &Mat<f64>, model: &Model) -> Option<Mat<f64>> {
    let m = weak.ncols();
    if m == 0 {
        return None;
    }
    let difference = |k: usize| {
        let gradient = |way: f64| {
            let at: Vec<f64> = x.iter().zip(weak.col(k).iter()).map(|(x, d)| x + way * d).collect();
            let (_, of_cost) = problem.gradient(&at).ok()?;
            let of_prior = model.split.pull(&at);
            Some(of_cost.iter().zip(of_prior).map(|(a, b)| a + b).collect::<Vec<f64>>())
        };
        let (ahead, behind) = (gradient(STEP)?, gradient(-STEP)?);
        let slope: Vec<f64> = ahead.iter().zip(behind).map(|(a, b)| (a - b) / (2.0 * STEP)).collect();
        Some(linalg::mul_transpose(weak.as_ref(), &slope))
    };
    let columns: Option<Vec<Vec<f64>>> = (0..m).into_par_iter().map(difference).collect();
    let columns = columns?;
    let symmetric = Mat::from_fn(m, m, |i, j| 0.5 * (columns[j][i] + columns[i][j]));
    if !symmetric.is_all_finite() {
        return None;
    }
    let eigen = symmetric.self_adjoint_eigen(Side::Lower).ok()?;
    let sizes = eigen.S().column_vector();
    Some(Mat::from_fn(m, m, |i, j| sizes[i].abs().max(FLATTEST).sqrt() * eigen.U()[(j, i)]))
}
