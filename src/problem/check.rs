//! Finite-difference check of any [`Problem`]'s Jacobian.

use super::core::{EvalError, Problem};
use faer::Mat;

/// Jacobian at `x` (m x n) by central differences with one Richardson extrapolation, error O(h^4).
///
/// `step` is the step in units of `x`; 1e-3 suits coordinates in tolerance units.
pub fn finite_difference(problem: &dyn Problem, x: &[f64], step: f64) -> Result<Mat<f64>, EvalError> {
    let central = |column: usize, h: f64| -> Result<Vec<f64>, EvalError> {
        let mut at = x.to_vec();
        at[column] = x[column] + h;
        let plus = problem.residual(&at)?;
        at[column] = x[column] - h;
        let minus = problem.residual(&at)?;
        Ok(plus.iter().zip(&minus).map(|(p, m)| (p - m) / (2.0 * h)).collect())
    };
    let rows = problem.residual(x)?.len();
    let mut jac = Mat::zeros(rows, x.len());
    for column in 0..x.len() {
        let coarse = central(column, step)?;
        let fine = central(column, 0.5 * step)?;
        for row in 0..rows {
            jac[(row, column)] = (4.0 * fine[row] - coarse[row]) / 3.0;
        }
    }
    Ok(jac)
}

/// Largest entry of `|analytic - finite difference|`, relative to the largest entry of the analytic Jacobian.
pub fn jacobian_error(problem: &dyn Problem, x: &[f64], step: f64) -> Result<f64, EvalError> {
    let analytic = problem.linearize(x)?.jac;
    let difference = finite_difference(problem, x, step)?;
    let largest = analytic.norm_max().max(f64::MIN_POSITIVE);
    Ok((&analytic - &difference).norm_max() / largest)
}
