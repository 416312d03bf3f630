//! The few dense factorisations that identification needs, on faer.
//!
//! Nothing here forms `J'J`. Everything runs on one thread: tall, narrow matrices gain nothing from more.

use crate::problem::Compressed;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::qr::no_pivoting::factor;
use faer::prelude::ReborrowMut;
use faer::{Mat, MatMut, MatRef, Par};

/// Rows taken into one QR factorisation; a multiple of it keeps the working set in cache.
const BLOCK_ROWS: usize = 2048;

/// Triangularises `[a]` (m x n) in place by Householder reflections and returns `R`, min(m, n) x n.
pub fn upper_factor(mut a: MatMut<'_, f64>) -> Mat<f64> {
    let (m, n) = (a.nrows(), a.ncols());
    let k = m.min(n);
    if k > 0 {
        // Measured: blocking pays from about 64 columns.
        let block = if n < 64 { 1 } else { 32.min(k) };
        let mut h = Mat::zeros(block, k);
        let scratch = factor::qr_in_place_scratch::<f64>(m, n, block, Par::Seq, Default::default());
        let mut buffer = MemBuffer::new(scratch);
        factor::qr_in_place(a.rb_mut(), h.as_mut(), Par::Seq, MemStack::new(&mut buffer), Default::default());
    }
    Mat::from_fn(k, n, |i, j| if i <= j { a[(i, j)] } else { 0.0 })
}

/// Columns of some consecutive rows of a column-major table.
pub struct RowBlock<'a> {
    data: &'a mut [f64],
    stride: usize,
    first: usize,
    rows: usize,
}

impl<'a> RowBlock<'a> {
    /// Rows `first..first + rows` of column-major `data` whose columns are `stride` apart.
    pub fn new(data: &'a mut [f64], stride: usize, first: usize, rows: usize) -> Self {
        Self { data, stride, first, rows }
    }

    /// These rows of column j and of those that follow.
    #[inline(always)]
    pub fn columns(&mut self, j: usize) -> impl Iterator<Item = &mut [f64]> {
        let rows = self.first..self.first + self.rows;
        self.data[j * self.stride..]
            .chunks_exact_mut(self.stride)
            .map(move |column| &mut column[rows.clone()])
    }

    /// These rows of column j.
    pub fn column(&mut self, j: usize) -> &mut [f64] {
        let start = j * self.stride + self.first;
        &mut self.data[start..start + self.rows]
    }
}

/// Streams rows of `[J r]` into the triangular factor, so that memory does not grow with their number.
///
/// Blocks are reduced in the order in which they come: the result depends on nothing else.
pub struct RowStream {
    /// `[J r]`, column-major: the factor of the rows that are reduced, then those that are not.
    data: Vec<f64>,
    columns: usize,
    capacity: usize,
    filled: usize,
    square: f64,
}

impl RowStream {
    /// A stream for n columns and `expected` rows in all.
    pub fn new(columns: usize, expected: usize) -> Self {
        let columns = columns + 1;
        let capacity = expected.min(columns + BLOCK_ROWS).max(1);
        Self { data: vec![0.0; capacity * columns], columns, capacity, filled: 0, square: 0.0 }
    }

    /// The next `count` rows to be written whole: columns `0..n` for `J` and column n for `r`.
    pub fn next(&mut self, count: usize) -> RowBlock<'_> {
        if self.filled + count > self.capacity {
            self.reduce(self.filled + count);
        }
        self.filled += count;
        RowBlock::new(&mut self.data, self.capacity, self.filled - count, count)
    }

    /// Reduces what is filled; makes room where `wanted` rows fit in no other way.
    fn reduce(&mut self, wanted: usize) {
        let factor = self.factor();
        let rows = factor.nrows();
        let room = wanted - self.filled + rows;
        if room > self.capacity {
            self.capacity = room;
            self.data = vec![0.0; room * self.columns];
        }
        self.filled = rows;
        let mut block = RowBlock::new(&mut self.data, self.capacity, 0, rows);
        for j in 0..self.columns {
            for (to, from) in block.column(j).iter_mut().zip(factor.col(j).iter()) {
                *to = *from;
            }
        }
    }

    fn factor(&mut self) -> Mat<f64> {
        let (rows, columns, stride) = (self.filled, self.columns, self.capacity);
        upper_factor(MatMut::from_column_major_slice_with_stride_mut(&mut self.data, rows, columns, stride))
    }

    /// Appends a problem that is already compressed, its cost included.
    pub fn push(&mut self, part: &Compressed) {
        let n = part.jac.ncols();
        let mut rows = self.next(part.r.len());
        for j in 0..n {
            for (to, from) in rows.column(j).iter_mut().zip(part.jac.col(j).iter()) {
                *to = *from;
            }
        }
        rows.column(n).copy_from_slice(&part.r);
        self.square += 2.0 * part.cost;
    }

    /// Adds to the sum of squares that [`finish`](Self::finish) reports as cost.
    pub fn add_square(&mut self, square: f64) {
        self.square += square;
    }

    /// The compressed problem; `cost` is half of the squares that were added.
    pub fn finish(mut self) -> Compressed {
        let n = self.columns - 1;
        let factor = self.factor();
        let k = factor.nrows().min(n);
        Compressed {
            r: (0..k).map(|i| factor[(i, n)]).collect(),
            jac: factor.get(..k, ..n).to_owned(),
            cost: 0.5 * self.square,
        }
    }
}

/// Compresses `[jac r]` (m x n, m) to at most n rows.
pub fn compress(jac: &Mat<f64>, r: &[f64]) -> Compressed {
    let (m, n) = (jac.nrows(), jac.ncols());
    let mut stream = RowStream::new(n, m);
    let mut start = 0;
    while start < m {
        let count = BLOCK_ROWS.min(m - start);
        let mut block = stream.next(count);
        for j in 0..n {
            for (i, to) in block.column(j).iter_mut().enumerate() {
                *to = jac[(start + i, j)];
            }
        }
        block.column(n).copy_from_slice(&r[start..start + count]);
        start += count;
    }
    stream.add_square(r.iter().map(|v| v * v).sum());
    stream.finish()
}

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
    let full = a.svd().ok()?;
    let k = a.nrows().min(a.ncols());
    Some(Svd {
        u: full.U().get(.., ..k).to_owned(),
        s: full.S().column_vector().iter().copied().collect(),
        v: full.V().to_owned(),
    })
}

/// Singular values, descending; `None` where `a` is not finite.
pub fn singular_values(a: MatRef<'_, f64>) -> Option<Vec<f64>> {
    if !a.is_all_finite() {
        return None;
    }
    a.singular_values().ok()
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

/// Euclidean norm.
pub fn norm(x: &[f64]) -> f64 {
    x.iter().map(|v| v * v).sum::<f64>().sqrt()
}

/// Orthonormal basis (n x (n - k)) of the complement of the range of `a` (n x k, full column rank).
pub fn complement(a: MatRef<'_, f64>) -> Option<Mat<f64>> {
    if a.ncols() == 0 {
        return Some(Mat::identity(a.nrows(), a.nrows()));
    }
    if !a.is_all_finite() {
        return None;
    }
    Some(a.qr().compute_Q().get(.., a.ncols()..).to_owned())
}
