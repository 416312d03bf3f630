//! Householder reflections, four at a time: for matrices of a few dozen columns.

use crate::wide::wide;

/// Reflections in a block.
const BLOCK: usize = 4;
/// Sums of squares within these limits have lost nothing to overflow or underflow.
const SAFE: std::ops::Range<f64> = 1e-280..1e280;

/// Reflections `I - weight [1; v][1; v]'` of consecutive columns, the `v` of which stand below the diagonal.
pub(super) struct Block {
    /// Column, and row, of the first.
    first: usize,
    size: usize,
    weights: [f64; BLOCK],
    /// Of each pair of `[1; v]`, the earlier first.
    products: [[f64; BLOCK]; BLOCK],
    /// Of each `[1; v]` the first four rows of the block: zeros, the 1, and then `v`.
    heads: [[f64; BLOCK]; BLOCK],
}

/// Householder QR of the columns in place, `v` below the diagonal of `R`.
///
/// For a few dozen columns of a few hundred rows, which a factorisation made for any shape treats at a third of the
/// speed: blocks are as large as the registers allow, and two columns take a block at once. Products are added with one
/// rounding, which every processor of the last ten years does in one instruction and any other in software.
pub(super) fn reflect_columns(columns: &mut [&mut [f64]]) -> Vec<Block> {
    let k = columns.first().map_or(0, |column| column.len()).min(columns.len());
    let mut blocks = Vec::with_capacity(k.div_ceil(BLOCK));
    wide(
        #[inline(always)]
        || {
            for first in (0..k).step_by(BLOCK) {
                let (done, rest) = columns.split_at_mut((first + BLOCK).min(k));
                let block = Block::of(&mut done[first..], first);
                block.apply(&done[first..], rest, false);
                blocks.push(block);
            }
        },
    );
    blocks
}

/// `Q` of the blocks that [`reflect_columns`] left in `columns`, applied to `targets`.
pub(super) fn reflect_back(blocks: &[Block], columns: &[&mut [f64]], targets: &mut [&mut [f64]]) {
    wide(
        #[inline(always)]
        || {
            for block in blocks.iter().rev() {
                block.apply(&columns[block.first..block.first + block.size], targets, true);
            }
        },
    );
}

impl Block {
    /// Reflects the columns of a block, whose first row is `first`, one after the other.
    #[inline(always)]
    fn of(columns: &mut [&mut [f64]], first: usize) -> Self {
        let mut block = Self {
            first,
            size: columns.len(),
            weights: [0.0; BLOCK],
            products: [[0.0; BLOCK]; BLOCK],
            heads: [[0.0; BLOCK]; BLOCK],
        };
        for j in 0..columns.len() {
            let (before, rest) = columns.split_at_mut(j);
            let column = &mut rest[0][first..];
            for (i, v) in before.iter().enumerate() {
                reflect(block.weights[i], &v[first + i + 1..], &mut column[i..]);
            }
            block.weights[j] = make_reflection(&mut column[j..]);
            for (i, v) in before.iter().enumerate() {
                let v = &v[first + j..];
                block.products[i][j] = v[0] + dot(&v[1..], &column[j + 1..]);
            }
        }
        for (i, (head, column)) in block.heads.iter_mut().zip(columns.iter()).enumerate() {
            head[i] = 1.0;
            for (entry, v) in head.iter_mut().zip(&column[first..]).skip(i + 1) {
                *entry = *v;
            }
        }
        block
    }

    /// Applies the reflections of `columns`, the block's own, to others: the first before the last, or the other way
    /// round.
    #[inline(always)]
    fn apply(&self, columns: &[&mut [f64]], targets: &mut [&mut [f64]], backwards: bool) {
        let first = self.first;
        if let [a, b, c, d] = columns {
            let behind = first + BLOCK;
            let v = [&a[behind..], &b[behind..], &c[behind..], &d[behind..]];
            let mut pairs = targets.chunks_exact_mut(2);
            for pair in &mut pairs {
                if let [x, y] = pair
                    && let Some((top_x, x)) = x[first..].split_first_chunk_mut()
                    && let Some((top_y, y)) = y[first..].split_first_chunk_mut()
                {
                    self.apply_whole(v, [top_x, top_y], [x, y], backwards);
                }
            }
            if let [x] = pairs.into_remainder()
                && let Some((top, x)) = x[first..].split_first_chunk_mut()
            {
                self.apply_whole(v, [top], [x], backwards);
            }
            return;
        }
        for target in targets {
            for i in 0..self.size {
                let i = if backwards { self.size - 1 - i } else { i };
                reflect(self.weights[i], &columns[i][first + i + 1..], &mut target[first + i..]);
            }
        }
    }

    /// All four to some columns at once, `tops` their rows that do not belong to all `v`: the products of the columns with
    /// all `v`, and one pass to subtract.
    #[inline(always)]
    fn apply_whole<const C: usize>(
        &self,
        v: [&[f64]; BLOCK],
        tops: [&mut [f64; BLOCK]; C],
        tails: [&mut [f64]; C],
        backwards: bool,
    ) {
        let mut along = dots(v, &tails);
        for (along, top) in along.iter_mut().zip(tops) {
            for (along, head) in along.iter_mut().zip(&self.heads) {
                *along += (head[0] * top[0] + head[1] * top[1]) + (head[2] * top[2] + head[3] * top[3]);
            }
            self.in_turn(along, backwards);
            for (along, head) in along.iter().zip(&self.heads) {
                top.iter_mut().zip(head).for_each(|(top, head)| *top -= along * head);
            }
        }
        take_away(along, v, tails);
    }

