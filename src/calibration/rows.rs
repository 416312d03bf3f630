//! Rows of the error Jacobian of one posture (12), in slice columns.

use super::coordinates::Coordinates;
use crate::measure::Row;
use crate::model::{Mechanism, Posture};
use faer::MatMut;
use faer::prelude::ReborrowMut;
use nalgebra::Vector3;

/// Writes `[J r]` of one closed posture over `out` (rows x (slice count + 1)).
///
/// Of the platform's twist `Jr^-1 blockdiag(W_i Phi_i) x` a limb sees only its own wrenches: per limb the rows
/// are `(by_tool Jr^-1)_i W_i` times the screws of its links, which for one wrench a limb is two dot products a column.
pub fn write_rows(
    mechanism: &Mechanism,
    coordinates: &Coordinates,
    posture: &Posture,
    rows: &[Row],
    mut out: MatMut<'_, f64>,
) {
    let tool = posture.tool().p;
    let length = posture.length();
    let carried: Vec<[f64; 6]> = rows.iter().map(|row| through_wrenches(posture, row, length)).collect();
    let (mut frame, mut wrench) = (0, 0);
    for ((limb, drawn), split) in coordinates.limbs.iter().zip(&mechanism.limbs).zip(&posture.splits) {
        let wrenches = split.wrenches();
        let to = wrench + wrenches.len();
        // Rows by this limb's twist, its lengths in metres again.
        let by_limb: Vec<[f64; 6]> = carried
            .iter()
            .map(|row| {
                let mut sum = [0.0; 6];
                for (factor, w) in row[wrench..to].iter().zip(wrenches) {
                    for (s, w) in sum.iter_mut().zip(w) {
                        *s += factor * w;
                    }
                }
                for s in &mut sum[3..] {
                    *s /= length;
                }
                sum
            })
            .collect();
        for (k, &component) in limb.slice.iter().enumerate() {
            let g = &posture.frames[frame + component / 6];
            let axis = g.r.column(component % 3);
            let mut column = out.rb_mut().col_mut(limb.slice_offset + k);
            if component % 6 < 3 {
                let v = axis.cross(&(tool - g.p));
                for (row, by) in by_limb.iter().enumerate() {
                    column[row] = dot(&axis.into_owned(), by, 0) + dot(&v, by, 3);
                }
            } else {
                for (row, by) in by_limb.iter().enumerate() {
                    column[row] = dot(&axis.into_owned(), by, 3);
                }
            }
        }
        frame += drawn.links.len();
        wrench = to;
    }
    let mut last = out.col_mut(coordinates.slice_count());
    for (row, source) in rows.iter().enumerate() {
        last[row] = source.r;
    }
}

fn dot(a: &Vector3<f64>, row: &[f64; 6], from: usize) -> f64 {
    a.x * row[from] + a.y * row[from + 1] + a.z * row[from + 2]
}

/// `by_tool Jr^-1`, the tool twist in units in which `Jr` is scaled.
fn through_wrenches(posture: &Posture, row: &Row, length: f64) -> [f64; 6] {
    let mut scaled = row.by_tool;
    for v in &mut scaled[3..] {
        *v *= length;
    }
    let inverse = &posture.wrench_inverse;
    std::array::from_fn(|j| (0..6).map(|i| scaled[i] * inverse[(i, j)]).sum())
}
