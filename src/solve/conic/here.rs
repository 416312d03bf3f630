//! The problem at the point about which a step is sought.

use crate::linalg;
use crate::problem::{Compressed, Linearized, Problem};
use faer::Mat;
use std::borrow::Cow;

/// Norm of a row, relative to the largest, up to which it is rounding.
const EMPTY: f64 = 1e-14;

/// Residual and Jacobian at `x`: rows where the loss looks at single residuals, their square root where not.
#[derive(Clone, Debug)]
pub struct Here {
    /// The point, n.
    pub x: Vec<f64>,
    /// Residual, rows or compressed.
    pub r: Vec<f64>,
    /// Jacobian, rows or compressed.
    pub jac: Mat<f64>,
    /// `|r|^2 / 2` of the full residual.
    pub cost: f64,
}

/// `|jac (u - x) + r|^2 / 2 + linear . (u - x)` up to a constant.
#[derive(Clone, Debug)]
pub struct Quadratic {
    /// Square root of the curvature.
    pub jac: Mat<f64>,
    /// Residual at `x`.
    pub r: Vec<f64>,
    /// Linear cost, n.
    pub linear: Vec<f64>,
}

impl Here {
    /// Evaluates `problem` at `x`; an error where it cannot or where the values are not finite.
    pub fn at(problem: &dyn Problem, x: &[f64], rows: bool) -> Result<Self, String> {
        let here = if rows {
            let Linearized { r, jac } = problem.linearize(x).map_err(|why| why.0)?;
            let cost = crate::problem::cost(&r);
            Self { x: x.to_vec(), r, jac, cost }
        } else {
            Self::compressed(x.to_vec(), problem.compress(x).map_err(|why| why.0)?)
        };
        // Clarabel takes NaN for a certificate of infeasibility: it must not get that far.
        if here.cost.is_finite() && here.jac.is_all_finite() && here.r.iter().all(|v| v.is_finite()) {
            Ok(here)
        } else {
            Err("residual or Jacobian is not finite".into())
        }
    }

    /// Compressed rows at `x`, without those that are rounding errors.
    pub fn compressed(x: Vec<f64>, rows: Compressed) -> Self {
        let (r, jac) = without_empty_rows(rows.r, rows.jac);
        Self { x, r, jac, cost: rows.cost }
    }

    /// The residual that the linear model predicts at `u`.
    pub fn predict(&self, u: &[f64]) -> Vec<f64> {
        let step: Vec<f64> = u.iter().zip(&self.x).map(|(u, x)| u - x).collect();
        linalg::mul(self.jac.as_ref(), &step).iter().zip(&self.r).map(|(d, r)| d + r).collect()
    }

    /// The same model with the curvature `|rows (u - x)|^2 / 2` besides.
    pub fn bent(&self, rows: Option<&Mat<f64>>) -> Cow<'_, Self> {
        let Some(rows) = rows else { return Cow::Borrowed(self) };
        let mut r = self.r.clone();
        r.resize(r.len() + rows.nrows(), 0.0);
        Cow::Owned(Self { x: self.x.clone(), r, jac: faer::concat![[self.jac], [rows]], cost: self.cost })
    }

    /// The rows with the given indices, compressed.
    pub fn compress(&self, rows: &[usize]) -> Compressed {
        let jac = Mat::from_fn(rows.len(), self.jac.ncols(), |i, j| self.jac[(rows[i], j)]);
        let r: Vec<f64> = rows.iter().map(|&i| self.r[i]).collect();
        linalg::compress(&jac, &r)
    }
}

/// Leaves out rows of rounding errors: the factor of a deficient Jacobian has many, and every program pays for them.
fn without_empty_rows(r: Vec<f64>, jac: Mat<f64>) -> (Vec<f64>, Mat<f64>) {
    let sizes: Vec<f64> = (0..jac.nrows()).map(|i| jac.row(i).norm_l2()).collect();
    let least = EMPTY * sizes.iter().fold(0.0f64, |a, v| a.max(*v));
    let kept: Vec<usize> = (0..jac.nrows()).filter(|&i| sizes[i] > least).collect();
    let jac = Mat::from_fn(kept.len(), jac.ncols(), |i, j| jac[(kept[i], j)]);
    (kept.iter().map(|&i| r[i]).collect(), jac)
}

/// The indices below `count` that are not in `sorted`.
pub fn complement(sorted: &[usize], count: usize) -> Vec<usize> {
    let mut present = vec![false; count];
    for &i in sorted {
        present[i] = true;
    }
    (0..count).filter(|&i| !present[i]).collect()
}