    /// From the products of a column with each `[1; v]` to how much of each its reflection takes away, when those before
    /// it have taken theirs.
    #[inline(always)]
    fn in_turn(&self, along: &mut [f64; BLOCK], backwards: bool) {
        let p = &self.products;
        let [a, b, c, d] = *along;
        let [u, v, w, x] = self.weights;
        *along = if backwards {
            let d = x * d;
            let c = w * (c - d * p[2][3]);
            let b = v * (b - c * p[1][2] - d * p[1][3]);
            [u * (a - b * p[0][1] - c * p[0][2] - d * p[0][3]), b, c, d]
        } else {
            let a = u * a;
            let b = v * (b - a * p[0][1]);
            let c = w * (c - a * p[0][2] - b * p[1][2]);
            [a, b, c, x * (d - a * p[0][3] - b * p[1][3] - c * p[2][3])]
        };
    }
}

/// `(I - weight [1; v][1; v]') column`.
#[inline(always)]
fn reflect(weight: f64, v: &[f64], column: &mut [f64]) {
    if let Some((head, tail)) = column.split_first_mut() {
        let along = weight * (*head + dot(v, tail));
        *head -= along;
        tail.iter_mut().zip(v).for_each(|(entry, v)| *entry = v.mul_add(-along, *entry));
    }
}

/// Replaces a column by the head that its reflection leaves and, below, `v`; returns the weight.
#[inline(always)]
fn make_reflection(column: &mut [f64]) -> f64 {
    let square = dot(column, column);
    let norm = match SAFE.contains(&square) {
        true => square.sqrt(),
        false => norm_of_extremes(column, square),
    };
    match column.split_first_mut() {
        Some((head, tail)) if tail.iter().any(|v| *v != 0.0) => {
            let reflected = -norm.copysign(*head);
            let lead = *head - reflected;
            match lead.recip() {
                inverse if inverse.is_finite() => tail.iter_mut().for_each(|v| *v *= inverse),
                _ => tail.iter_mut().for_each(|v| *v /= lead),
            }
            *head = reflected;
            -lead / reflected
        }
        _ => 0.0,
    }
}

/// Norm of entries whose squares, `square` in all, overflow or vanish.
fn norm_of_extremes(column: &[f64], square: f64) -> f64 {
    let scale = if square < 1.0 { 1e200 } else { 1e-200 };
    column.iter().map(|v| (v * scale) * (v * scale)).sum::<f64>().sqrt() / scale
}

/// Products of each `v` with each column.
#[inline(always)]
fn dots<const C: usize>(v: [&[f64]; BLOCK], columns: &[&mut [f64]; C]) -> [[f64; BLOCK]; C] {
    let whole = v[0].len() / 4;
    let mut v4: [&[[f64; 4]]; BLOCK] = [&[]; BLOCK];
    for (v4, v) in v4.iter_mut().zip(v) {
        *v4 = &v.as_chunks().0[..whole];
    }
    let mut columns4: [&[[f64; 4]]; C] = [&[]; C];
    for (columns4, column) in columns4.iter_mut().zip(columns) {
        *columns4 = &column.as_chunks().0[..whole];
    }
    let mut sums = [[[0.0; 4]; BLOCK]; C];
    for row in 0..whole {
        for c in 0..C {
            for i in 0..BLOCK {
                for lane in 0..4 {
                    sums[c][i][lane] = v4[i][row][lane].mul_add(columns4[c][row][lane], sums[c][i][lane]);
                }
            }
        }
    }
    let mut out = totals(sums);
    for (out, column) in out.iter_mut().zip(columns) {
        for (out, v) in out.iter_mut().zip(&v) {
            for (v, b) in v[4 * whole..].iter().zip(&column[4 * whole..]) {
                *out += v * b;
            }
        }
    }
    out
}

/// `column -= sum of factor * v` of each column.
#[inline(always)]
fn take_away<const C: usize>(factors: [[f64; BLOCK]; C], v: [&[f64]; BLOCK], columns: [&mut [f64]; C]) {
    let rows = v[0].len();
    let v = [&v[0][..rows], &v[1][..rows], &v[2][..rows], &v[3][..rows]];
    for (factors, column) in factors.into_iter().zip(columns) {
        let (column, [a, b, c, d]) = (&mut column[..rows], factors);
        for row in 0..rows {
            let first = v[2][row].mul_add(-c, v[3][row].mul_add(-d, column[row]));
            column[row] = v[0][row].mul_add(-a, v[1][row].mul_add(-b, first));
        }
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
    let [[even, odd]] = totals([[even, odd]]);
    rest + even + odd
}

/// Sums over lanes. Not inlined: the compiler would arrange the loops above for these sums instead of for speed.
#[inline(never)]
fn totals<const N: usize, const C: usize>(sums: [[[f64; 4]; N]; C]) -> [[f64; N]; C] {
    let mut out = [[0.0; N]; C];
    for (out, sums) in out.iter_mut().zip(&sums) {
        for (out, [a, b, c, d]) in out.iter_mut().zip(sums) {
            *out = (a + b) + (c + d);
        }
    }
    out
}
