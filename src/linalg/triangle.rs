//! Triangular factors by Householder reflections, and what is solved with them.

use super::reflect::{reflect_back, reflect_columns};
use crate::wide::{narrow, wide};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::qr::no_pivoting::factor;
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Mat, MatMut, MatRef, Par};

/// Columns from which blocks of reflections pay (measured).
const BLOCKED: usize = 64;

/// Triangularises `[a]` (m x n) in place by Householder reflections and returns `R`, min(m, n) x n.
pub fn upper_factor(mut a: MatMut<'_, f64>) -> Mat<f64> {
    let (m, n) = (a.nrows(), a.ncols());
    let k = m.min(n);
    match slices(a.rb_mut()) {
        Some(mut columns) if n < BLOCKED => {
            reflect_columns(&mut columns);
        }
        _ if k > 0 => {
            let block = 32.min(k);
            let mut h = Mat::zeros(block, k);
            let scratch = factor::qr_in_place_scratch::<f64>(m, n, block, Par::Seq, Default::default());
            let mut buffer = MemBuffer::new(scratch);
            let stack = MemStack::new(&mut buffer);
            factor::qr_in_place(a.rb_mut(), h.as_mut(), Par::Seq, stack, Default::default());
            narrow();
        }
        _ => {}
    }
    let mut upper = Mat::zeros(k, n);
    for (j, mut column) in upper.col_iter_mut().enumerate() {
        let filled = k.min(j + 1);
        column.rb_mut().subrows_mut(0, filled).copy_from(a.rb().col(j).subrows(0, filled));
    }
    upper
}

/// Orthonormal basis (n x (n - k)) of the complement of the range of `a` (n x k, full column rank); `None` where `a` is
/// not finite.
pub fn complement(a: MatRef<'_, f64>) -> Option<Mat<f64>> {
    let (n, k) = (a.nrows(), a.ncols());
    if !a.is_all_finite() {
        return None;
    }
    let mut a = a.to_owned();
    let mut columns = slices(a.as_mut())?;
    let reflections = reflect_columns(&mut columns);
    let mut basis = Mat::zeros(n, n.saturating_sub(k));
    for j in 0..basis.ncols() {
        basis[(k + j, j)] = 1.0;
    }
    reflect_back(&reflections, &columns, &mut slices(basis.as_mut())?);
    Some(basis)
}

/// The columns, where they are stored as such.
fn slices(a: MatMut<'_, f64>) -> Option<Vec<&mut [f64]>> {
    let columns = a.try_as_col_major_mut()?.col_iter_mut();
    Some(columns.map(|column| column.as_slice_mut()).collect())
}

/// Frobenius norm of the inverse of the triangle in the first n columns of `factor`, infinite where it is singular or not
/// finite.
pub fn inverse_norm(factor: &Mat<f64>, n: usize) -> f64 {
    if (0..n).any(|i| !factor[(i, i)].is_finite()) {
        return f64::INFINITY;
    }
    let mut columns = vec![[0.0; 4]; n];
    let mut square = 0.0;
    wide(
        #[inline(always)]
        || {
            for first in (0..n).step_by(4) {
                // Four columns of R^-1 side by side, from their ends up.
                let behind = n.min(first + 4);
                columns[..behind].fill([0.0; 4]);
                for (lane, entry) in columns[first..behind].iter_mut().enumerate() {
                    entry[lane] = 1.0;
                }
                for i in (0..behind).rev() {
                    let (above, rest) = columns.split_at_mut(i);
                    let by_pivot = 1.0 / factor[(i, i)];
                    let entry = rest[0].map(|v| v * by_pivot);
                    square += entry.iter().map(|v| v * v).sum::<f64>();
                    for (above, f) in above.iter_mut().zip(factor.col_as_slice(i)) {
                        for lane in 0..4 {
                            above[lane] = f.mul_add(-entry[lane], above[lane]);
                        }
                    }
                }
            }
        },
    );
    if square.is_finite() { square.sqrt() } else { f64::INFINITY }
}

/// Solves `R z = rhs` in place with the triangle in the first columns of `factor`, as many as `z` has entries;
/// `None` where a pivot is zero or the solution is not finite.
pub fn solve_upper(factor: &Mat<f64>, z: &mut [f64]) -> Option<()> {
    for j in (0..z.len()).rev() {
        z[j] /= factor[(j, j)];
        let zj = z[j];
        for (zi, f) in z[..j].iter_mut().zip(factor.col(j).iter()) {
            *zi -= f * zj;
        }
    }
    z.iter().all(|v| v.is_finite()).then_some(())
}

/// Solves `R' z = rhs` in place, likewise.
pub fn solve_upper_transpose(factor: &Mat<f64>, z: &mut [f64]) -> Option<()> {
    for j in 0..z.len() {
        let known: f64 = z[..j].iter().zip(factor.col(j).iter()).map(|(z, f)| z * f).sum();
        z[j] = (z[j] - known) / factor[(j, j)];
    }
    z.iter().all(|v| v.is_finite()).then_some(())
}
