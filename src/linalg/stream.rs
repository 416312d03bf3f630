//! Rows of `[J r]`, reduced to a triangular factor as they come.

use super::triangle::upper_factor;
use crate::problem::Compressed;
use faer::{Mat, MatMut};

/// Rows taken into one QR factorisation; a multiple of it keeps the working set in cache.
const BLOCK_ROWS: usize = 2048;

/// Rows enough for so many, with columns that all start where the first does within a line of the cache.
fn in_fours(rows: usize) -> usize {
    rows.max(1).next_multiple_of(4)
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

    /// The same for a while: what is held by value is faster to reach.
    #[inline(always)]
    pub fn again(&mut self) -> RowBlock<'_> {
        RowBlock { data: self.data, stride: self.stride, first: self.first, rows: self.rows }
    }

    /// Of column j the rows from the one `skipped` behind the first, where there are N.
    #[inline(always)]
    pub fn chunk<const N: usize>(&mut self, j: usize, skipped: usize) -> Option<&mut [f64; N]> {
        let start = j * self.stride + self.first + skipped;
        let rest = self.data.get_mut(start..).filter(|_| skipped + N <= self.rows);
        rest?.first_chunk_mut()
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

/// Numbers that start where the four of a vector instruction do not lie across two lines of the cache.
struct Table {
    memory: Vec<f64>,
    first: usize,
}

impl Table {
    fn new(count: usize) -> Self {
        let memory = vec![0.0; count + 3];
        let first = memory.as_ptr().align_offset(4 * size_of::<f64>()).min(3);
        Self { memory, first }
    }

    fn entries(&mut self) -> &mut [f64] {
        let count = self.memory.len() - 3;
        &mut self.memory[self.first..self.first + count]
    }
}

/// Streams rows of `[J r]` into the triangular factor, so that memory does not grow with their number.
///
/// Blocks are reduced in the order in which they come: the result depends on nothing else.
pub struct RowStream {
    /// `[J r]`, column-major: the factor of the rows that are reduced, then those that are not.
    data: Table,
    columns: usize,
    capacity: usize,
    filled: usize,
    square: f64,
}

impl RowStream {
    /// A stream for n columns and `expected` rows in all.
    pub fn new(columns: usize, expected: usize) -> Self {
        let columns = columns + 1;
        let capacity = in_fours(expected.min(columns + BLOCK_ROWS));
        Self { data: Table::new(capacity * columns), columns, capacity, filled: 0, square: 0.0 }
    }

    /// The next `count` rows to be written whole: columns `0..n` for `J` and column n for `r`.
    pub fn next(&mut self, count: usize) -> RowBlock<'_> {
        if self.filled + count > self.capacity {
            self.reduce(self.filled + count);
        }
        self.filled += count;
        RowBlock::new(self.data.entries(), self.capacity, self.filled - count, count)
    }

    /// Reduces what is filled; makes room where `wanted` rows fit in no other way.
    fn reduce(&mut self, wanted: usize) {
        let factor = self.factor();
        let rows = factor.nrows();
        let room = in_fours(wanted - self.filled + rows);
        if room > self.capacity {
            self.capacity = room;
            self.data = Table::new(room * self.columns);
        }
        self.filled = rows;
        let mut block = RowBlock::new(self.data.entries(), self.capacity, 0, rows);
        for j in 0..self.columns {
            for (to, from) in block.column(j).iter_mut().zip(factor.col(j).iter()) {
                *to = *from;
            }
        }
    }

    fn factor(&mut self) -> Mat<f64> {
        let (rows, columns, stride) = (self.filled, self.columns, self.capacity);
        upper_factor(MatMut::from_column_major_slice_with_stride_mut(
            self.data.entries(),
            rows,
            columns,
            stride,
        ))
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

    /// Appends rows of `J` without residuals.
    pub fn push_rows(&mut self, jac: &Mat<f64>) {
        let mut rows = self.next(jac.nrows());
        for (j, from) in jac.col_iter().enumerate() {
            rows.column(j).iter_mut().zip(from.iter()).for_each(|(to, from)| *to = *from);
        }
        rows.column(jac.ncols()).fill(0.0);
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
        let mut jac = Mat::zeros(k, n);
        jac.copy_from(factor.get(..k, ..n));
        Compressed { r: (0..k).map(|i| factor[(i, n)]).collect(), jac, cost: 0.5 * self.square }
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
