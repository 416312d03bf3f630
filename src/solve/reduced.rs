//! A problem without its redundancy: the same problem on the directions that some residual can see.

use crate::linalg;
use crate::problem::{Compressed, EvalError, Linearized, Param, Problem};
use faer::Mat;
use std::ops::Range;

/// `z` stands for `x = B z`, `B` an orthonormal basis of what is not redundant at nominal: `|x| = |z|`, so that a
/// prior means the same.
pub struct Reduced<'p> {
    inner: &'p dyn Problem,
    basis: Mat<f64>,
    params: Vec<Param>,
}

impl<'p> Reduced<'p> {
    /// `inner` without what is redundant at nominal; `None` where nothing is.
    pub fn new(inner: &'p dyn Problem) -> Option<Self> {
        let redundant = inner.redundant(&vec![0.0; inner.params().len()]);
        if redundant.ncols() == 0 {
            return None;
        }
        let basis = linalg::complement(redundant.as_ref())?;
        let unlimited = (f64::NEG_INFINITY, f64::INFINITY);
        let name = |k: usize| format!("combination {}", k + 1);
        let param = |k: usize| Param { name: name(k), unit: "", scale: 1.0, bounds: unlimited };
        let params = (0..basis.ncols()).map(param).collect();
        Some(Self { inner, basis, params })
    }

    /// The coordinates of `x`; what it has along the redundancy is left out.
    pub fn coordinates(&self, x: &[f64]) -> Vec<f64> {
        linalg::mul_transpose(self.basis.as_ref(), x)
    }

    /// The coordinates of the whole problem at `z`.
    pub fn point(&self, z: &[f64]) -> Vec<f64> {
        linalg::mul(self.basis.as_ref(), z)
    }
}

impl Problem for Reduced<'_> {
    fn params(&self) -> &[Param] {
        &self.params
    }

    fn has_prior(&self) -> bool {
        self.inner.has_prior()
    }

    fn residual(&self, z: &[f64]) -> Result<Vec<f64>, EvalError> {
        self.inner.residual(&self.point(z))
    }

    fn linearize(&self, z: &[f64]) -> Result<Linearized, EvalError> {
        let lin = self.inner.linearize(&self.point(z))?;
        Ok(Linearized { r: lin.r, jac: lin.jac * &self.basis })
    }

    fn compress(&self, z: &[f64]) -> Result<Compressed, EvalError> {
        let here = self.inner.compress(&self.point(z))?;
        let cost = here.cost;
        Ok(Compressed { cost, ..linalg::compress(&(here.jac * &self.basis), &here.r) })
    }

    fn gradient(&self, z: &[f64]) -> Result<(f64, Vec<f64>), EvalError> {
        let (cost, gradient) = self.inner.gradient(&self.point(z))?;
        Ok((cost, linalg::mul_transpose(self.basis.as_ref(), &gradient)))
    }

    fn blocks(&self) -> Vec<Range<usize>> {
        self.inner.blocks()
    }
}
