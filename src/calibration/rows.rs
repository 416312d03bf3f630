//! Rows of the error Jacobian of one posture (12), in slice columns.

use super::coordinates::{Coordinates, LimbCoordinates};
use super::sample::Postures;
use crate::lie::Columns;
use crate::linalg::RowBlock;
use crate::measure::{Evaluation, Row};
use crate::model::{Mechanism, Posture};
use crate::wide::wide;
use nalgebra::Vector3;
use std::array::from_fn;

/// Rows handled together: those of a whole pose.
const TOGETHER: usize = 6;
/// Their places, of which vector instructions take four at a time.
const LANES: usize = 8;
/// Rows from which that pays.
const FEW: usize = 3;

/// Derivatives of up to six residuals by a twist, one array a component: by its rotation (rad), by its translation (m).
/// Lanes beyond the last row mean nothing.
type Covectors = [[[f64; LANES]; 3]; 2];

/// Writes rows posture by posture; holds what it needs from one to the next.
#[derive(Default)]
pub struct RowWriter {
    /// By the twist of one limb's tool, six rows at a time.
    by_limb: Vec<Covectors>,
    /// The same where there are but few rows.
    few: Vec<[f64; 6]>,
    /// What one limb's own twist adds to each row.
    own: Vec<[f64; 6]>,
}

impl RowWriter {
    /// Writes `[J r]` of one closed sample over `out` (rows x (slice count + 1)).
    ///
    /// Of the platform's twist `Jr^-1 blockdiag(W_i Phi_i) x` a limb sees only its own wrenches: its rows are
    /// `(by_tool Jr^-1)_i W_i`, a covector `(w, v)` at the tool point. Moved to a link's origin, which lies `lever`
    /// behind the tool point, it is `(w + lever x v, v)`; each column is then one dot product with an axis of the
    /// link.
    pub fn write(
        &mut self,
        mechanism: &Mechanism,
        coordinates: &Coordinates,
        postures: &Postures,
        sample: &Evaluation,
        mut out: RowBlock<'_>,
    ) {
        let by_tool = |k: usize| &sample.rows[k].by_tool;
        self.write_posture::<false>(mechanism, coordinates, &postures.first, sample, by_tool, &mut out);
        if !sample.by_second.is_empty() {
            let second = |k: usize| &sample.by_second[k];
            self.write_posture::<true>(mechanism, coordinates, &postures.second, sample, second, &mut out);
        }
        for k in 0..coordinates.instrument.slice.len() {
            out.column(coordinates.instrument.slice_offset + k).fill(0.0);
        }
        for by in &sample.by_constant {
            out.column(coordinates.instrument.slice_offset + by.constant)[by.row] += by.value;
        }
        for (entry, row) in out.column(coordinates.slice_count()).iter_mut().zip(&sample.rows) {
            *entry = row.r;
        }
    }

