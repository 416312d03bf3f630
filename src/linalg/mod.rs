//! The few dense factorisations that identification needs, on faer.
//!
//! Nothing here forms `J'J`. Everything runs on one thread: tall, narrow matrices gain nothing from more.

mod reflect;
mod stream;
mod triangle;

pub use stream::{RowBlock, RowStream, compress};
pub use triangle::{complement, inverse_norm, solve_upper, solve_upper_transpose, upper_factor};

use crate::wide::narrow;
use faer::{Mat, MatRef};

/// Thin singular value decomposition `a = u diag(s) v'`, `s` descending.
pub struct Svd {
    /// Left vectors, m x k.
    pub u: Mat<f64>,
    /// Singular values, k, descending.
    pub s: Vec<f64>,
    /// Right vectors, n x n: the columns beyond k span the null space.
    pub v: Mat<f64>,
}

/// Singular value decomposition with the full set of right vectors; `None` where `a` is not finite.
pub fn svd(a: MatRef<'_, f64>) -> Option<Svd> {
    if !a.is_all_finite() {
        return None;
    }
    // With more rows than columns the thin one has all right vectors, and left ones that fit in memory.
    let found = if a.nrows() > a.ncols() { a.thin_svd() } else { a.svd() }.ok()?;
    narrow();
    let k = a.nrows().min(a.ncols());
    Some(Svd {
        u: found.U().get(.., ..k).to_owned(),
        s: found.S().column_vector().iter().copied().collect(),
        v: found.V().to_owned(),
    })
}

/// Singular values, descending; `None` where `a` is not finite.
pub fn singular_values(a: MatRef<'_, f64>) -> Option<Vec<f64>> {
    if !a.is_all_finite() {
        return None;
    }
    let values = a.singular_values().ok();
    narrow();
    values
}

/// `-J^+ r` with singular values of `J` at most `smallest` times the largest taken as zero; `None` where it is not
/// finite.
pub fn pseudo_inverse_step(jac: MatRef<'_, f64>, r: &[f64], smallest: f64) -> Option<Vec<f64>> {
    let svd = svd(jac)?;
    let smallest = smallest * svd.s.first().copied().unwrap_or(0.0);
    let mut along = mul_transpose(svd.u.as_ref(), r);
    for (a, s) in along.iter_mut().zip(&svd.s) {
        *a = if *s > smallest { -*a / s } else { 0.0 };
    }
    let step = mul(svd.v.as_ref(), &along);
    step.iter().all(|v| v.is_finite()).then_some(step)
}

/// `a x`.
pub fn mul(a: MatRef<'_, f64>, x: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; a.nrows()];
    for (j, &xj) in x.iter().enumerate() {
        for (o, &aij) in out.iter_mut().zip(a.col(j).iter()) {
            *o += aij * xj;
        }
    }
    out
}

/// `a' y`.
pub fn mul_transpose(a: MatRef<'_, f64>, y: &[f64]) -> Vec<f64> {
    (0..a.ncols()).map(|j| a.col(j).iter().zip(y).map(|(aij, yi)| aij * yi).sum()).collect()
}

/// `a' b`.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// `b -= factor a`, which are of one length.
#[inline(always)]
pub fn subtract(factor: f64, a: &[f64], b: &mut [f64]) {
    debug_assert_eq!(a.len(), b.len());
    // In fours, so that vector instructions leave but three entries over.
    let ((a4, a), (b4, b)) = (a.as_chunks::<4>(), b.as_chunks_mut::<4>());
    for (b, a) in b4.iter_mut().zip(a4) {
        *b = std::array::from_fn(|i| b[i] - factor * a[i]);
    }
    b.iter_mut().zip(a).for_each(|(b, a)| *b -= factor * a);
}

/// Euclidean norm.
pub fn norm(x: &[f64]) -> f64 {
    x.iter().map(|v| v * v).sum::<f64>().sqrt()
}
