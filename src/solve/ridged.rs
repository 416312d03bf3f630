//! A problem with a ridge is again a problem: rows `sqrt(weight) x` below the residual.

use crate::linalg;
use crate::problem::{Compressed, EvalError, Group, Linearized, Param, Problem};
use faer::Mat;

/// `min |r(x)|^2 / 2 + weight |x|^2 / 2` as a least-squares problem of m + n rows.
pub struct Ridged<'p> {
    inner: &'p dyn Problem,
    root: f64,
}

impl<'p> Ridged<'p> {
    /// `inner` with a ridge of `weight` (dimensionless: x counts in tolerances, r in standard deviations).
    pub fn new(inner: &'p dyn Problem, weight: f64) -> Self {
        Self { inner, root: weight.max(0.0).sqrt() }
    }

    fn extend(&self, jac: &Mat<f64>, r: &[f64], x: &[f64]) -> (Mat<f64>, Vec<f64>) {
        let (m, n) = (jac.nrows(), x.len());
        let mut stacked = Mat::zeros(m + n, n);
        stacked.as_mut().subrows_mut(0, m).copy_from(jac);
        for j in 0..n {
            stacked[(m + j, j)] = self.root;
        }
        (stacked, r.iter().copied().chain(x.iter().map(|v| self.root * v)).collect())
    }
}

impl Problem for Ridged<'_> {
    fn params(&self) -> &[Param] {
        self.inner.params()
    }

    fn groups(&self) -> &[Group] {
        self.inner.groups()
    }

    fn has_prior(&self) -> bool {
        self.inner.has_prior()
    }

    fn residual(&self, x: &[f64]) -> Result<Vec<f64>, EvalError> {
        let mut r = self.inner.residual(x)?;
        r.extend(x.iter().map(|v| self.root * v));
        Ok(r)
    }

    fn linearize(&self, x: &[f64]) -> Result<Linearized, EvalError> {
        let lin = self.inner.linearize(x)?;
        let (jac, r) = self.extend(&lin.jac, &lin.r, x);
        Ok(Linearized { r, jac })
    }

    fn compress(&self, x: &[f64]) -> Result<Compressed, EvalError> {
        let here = self.inner.compress(x)?;
        let (jac, r) = self.extend(&here.jac, &here.r, x);
        let square: f64 = x.iter().map(|v| (self.root * v).powi(2)).sum();
        Ok(Compressed { cost: here.cost + 0.5 * square, ..linalg::compress(&jac, &r) })
    }
}