    /// Writes the columns of all limbs, or adds to them: by the tool twist of one posture. What single limbs' own twists
    /// add belongs to the first.
    fn write_posture<'e, const ADD: bool>(
        &mut self,
        mechanism: &Mechanism,
        coordinates: &Coordinates,
        posture: &Posture,
        sample: &'e Evaluation,
        by_tool: impl Fn(usize) -> &'e [f64; 6],
        out: &mut RowBlock<'_>,
    ) {
        let tool = posture.tool().p;
        let open = posture.is_open_chain();
        let (mut frame, mut wrench) = (0, 0);
        let mut own = std::mem::take(&mut self.own);
        for (i, ((limb, drawn), split)) in
            coordinates.limbs.iter().zip(&mechanism.limbs).zip(&posture.splits).enumerate()
        {
            own.clear();
            if !ADD && !sample.by_limb.is_empty() {
                own.resize(sample.rows.len(), [0.0; 6]);
                for by in sample.by_limb.iter().filter(|by| by.limb == i) {
                    own[by.row].iter_mut().zip(by.by_twist).for_each(|(sum, v)| *sum += v);
                }
            }
            let by_limb = |k: usize| {
                let mut row = through_wrenches(posture, by_tool(k), wrench, split.wrenches());
                if let Some(own) = own.get(k) {
                    row.iter_mut().zip(own).for_each(|(sum, v)| *sum += v);
                }
                row
            };
            let frames = &posture.frames[frame..frame + drawn.links.len()];
            match open {
                // Its own twist is the tool's; without passive joints nothing else is read.
                true => self.write_rows::<ADD>(limb, frames, &tool, sample.rows.len(), |k| *by_tool(k), out),
                false => self.write_rows::<ADD>(limb, frames, &tool, sample.rows.len(), by_limb, out),
            }
            frame += drawn.links.len();
            wrench += split.wrenches().len();
        }
        self.own = own;
    }

    /// Writes the columns of one limb alone, `rows` being by that limb's own tool twist, and the residuals behind
    /// them.
    pub fn write_alone(
        &mut self,
        limb: &LimbCoordinates,
        frames: &[Columns],
        tool: &Vector3<f64>,
        rows: &[Row],
        mut out: RowBlock<'_>,
    ) {
        self.write_rows::<false>(limb, frames, tool, rows.len(), |k| rows[k].by_tool, &mut out);
        for (entry, row) in out.column(limb.slice.len()).iter_mut().zip(rows) {
            *entry = row.r;
        }
    }

    /// Writes or adds to the columns of one limb: `rows` rows, whose derivatives by its tool twist are `by_limb`.
    fn write_rows<const ADD: bool>(
        &mut self,
        limb: &LimbCoordinates,
        frames: &[Columns],
        tool: &Vector3<f64>,
        rows: usize,
        by_limb: impl Fn(usize) -> [f64; 6],
        out: &mut RowBlock<'_>,
    ) {
        if rows < FEW {
            self.few.clear();
            self.few.extend((0..rows).map(by_limb));
            return write_few::<ADD>(limb, frames, tool, &self.few, out);
        }
        self.by_limb.resize(rows.div_ceil(TOGETHER), Covectors::default());
        for (group, lanes) in self.by_limb.iter_mut().enumerate() {
            let first = group * TOGETHER;
            for row in first..rows.min(first + TOGETHER) {
                for (lane, value) in lanes.as_flattened_mut().iter_mut().zip(by_limb(row)) {
                    lane[row - first] = value;
                }
            }
        }
        self.write_limb::<ADD>(limb, frames, tool, out);
    }

    fn write_limb<const ADD: bool>(
        &self,
        limb: &LimbCoordinates,
        frames: &[Columns],
        tool: &Vector3<f64>,
        out: &mut RowBlock<'_>,
    ) {
        wide(
            #[inline(always)]
            || {
                let mut out = out.again();
                for (group, by_tool) in self.by_limb.iter().enumerate() {
                    let mut at = limb.slice_offset;
                    for (g, [turns, shifts]) in frames.iter().zip(&limb.in_slice) {
                        let by_rotation = moved(by_tool, &(tool - g.p()));
                        let [x, y, z, _] = &g.0;
                        // Not in a loop, which would cost more than what it repeats.
                        put::<ADD>(turns[0], &by_rotation, x, &mut at, group, &mut out);
                        put::<ADD>(turns[1], &by_rotation, y, &mut at, group, &mut out);
                        put::<ADD>(turns[2], &by_rotation, z, &mut at, group, &mut out);
                        put::<ADD>(shifts[0], &by_tool[1], x, &mut at, group, &mut out);
                        put::<ADD>(shifts[1], &by_tool[1], y, &mut at, group, &mut out);
                        put::<ADD>(shifts[2], &by_tool[1], z, &mut at, group, &mut out);
                    }
                }
            },
        );
    }
}

