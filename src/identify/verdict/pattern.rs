//! Whether a pattern of errors that the model does not have explains a part of the residual (docs/theory.md (10.13)).

use super::linear::{Linear, Residual};
use crate::linalg;
use faer::{Mat, Side};
use statrs::distribution::{ContinuousCDF, FisherSnedecor};

/// Part of a column's squared length, beside what the machine's own parameters explain of it, below which it is explained.
const EXPLAINED: f64 = 1e-4;

/// Columns by which residuals may err, m x p.
pub(super) struct Pattern {
    pub columns: Mat<f64>,
}

/// How well a pattern fits.
pub(super) struct Fit {
    /// How much of each column there is.
    pub amounts: Vec<f64>,
    /// Standard errors of these; infinite where there is no such column.
    pub errors: Vec<f64>,
    /// Independent combinations of the columns that the machine's parameters do not explain, orthonormal after them.
    pub columns: Mat<f64>,
    /// Probability that noise of any size fits it as well (F test).
    pub probability: f64,
    /// Log likelihood that it gains.
    pub gain: f64,
}

impl Pattern {
    /// Fits it beside the parameters of a model whose rows are in standard deviations.
    pub fn fit(&self, linear: &Linear, residual: &Residual) -> Option<Fit> {
        let p = self.columns.ncols();
        let active = linear.active_rows();
        let mut columns = self.columns.clone();
        for j in 0..p {
            let length =
                (0..active.len()).filter(|&i| active[i]).map(|i| columns[(i, j)].powi(2)).sum::<f64>();
            let by = if length > 0.0 { 1.0 / length.sqrt() } else { 0.0 };
            columns.as_mut().col_mut(j).iter_mut().for_each(|v| *v *= by);
        }
        let on = Mat::from_fn(active.len(), p, |i, j| if active[i] { columns[(i, j)] } else { 0.0 });
        let left = on.transpose() * &on
            - (residual.taken.transpose() * &on).transpose() * (linear.jac.transpose() * &on);
        let left = Mat::from_fn(p, p, |i, j| 0.5 * (left[(i, j)] + left[(j, i)]));
        let eigen = left.self_adjoint_eigen(Side::Lower).ok()?;
        let values: Vec<f64> = eigen.S().column_vector().iter().copied().collect();
        let kept: Vec<usize> = (0..p).filter(|&k| values[k] > EXPLAINED).collect();
        let vectors = Mat::from_fn(p, kept.len(), |i, k| eigen.U()[(i, kept[k])] / values[kept[k]].sqrt());
        let score = linalg::mul_transpose(vectors.as_ref(), &linalg::mul_transpose(on.as_ref(), &residual.r));
        let (value, rank) = (linalg::dot(&score, &score), kept.len() as f64);
        let rest = residual.freedom - rank;
        if kept.is_empty() || rest < 3.0 || residual.square.is_nan() || residual.square <= 0.0 {
            return None;
        }
        let unexplained = (residual.square - value).max(1e-9 * residual.square);
        let law = FisherSnedecor::new(rank, rest).ok()?;
        let probability = law.sf(value / rank / (unexplained / rest));
        let length = |j: usize| -> f64 {
            let square = (0..active.len()).filter(|&i| active[i]).map(|i| self.columns[(i, j)].powi(2));
            square.sum::<f64>().sqrt()
        };
        let along = |j: usize| -> f64 { score.iter().enumerate().map(|(k, s)| vectors[(j, k)] * s).sum() };
        let spread = |j: usize| (0..kept.len()).map(|k| vectors[(j, k)].powi(2)).sum::<f64>().sqrt();
        let over = |j: usize, value: f64, none: f64| if length(j) > 0.0 { value / length(j) } else { none };
        let amounts: Vec<f64> = (0..p).map(|j| over(j, along(j), 0.0)).collect();
        let errors: Vec<f64> = (0..p).map(|j| over(j, spread(j), f64::INFINITY)).collect();
        let gain = 0.5 * residual.freedom * (residual.square / unexplained).ln();
        (probability.is_finite() && gain.is_finite()).then(|| Fit {
            amounts,
            errors,
            columns: &columns * &vectors,
            probability,
            gain: gain - 0.5 * rank * residual.freedom.ln(),
        })
    }
}
