//! How coordinates answer to the components that tolerances are stated for.

use super::coordinates::Coordinates;
use crate::linalg;
use crate::model::{Mechanism, Prior, Tolerance};

impl Coordinates {
    /// How these coordinates answer to each component that is not held, in its tolerance (or the unit of a free one), and its
    /// prior: components of links, then of shared motions, then the instrument's constants. Where all of them are
    /// independent and of unit variance, so are minimal coordinates (docs/theory.md section 6).
    pub fn by_components(&self, mechanism: &Mechanism) -> Vec<(Prior, Vec<f64>)> {
        let of =
            |tolerance: Tolerance, angular: bool| if angular { tolerance.angle } else { tolerance.length };
        let full = self.shared.as_ref().map_or(self.instrument.offset, |s| s.own_count + s.count());
        let carried = |full: Vec<f64>| {
            let mut x = match self.shared.as_ref().and_then(|shared| shared.gauge.as_ref()) {
                Some(gauge) => linalg::mul_transpose(gauge.as_ref(), &full),
                None => full,
            };
            x.resize(self.count(), 0.0);
            x
        };
        let mut out = Vec::new();
        for (limb, drawn) in self.limbs.iter().zip(&mechanism.limbs) {
            for (row, &i) in limb.free.iter().enumerate() {
                let mut column = vec![0.0; full];
                for k in 0..limb.count {
                    column[limb.offset + k] = limb.basis[(row, k)];
                }
                out.push((of(drawn.links[i / 6].tolerance, i % 6 < 3), carried(column)));
            }
        }
        for (j, (angular, placement)) in self.shared.iter().flat_map(|shared| shared.kinds()).enumerate() {
            let ends = &mechanism.ends;
            let tolerance = if placement { ends.placement } else { ends.tool_mounting };
            let mut column = vec![0.0; full];
            column[full - self.shared.as_ref().map_or(0, |shared| shared.count()) + j] = 1.0;
            out.extend(tolerance.map(|tolerance| (of(tolerance, angular), carried(column))));
        }
        for (i, constant) in mechanism.instrument.iter().enumerate() {
            let mut column = vec![0.0; self.count()];
            column[self.instrument.offset + i] = 1.0;
            out.push((constant.prior, column));
        }
        out
    }
}
