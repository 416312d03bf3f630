//! Rows of the error Jacobian of one posture (12), in slice columns.

use super::coordinates::Coordinates;
use crate::measure::Row;
use crate::model::{Mechanism, Posture};
use faer::MatMut;
use faer::prelude::ReborrowMut;
use nalgebra::Vector3;

/// A residual's derivative by the tool twist of one limb, rad and m.
#[derive(Clone, Copy, Default)]
struct ByLimb {
    w: Vector3<f64>,
    v: Vector3<f64>,
}

/// Writes `[J r]` of one closed posture over `out` (rows x (slice count + 1)).
///
/// Of the platform's twist `Jr^-1 blockdiag(W_i Phi_i) x` a limb sees only its own wrenches: its rows are
/// `(by_tool Jr^-1)_i W_i`, a covector `(w, v)` at the tool point. Moved to a link's origin, which lies `lever`
/// behind the tool point, it is `(w + lever x v, v)`; each column is then one dot product with an axis of the link.
pub fn write_rows(
    mechanism: &Mechanism,
    coordinates: &Coordinates,
    posture: &Posture,
    rows: &[Row],
    mut out: MatMut<'_, f64>,
) {
    let tool = posture.tool().p;
    let open = posture.is_open_chain(mechanism);
    let mut by_limb = vec![ByLimb::default(); rows.len()];
    let mut at_link = by_limb.clone();
    let (mut frame, mut wrench) = (0, 0);
    for ((limb, drawn), split) in coordinates.limbs.iter().zip(&mechanism.limbs).zip(&posture.splits) {
        for (by, row) in by_limb.iter_mut().zip(rows) {
            let covector =
                if open { row.by_tool } else { through_wrenches(posture, row, wrench, split.wrenches()) };
            let [a, b, c, d, e, f] = covector;
            *by = ByLimb { w: Vector3::new(a, b, c), v: Vector3::new(d, e, f) };
        }
        let mut link = usize::MAX;
        for (k, &component) in limb.slice.iter().enumerate() {
            let g = &posture.frames[frame + component / 6];
            if component / 6 != link {
                link = component / 6;
                let lever = tool - g.p;
                for (at, by) in at_link.iter_mut().zip(&by_limb) {
                    *at = ByLimb { w: by.w + lever.cross(&by.v), v: by.v };
                }
            }
            let axis = g.r.column(component % 3);
            let turns = component % 6 < 3;
            let column = out.rb_mut().col_mut(limb.slice_offset + k);
            for (entry, at) in column.iter_mut().zip(&at_link) {
                *entry = if turns { at.w.dot(&axis) } else { at.v.dot(&axis) };
            }
        }
        frame += drawn.links.len();
        wrench += split.wrenches().len();
    }
    let last = out.col_mut(coordinates.slice_count());
    for (entry, row) in last.iter_mut().zip(rows) {
        *entry = row.r;
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
