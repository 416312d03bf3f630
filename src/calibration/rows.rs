//! Rows of the error Jacobian of one posture (12), in slice columns.

use super::coordinates::{Coordinates, LimbCoordinates};
use crate::lie::Se3;
use crate::linalg::RowBlock;
use crate::measure::Row;
use crate::model::{Mechanism, Posture};
use nalgebra::Vector3;

/// Rows handled together.
const LANES: usize = 6;
/// Rows from which that pays.
const FEW: usize = 3;

/// Derivatives of up to six residuals by a twist, one array a component: rad first, then m.
type Lanes = [[f64; LANES]; 6];

/// Writes rows posture by posture; holds what it needs from one to the next.
#[derive(Default)]
pub struct RowWriter {
    /// By the twist of one limb's tool, six rows at a time.
    by_limb: Vec<Lanes>,
}

impl RowWriter {
    /// Writes `[J r]` of one closed posture over `out` (rows x (slice count + 1)).
    ///
    /// Of the platform's twist `Jr^-1 blockdiag(W_i Phi_i) x` a limb sees only its own wrenches: its rows are
    /// `(by_tool Jr^-1)_i W_i`, a covector `(w, v)` at the tool point. Moved to a link's origin, which lies `lever`
    /// behind the tool point, it is `(w + lever x v, v)`; each column is then one dot product with an axis of the
    /// link.
    pub fn write(
        &mut self,
        mechanism: &Mechanism,
        coordinates: &Coordinates,
        posture: &Posture,
        rows: &[Row],
        mut out: RowBlock<'_>,
    ) {
        let tool = posture.tool().p;
        let open = posture.is_open_chain(mechanism);
        let (mut frame, mut wrench) = (0, 0);
        for ((limb, drawn), split) in coordinates.limbs.iter().zip(&mechanism.limbs).zip(&posture.splits) {
            self.gather(rows, |row| match open {
                true => row.by_tool,
                false => through_wrenches(posture, row, wrench, split.wrenches()),
            });
            let frames = &posture.frames[frame..frame + drawn.links.len()];
            self.write_limb(limb, frames, &tool, &mut out);
            frame += drawn.links.len();
            wrench += split.wrenches().len();
        }
        for (entry, row) in out.column(coordinates.slice_count()).iter_mut().zip(rows) {
            *entry = row.r;
        }
    }

    /// Writes the columns of one limb alone, `rows` being by that limb's own tool twist, and the residuals behind
    /// them.
    pub fn write_alone(
        &mut self,
        limb: &LimbCoordinates,
        frames: &[Se3],
        tool: &Vector3<f64>,
        rows: &[Row],
        mut out: RowBlock<'_>,
    ) {
        if rows.len() < FEW {
            write_single(limb, frames, tool, rows, &mut out);
        } else {
            self.gather(rows, |row| row.by_tool);
            self.write_limb(limb, frames, tool, &mut out);
        }
        for (entry, row) in out.column(limb.slice.len()).iter_mut().zip(rows) {
            *entry = row.r;
        }
    }

    fn gather(&mut self, rows: &[Row], by_limb: impl Fn(&Row) -> [f64; 6]) {
        self.by_limb.clear();
        for group in rows.chunks(LANES) {
            let mut lanes = [[0.0; LANES]; 6];
            for (k, row) in group.iter().enumerate() {
                for (lane, value) in lanes.iter_mut().zip(by_limb(row)) {
                    lane[k] = value;
                }
            }
            self.by_limb.push(lanes);
        }
    }

    fn write_limb(
        &self,
        limb: &LimbCoordinates,
        frames: &[Se3],
        tool: &Vector3<f64>,
        out: &mut RowBlock<'_>,
    ) {
        for (group, by) in self.by_limb.iter().enumerate() {
            let mut link = usize::MAX;
            let mut at = *by;
            for (k, &component) in limb.slice.iter().enumerate() {
                let g = &frames[component / 6];
                if component / 6 != link {
                    link = component / 6;
                    let lever = tool - g.p;
                    for i in 0..LANES {
                        at[0][i] = by[0][i] + lever.y * by[5][i] - lever.z * by[4][i];
                        at[1][i] = by[1][i] + lever.z * by[3][i] - lever.x * by[5][i];
                        at[2][i] = by[2][i] + lever.x * by[4][i] - lever.y * by[3][i];
                    }
                }
                let axis = g.r.column(component % 3);
                let first = component % 6 / 3 * 3;
                let (x, y, z) = (&at[first], &at[first + 1], &at[first + 2]);
                let (a, b, c) = (axis[0], axis[1], axis[2]);
                let entry = |i: usize| x[i] * a + y[i] * b + z[i] * c;
                let column = &mut out.column(limb.slice_offset + k)[group * LANES..];
                match <&mut [f64; LANES]>::try_from(&mut *column) {
                    // A whole pose: a fixed length is what vector instructions need.
                    Ok(six) => *six = std::array::from_fn(entry),
                    Err(_) => column.iter_mut().take(LANES).enumerate().for_each(|(i, e)| *e = entry(i)),
                }
            }
        }
    }
}

/// What [`RowWriter::write_limb`] does, row by row.
fn write_single(
    limb: &LimbCoordinates,
    frames: &[Se3],
    tool: &Vector3<f64>,
    rows: &[Row],
    out: &mut RowBlock<'_>,
) {
    for (i, row) in rows.iter().enumerate() {
        let turn = Vector3::from_column_slice(&row.by_tool[..3]);
        let shift = Vector3::from_column_slice(&row.by_tool[3..]);
        let (mut link, mut at) = (usize::MAX, turn);
        for (k, &component) in limb.slice.iter().enumerate() {
            let g = &frames[component / 6];
            if component / 6 != link {
                link = component / 6;
                at = turn + (tool - g.p).cross(&shift);
            }
            let by = if component % 6 < 3 { &at } else { &shift };
            out.column(k)[i] = by.dot(&g.r.column(component % 3));
        }
    }
}

/// `by_tool Jr^-1 W` over the wrenches of one limb, which start at row `first` of `Jr`.
fn through_wrenches(posture: &Posture, row: &Row, first: usize, wrenches: &[[f64; 6]]) -> [f64; 6] {
    let length = posture.length();
    let mut sum = [0.0; 6];
    for (k, wrench) in wrenches.iter().enumerate() {
        // `Jr` is scaled: its lengths are machine sizes.
        let inverse = posture.wrench_inverse.column(first + k);
        let by: f64 = (0..6).map(|i| row.by_tool[i] * inverse[i] * if i < 3 { 1.0 } else { length }).sum();
        for (s, w) in sum.iter_mut().zip(wrench) {
            *s += by * w;
        }
    }
    for s in &mut sum[3..] {
        *s /= length;
    }
    sum
}