/// What [`RowWriter::write_limb`] does, row by row.
fn write_few<const ADD: bool>(
    limb: &LimbCoordinates,
    frames: &[Columns],
    tool: &Vector3<f64>,
    rows: &[[f64; 6]],
    out: &mut RowBlock<'_>,
) {
    for (row, by_tool) in rows.iter().enumerate() {
        let turn = Vector3::from_column_slice(&by_tool[..3]);
        let shift = Vector3::from_column_slice(&by_tool[3..]);
        let mut columns = out.columns(limb.slice_offset);
        for (g, in_slice) in frames.iter().zip(&limb.in_slice) {
            let by_rotation = turn + (tool - g.p()).cross(&shift);
            for (by, in_slice) in [by_rotation, shift].iter().zip(in_slice) {
                for ([x, y, z, _], chosen) in g.0.iter().zip(in_slice) {
                    if *chosen && let Some(column) = columns.next() {
                        let entry = by.x * x + by.y * y + by.z * z;
                        column[row] = if ADD { column[row] + entry } else { entry };
                    }
                }
            }
        }
    }
}

/// `w + lever x v`: the rotation part of covectors `(w, v)` at a point that lies `lever` behind theirs.
#[inline(always)]
fn moved([[a, b, c], [x, y, z]]: &Covectors, lever: &Vector3<f64>) -> [[f64; LANES]; 3] {
    let (d, e, f) = (lever.x, lever.y, lever.z);
    let mut w = [[0.0; LANES]; 3];
    for i in 0..LANES {
        w[0][i] = e.mul_add(z[i], (-f).mul_add(y[i], a[i]));
    }
    for i in 0..LANES {
        w[1][i] = f.mul_add(x[i], (-d).mul_add(z[i], b[i]));
    }
    for i in 0..LANES {
        w[2][i] = d.mul_add(y[i], (-e).mul_add(x[i], c[i]));
    }
    w
}

/// Writes `axis . block` of a group of rows over the column `at`, or adds it, and goes on to the next; nothing where the
/// component is not `chosen`.
#[inline(always)]
fn put<const ADD: bool>(
    chosen: bool,
    block: &[[f64; LANES]; 3],
    axis: &[f64; 4],
    at: &mut usize,
    group: usize,
    out: &mut RowBlock<'_>,
) {
    if chosen {
        match out.chunk::<TOGETHER>(*at, group * TOGETHER) {
            Some(whole) if !ADD => *whole = combined(block, axis),
            _ => combine::<ADD>(block, axis, &mut out.column(*at)[group * TOGETHER..]),
        }
        *at += 1;
    }
}

/// `axis . block` of the lanes of a whole pose.
#[inline(always)]
fn combined([x, y, z]: &[[f64; LANES]; 3], [a, b, c, _]: &[f64; 4]) -> [f64; TOGETHER] {
    let entry = |i: usize| x[i].mul_add(*a, y[i].mul_add(*b, z[i] * c));
    // In the two parts in which vector instructions compute it.
    let ([p, q, r, s], [t, u]): ([f64; 4], [f64; 2]) = (from_fn(entry), from_fn(|i| entry(4 + i)));
    [p, q, r, s, t, u]
}

/// Writes as many of them over `out` as it has entries, or adds them. Not inlined: it would slow the other case.
#[inline(never)]
fn combine<const ADD: bool>(block: &[[f64; LANES]; 3], axis: &[f64; 4], out: &mut [f64]) {
    for (out, entry) in out.iter_mut().zip(combined(block, axis)) {
        *out = if ADD { *out + entry } else { entry };
    }
}

/// `by_tool Jr^-1 W` over the wrenches of one limb, which start at row `first` of `Jr`.
fn through_wrenches(posture: &Posture, by_tool: &[f64; 6], first: usize, wrenches: &[[f64; 6]]) -> [f64; 6] {
    let length = posture.length();
    let mut sum = [0.0; 6];
    for (k, wrench) in wrenches.iter().enumerate() {
        // `Jr` is scaled: its lengths are machine sizes.
        let inverse = posture.wrench_inverse.column(first + k);
        let by: f64 = (0..6).map(|i| by_tool[i] * inverse[i] * if i < 3 { 1.0 } else { length }).sum();
        for (s, w) in sum.iter_mut().zip(wrench) {
            *s += by * w;
        }
    }
    for s in &mut sum[3..] {
        *s /= length;
    }
    sum
}
