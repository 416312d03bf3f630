//! Which directions of the coordinates are left to the data, and the step that follows.

use crate::linalg::{self, upper_factor};
use crate::problem::Compressed;
use faer::Mat;

/// Singular value, relative to the threshold, above which the prior has no weight left.
const FADED: f64 = 10.0;

/// Directions on which the prior stands, and its weight on each; everything orthogonal to them is the data's.
///
/// The weight is 1 up to the threshold and fades to 0 at ten times it. A hard edge would leave directions of a
/// signal-to-noise ratio of barely 1 to the data alone; there the cost is as good as flat, its curvature beyond
/// first order decides, and the iteration drifts for hundreds of steps that mean nothing.
#[derive(Clone, Debug)]
pub struct Split {
    /// Orthonormal columns times the square root of the weight, n x m.
    anchors: Mat<f64>,
    kept: usize,
    /// Whether the prior holds `x` near 0 there; else the step just leaves these directions alone.
    prior: bool,
}

/// The step and what the linear model promises of it.
pub struct Step {
    /// `dx`, n.
    pub dx: Vec<f64>,
    /// Predicted reduction of the merit by the undamped step.
    pub predicted: f64,
}

impl Split {
    /// Splits the coordinates at the singular value `threshold` of the Jacobian; `None` where it is not finite.
    ///
    /// The singular value decomposition is skipped where the inverse of the triangular factor already proves that
    /// every singular value is above the threshold (`s_min >= 1 / |R^-1|_F`).
    pub fn at(here: &Compressed, threshold: f64, prior: bool) -> Option<Self> {
        let n = here.jac.ncols();
        if !here.jac.is_all_finite() {
            return None;
        }
        if here.jac.nrows() >= n && inverse_norm(&here.jac) * threshold * FADED < 1.0 {
            return Some(Self { anchors: Mat::zeros(n, 0), kept: n, prior });
        }
        let svd = linalg::svd(here.jac.as_ref())?;
        let strong = svd.s.iter().filter(|s| **s >= threshold * FADED).count();
        let mut anchors = svd.v.get(.., strong..).to_owned();
        for (column, s) in svd.s[strong..].iter().enumerate() {
            let root = prior_weight(s / threshold).sqrt();
            anchors.as_mut().col_mut(column).iter_mut().for_each(|v| *v *= root);
        }
        Some(Self { anchors, kept: svd.s.iter().filter(|s| **s > threshold).count(), prior })
    }

    /// Number of directions whose singular value is above the threshold.
    pub fn kept(&self) -> usize {
        self.kept
    }

    /// `|P x|^2 / 2` with the prior's weights, 0 without a prior.
    pub fn penalty(&self, x: &[f64]) -> f64 {
        if !self.prior {
            return 0.0;
        }
        0.5 * linalg::mul_transpose(self.anchors.as_ref(), x).iter().map(|a| a * a).sum::<f64>()
    }

    /// Minimiser of `|J dx + r|^2 + |P (x + dx)|^2 + damping |D dx|^2`, by QR of the stacked rows.
    ///
    /// `D` is 1 in tolerance units, else the norms of the Jacobian's columns.
    pub fn step(&self, here: &Compressed, x: &[f64], damping: f64) -> Option<Step> {
        let (k, n, m) = (here.jac.nrows(), x.len(), self.anchors.ncols());
        let damped = if damping > 0.0 { n } else { 0 };
        let mut rows = Mat::<f64>::zeros(k + m + damped, n + 1);
        rows.as_mut().submatrix_mut(0, 0, k, n).copy_from(&here.jac);
        for i in 0..k {
            rows[(i, n)] = -here.r[i];
        }
        rows.as_mut().submatrix_mut(k, 0, m, n).copy_from(self.anchors.transpose());
        if self.prior {
            for (i, along) in linalg::mul_transpose(self.anchors.as_ref(), x).iter().enumerate() {
                rows[(k + i, n)] = -along;
            }
        }
        for j in 0..damped {
            let scale = if self.prior { 1.0 } else { here.jac.col(j).norm_l2().max(f64::MIN_POSITIVE) };
            rows[(k + m + j, j)] = damping.sqrt() * scale;
        }
        let factor = upper_factor(rows.as_mut());
        let dx = solve_upper(&factor, n)?;
        // For the undamped step this is (|rhs|^2 - |residual|^2) / 2.
        let predicted = 0.5 * (0..n.min(factor.nrows())).map(|i| factor[(i, n)].powi(2)).sum::<f64>();
        Some(Step { dx, predicted })
    }
}

/// Weight of the prior on a direction whose singular value is `s` thresholds: `(1/s^2 - 1/100) / 0.99` between 1
/// and 10.
pub fn prior_weight(s: f64) -> f64 {
    let edge = FADED.powi(-2);
    ((s.max(1.0).powi(-2) - edge) / (1.0 - edge)).max(0.0)
}

/// Solves the triangle in the first n columns for the last one; `None` where a pivot is zero to rounding.
fn solve_upper(factor: &Mat<f64>, n: usize) -> Option<Vec<f64>> {
    if factor.nrows() < n {
        return None;
    }
    let mut z: Vec<f64> = (0..n).map(|i| factor[(i, n)]).collect();
    for j in (0..n).rev() {
        let pivot = factor[(j, j)];
        if pivot == 0.0 {
            return None;
        }
        z[j] /= pivot;
        let zj = z[j];
        for (zi, f) in z[..j].iter_mut().zip(factor.col(j).iter()) {
            *zi -= f * zj;
        }
    }
    z.iter().all(|v| v.is_finite()).then_some(z)
}

/// Frobenius norm of the inverse of a square factor of `jac` (k x n, k >= n), infinite where it is singular.
fn inverse_norm(jac: &Mat<f64>) -> f64 {
    let n = jac.ncols();
    let factor = upper_factor(jac.clone().as_mut());
    let mut square = 0.0;
    let mut column = vec![0.0; n];
    for j in 0..n {
        // Column j of R^-1 by back substitution.
        column[..=j].fill(0.0);
        column[j] = 1.0;
        for i in (0..=j).rev() {
            let pivot = factor[(i, i)];
            if pivot == 0.0 {
                return f64::INFINITY;
            }
            column[i] /= pivot;
            let value = column[i];
            for (c, f) in column[..i].iter_mut().zip(factor.col(i).iter()) {
                *c -= f * value;
            }
        }
        square += column[..=j].iter().map(|v| v * v).sum::<f64>();
    }
    square.sqrt()
}
