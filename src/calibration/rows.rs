//! Rows of the error Jacobian of one posture (12), in slice columns.

use super::coordinates::{Coordinates, LimbCoordinates};
use crate::lie::Se3;
use crate::linalg::RowBlock;
use crate::measure::Row;
use crate::model::{Mechanism, Posture};
use nalgebra::Vector3;

/// A residual's derivative by the tool twist of one limb, rad and m.
#[derive(Clone, Copy, Default)]
struct ByLimb {
    w: Vector3<f64>,
    v: Vector3<f64>,
}

impl ByLimb {
    fn new([a, b, c, d, e, f]: [f64; 6]) -> Self {
        Self { w: Vector3::new(a, b, c), v: Vector3::new(d, e, f) }
    }
}

/// Writes rows posture by posture; holds what it needs from one to the next.
#[derive(Default)]
pub struct RowWriter {
    by_limb: Vec<ByLimb>,
    at_link: Vec<ByLimb>,
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
        self.by_limb.resize(rows.len(), ByLimb::default());
        self.at_link.resize(rows.len(), ByLimb::default());
        let (mut frame, mut wrench) = (0, 0);
        for ((limb, drawn), split) in coordinates.limbs.iter().zip(&mechanism.limbs).zip(&posture.splits) {
            for (by, row) in self.by_limb.iter_mut().zip(rows) {
                *by = ByLimb::new(match open {
                    true => row.by_tool,
                    false => through_wrenches(posture, row, wrench, split.wrenches()),
                });
            }
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
        self.by_limb.clear();
        self.by_limb.extend(rows.iter().map(|row| ByLimb::new(row.by_tool)));
        self.at_link.resize(rows.len(), ByLimb::default());
        self.write_limb(limb, frames, tool, &mut out);
        for (entry, row) in out.column(limb.slice.len()).iter_mut().zip(rows) {
            *entry = row.r;
        }
    }

    fn write_limb(
        &mut self,
        limb: &LimbCoordinates,
        frames: &[Se3],
        tool: &Vector3<f64>,
        out: &mut RowBlock<'_>,
    ) {
        let mut link = usize::MAX;
        for (k, &component) in limb.slice.iter().enumerate() {
            let g = &frames[component / 6];
            if component / 6 != link {
                link = component / 6;
                let lever = tool - g.p;
                for (at, by) in self.at_link.iter_mut().zip(&self.by_limb) {
                    *at = ByLimb { w: by.w + lever.cross(&by.v), v: by.v };
                }
            }
            let axis = Vector3::from(g.r.column(component % 3));
            let column = out.column(limb.slice_offset + k).iter_mut().zip(&self.at_link);
            if component % 6 < 3 {
                column.for_each(|(entry, at)| *entry = at.w.dot(&axis));
            } else {
                column.for_each(|(entry, at)| *entry = at.v.dot(&axis));
            }
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
