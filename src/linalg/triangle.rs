//! Triangular factors by Householder reflections, and what is solved with them.

use crate::wide::wide;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::qr::no_pivoting::factor;
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{ColRef, ContiguousFwd, Mat, MatMut, MatRef, Par};

/// Columns from which blocks of reflections pay (measured).
const BLOCKED: usize = 64;
/// Sums of squares within these limits have lost nothing to overflow or underflow.
const SAFE: std::ops::Range<f64> = 1e-280..1e280;

/// Triangularises `[a]` (m x n) in place by Householder reflections and returns `R`, min(m, n) x n.
pub fn upper_factor(mut a: MatMut<'_, f64>) -> Mat<f64> {
    let (m, n) = (a.nrows(), a.ncols());
    let k = m.min(n);
    match a.rb_mut().try_as_col_major_mut() {
        Some(columns) if n < BLOCKED => {
            reflect_columns(columns);
        }
        _ if k > 0 => {
            let block = 32.min(k);
            let mut h = Mat::zeros(block, k);
            let scratch = factor::qr_in_place_scratch::<f64>(m, n, block, Par::Seq, Default::default());
            let mut buffer = MemBuffer::new(scratch);
            let stack = MemStack::new(&mut buffer);
            factor::qr_in_place(a.rb_mut(), h.as_mut(), Par::Seq, stack, Default::default());
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
    let reflections = match a.as_mut().try_as_col_major_mut() {
        Some(columns) => reflect_columns(columns),
        None => return None,
    };
    let mut basis = Mat::zeros(n, n.saturating_sub(k));
    wide(
        #[inline(always)]
        || {
            for j in 0..basis.ncols() {
                let column = basis.col_as_slice_mut(j);
                column[k + j] = 1.0;
                for (i, weight) in reflections.weights.iter().enumerate().rev() {
                    reflect(*weight, &a.col_as_slice(i)[i + 1..], &mut column[i..]);
                }
            }
        },
    );
    Some(basis)
}

/// Reflections `I - weight [1; v][1; v]'`, one a column.
struct Reflections {
    weights: Vec<f64>,
    /// Of every other one: the product of its `[1; v]` with that of the next.
    products: Vec<f64>,
}

/// Householder QR, `v` below the diagonal.
///
/// For a few dozen columns of a few hundred rows, which a factorisation made for any shape treats at a third of the
/// speed: each column takes the reflections before it two by two, while it is in the nearest cache. Products are added
/// with one rounding, which every processor of the last ten years does in one instruction and any other in software.
fn reflect_columns(mut a: MatMut<'_, f64, usize, usize, ContiguousFwd>) -> Reflections {
    let (m, n) = (a.nrows(), a.ncols());
    let k = m.min(n);
    let mut all = Reflections { weights: vec![0.0; k], products: vec![0.0; k] };
    wide(
        #[inline(always)]
        || {
            for j in 0..n {
                let (done, mut rest) = a.rb_mut().split_at_col_mut(j);
                let v = |i: usize| &done.rb().col(i).as_slice()[i + 1..];
                let column = rest.rb_mut().col_mut(0).as_slice_mut();
                let before = j.min(k);
                for i in (0..before - before % 2).step_by(2) {
                    let (weights, product) = ([all.weights[i], all.weights[i + 1]], all.products[i]);
                    reflect_twice(weights, product, v(i), v(i + 1), &mut column[i..]);
                }
                if before % 2 == 1 {
                    reflect(all.weights[before - 1], v(before - 1), &mut column[before - 1..]);
                }
                if j < k {
                    all.weights[j] = make_reflection(&mut column[j..]);
                    if j % 2 == 1 {
                        let (head, tail) = (v(j - 1)[0], &v(j - 1)[1..]);
                        all.products[j - 1] = head + dot(tail, &column[j + 1..]);
                    }
                }
            }
        },
    );
    all
}

/// `(I - weight [1; v][1; v]') column`.
#[inline(always)]
fn reflect(weight: f64, v: &[f64], column: &mut [f64]) {
    if let Some((head, tail)) = column.split_first_mut() {
        let along = weight * (*head + dot(v, tail));
        *head -= along;
        subtract(along, v, tail);
    }
}

/// The reflection by `[1; u]`, then that by `[0; 1; v]`, in one pass over the column: `product` is that of the two.
#[inline(always)]
fn reflect_twice(weights: [f64; 2], product: f64, u: &[f64], v: &[f64], column: &mut [f64]) {
    let (Some((second, u)), Some((heads, tail))) = (u.split_first(), column.split_first_chunk_mut::<2>())
    else {
        return;
    };
    let (by_u, by_v) = dot_twice(u, v, tail);
    let first = weights[0] * (heads[0] + second * heads[1] + by_u);
    let next = weights[1] * (heads[1] + by_v - first * product);
    heads[0] -= first;
    heads[1] -= first * second + next;
    subtract_twice([first, next], u, v, tail);
}

/// Replaces a column by the head that its reflection leaves and, below, `v`; returns the weight.
#[inline(always)]
fn make_reflection(column: &mut [f64]) -> f64 {
    let square = dot(column, column);
    let norm = match SAFE.contains(&square) {
        true => square.sqrt(),
        false => ColRef::from_slice(column).norm_l2(),
    };
    match column.split_first_mut() {
        Some((head, tail)) if tail.iter().any(|v| *v != 0.0) => {
            let reflected = -norm.copysign(*head);
            let lead = *head - reflected;
            tail.iter_mut().for_each(|v| *v /= lead);
            *head = reflected;
            -lead / reflected
        }
        _ => 0.0,
    }
}

/// `a' b`, summed in eight parts: what keeps the processor busy.
#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (mut even, mut odd) = ([0.0; 4], [0.0; 4]);
    let ((whole_a, rest_a), (whole_b, rest_b)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    for (a, b) in whole_a.iter().zip(whole_b) {
        for i in 0..4 {
            even[i] = a[i].mul_add(b[i], even[i]);
        }
        for i in 0..4 {
            odd[i] = a[4 + i].mul_add(b[4 + i], odd[i]);
        }
    }
    let rest: f64 = rest_a.iter().zip(rest_b).map(|(a, b)| a * b).sum();
    rest + total(&even, &odd)
}

/// `u' b` and `v' b`.
#[inline(always)]
fn dot_twice(u: &[f64], v: &[f64], b: &[f64]) -> (f64, f64) {
    let (mut even_u, mut odd_u, mut even_v, mut odd_v) = ([0.0; 4], [0.0; 4], [0.0; 4], [0.0; 4]);
    let ((whole_u, rest_u), (whole_v, rest_v)) = (u.as_chunks::<8>(), v.as_chunks::<8>());
    let (whole_b, rest_b) = b.as_chunks::<8>();
    for ((u, v), b) in whole_u.iter().zip(whole_v).zip(whole_b) {
        for i in 0..4 {
            even_u[i] = u[i].mul_add(b[i], even_u[i]);
        }
        for i in 0..4 {
            even_v[i] = v[i].mul_add(b[i], even_v[i]);
        }
        for i in 0..4 {
            odd_u[i] = u[4 + i].mul_add(b[4 + i], odd_u[i]);
        }
        for i in 0..4 {
            odd_v[i] = v[4 + i].mul_add(b[4 + i], odd_v[i]);
        }
    }
    let (mut by_u, mut by_v) = (0.0, 0.0);
    for ((u, v), b) in rest_u.iter().zip(rest_v).zip(rest_b) {
        by_u += u * b;
        by_v += v * b;
    }
    (by_u + total(&even_u, &odd_u), by_v + total(&even_v, &odd_v))
}

/// `b -= factor * v`.
#[inline(always)]
fn subtract(factor: f64, v: &[f64], b: &mut [f64]) {
    for (entry, v) in b.iter_mut().zip(v) {
        *entry = v.mul_add(-factor, *entry);
    }
}

/// `b -= factors[0] * u + factors[1] * v`. A function of its own, so that the compiler knows the vectors apart.
#[inline(always)]
fn subtract_twice(factors: [f64; 2], u: &[f64], v: &[f64], b: &mut [f64]) {
    for ((entry, u), v) in b.iter_mut().zip(u).zip(v) {
        *entry = u.mul_add(-factors[0], v.mul_add(-factors[1], *entry));
    }
}

/// Sum of all parts. Not inlined: the compiler would arrange the loops above for this sum instead of for speed.
#[inline(never)]
fn total(even: &[f64; 4], odd: &[f64; 4]) -> f64 {
    ((even[0] + odd[0]) + (even[1] + odd[1])) + ((even[2] + odd[2]) + (even[3] + odd[3]))
}

/// Frobenius norm of the inverse of the triangle in the first n columns of `factor`, infinite where it is singular.
pub fn inverse_norm(factor: &Mat<f64>, n: usize) -> f64 {
    let mut column = vec![0.0; n];
    let mut square = 0.0;
    wide(
        #[inline(always)]
        || {
            for j in 0..n {
                // Column j of R^-1, from its end up.
                column[..j].fill(0.0);
                column[j] = 1.0;
                for i in (0..=j).rev() {
                    let (above, rest) = column.split_at_mut(i);
                    rest[0] /= factor[(i, i)];
                    square += rest[0] * rest[0];
                    subtract(rest[0], &factor.col_as_slice(i)[..i], above);
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
