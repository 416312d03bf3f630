//! From coordinates to the slice twists that rows are written in, and back (docs/theory.md section 6).

use super::coordinates::{Coordinates, LimbCoordinates};
use super::redundancy::redundancy_of;
use super::shared::Shared;
use crate::lie::Se3;
use crate::lie::se3::{self, Twist};
use crate::linalg;
use crate::model::{Geometry, Limb, Mechanism};
use crate::problem::Form;
use crate::wide::wide;
use faer::Mat;

impl Coordinates {
    /// Per limb, the matrix (slice x count) that takes `dx` to slice twists, at deviations `d` with links as in
    /// `geometry`; last, that of the instrument.
    pub fn transforms(&self, mechanism: &Mechanism, geometry: &Geometry, d: &[f64]) -> Vec<Mat<f64>> {
        let mut start = 0;
        let mut out = Vec::with_capacity(self.limbs.len());
        for ((limb, drawn), links) in self.limbs.iter().zip(&mechanism.limbs).zip(&geometry.limbs) {
            let size = limb.sigma.len();
            let mut twists = self.body_twists(limb, &d[start..start + size]);
            if let Some(shared) = &self.shared {
                let motions =
                    moved(&shared.lift.get(start..start + size, ..).to_owned(), &d[start..start + size]);
                twists = shared.by_all(limb, &twists, &motions);
            }
            out.push(limb.in_slice_alone(drawn, links, &twists));
            start += size;
        }
        let units: Vec<f64> = self.instrument.free.iter().map(|&i| self.unit(&self.instrument, i)).collect();
        out.push(Mat::from_fn(units.len(), units.len(), |i, j| if i == j { units[i] } else { 0.0 }));
        out
    }

    /// Gradient by `x` from that by slice twists: the transposes of [`transforms`](Self::transforms) applied to it.
    pub fn pull_back(
        &self,
        mechanism: &Mechanism,
        geometry: &Geometry,
        d: &[f64],
        by_slice: &[f64],
    ) -> Vec<f64> {
        let mut start = 0;
        let mut out = Vec::with_capacity(self.count());
        let mut by_motions = vec![0.0; self.shared.as_ref().map_or(0, Shared::count)];
        for ((limb, drawn), links) in self.limbs.iter().zip(&mechanism.limbs).zip(&geometry.limbs) {
            let part = &by_slice[limb.slice_offset..limb.slice_offset + limb.slice.len()];
            let mut by_twist = limb.by_every_component(drawn, links, part);
            for (by_twist, d) in by_twist.chunks_exact_mut(6).zip(d[start..].chunks_exact(6)) {
                if d.iter().any(|v| *v != 0.0) {
                    let right = se3::right_jacobian(&Twist::from_column_slice(d));
                    by_twist.copy_from_slice(right.tr_mul(&Twist::from_column_slice(by_twist)).as_slice());
                }
            }
            if let Some(shared) = &self.shared {
                let lift = shared.lift.get(start..start + by_twist.len(), ..);
                let own = linalg::mul_transpose(lift, &by_twist);
                by_motions.iter_mut().zip(own).for_each(|(sum, by)| *sum += by);
            }
            let by_u: Vec<f64> = limb.free.iter().map(|&i| by_twist[i] * self.unit(limb, i)).collect();
            out.extend(linalg::mul_transpose(limb.basis.as_ref(), &by_u));
            start += limb.sigma.len();
        }
        if let Some(shared) = &self.shared {
            out.extend(by_motions);
            if let Some(gauge) = &shared.gauge {
                out = linalg::mul_transpose(gauge.as_ref(), &out);
            }
        }
        let constants = &by_slice[self.instrument.slice_offset..];
        out.extend(
            self.instrument.free.iter().zip(constants).map(|(&i, by)| by * self.unit(&self.instrument, i)),
        );
        out
    }

    /// `d(body twists)/dx` of one limb, complete x count: right Jacobians, units and basis in one.
    fn body_twists(&self, limb: &LimbCoordinates, d: &[f64]) -> Mat<f64> {
        let mut twists = Mat::<f64>::zeros(limb.sigma.len(), limb.count);
        let units: Vec<f64> = limb.free.iter().map(|&i| self.unit(limb, i)).collect();
        let right = |d: &[f64]| se3::right_jacobian(&Twist::from_column_slice(d));
        let moved = d.chunks_exact(6).map(|d| d.iter().any(|v| *v != 0.0).then(|| right(d)));
        let turns: Vec<_> = moved.collect();
        for j in 0..limb.count {
            let column = twists.col_as_slice_mut(j);
            for ((&i, unit), of_basis) in limb.free.iter().zip(&units).zip(limb.basis.col_as_slice(j)) {
                column[i] = unit * of_basis;
            }
            for (twist, turn) in column.chunks_exact_mut(6).zip(&turns) {
                if let Some(turn) = turn {
                    twist.copy_from_slice((turn * Twist::from_column_slice(twist)).as_slice());
                }
            }
        }
        twists
    }

    /// Orthonormal basis (count x k) of the redundant directions of `x` at deviations `d`.
    pub fn redundant(&self, mechanism: &Mechanism, geometry: &Geometry, d: &[f64]) -> Mat<f64> {
        if self.form == Form::Minimal {
            return Mat::zeros(self.count(), 0);
        }
        let k: usize = self.limbs.iter().map(|limb| limb.redundant).sum();
        let mut out = Mat::zeros(self.count(), k);
        let (mut start, mut column) = (0, 0);
        for ((limb, drawn), links) in self.limbs.iter().zip(&mechanism.limbs).zip(&geometry.limbs) {
            let mut null = redundancy_of(drawn, links, &limb.sigma, limb.redundant);
            for (link, d) in d[start..start + limb.sigma.len()].chunks_exact(6).enumerate() {
                // Body twists back to deviations, the inverse of the right Jacobian.
                let back = se3::left_jacobian_inverse(&-Twist::from_column_slice(d));
                for j in 0..null.ncols() {
                    let turned = back * Twist::from_fn(|i, _| null[(6 * link + i, j)]);
                    for i in 0..6 {
                        null[(6 * link + i, j)] = turned[i];
                    }
                }
            }
            let inside = Mat::from_fn(limb.free.len(), null.ncols(), |i, j| {
                null[(limb.free[i], j)] / self.unit(limb, limb.free[i])
            });
            let orthonormal = inside.qr().compute_thin_Q();
            for j in 0..limb.redundant {
                for i in 0..limb.count {
                    out[(limb.offset + i, column)] = orthonormal[(i, j)];
                }
                column += 1;
            }
            start += limb.sigma.len();
        }
        match &self.shared {
            Some(shared) => shared.with_redundancy(&self.limbs, out, |limb, i| self.unit(limb, i)),
            None => out,
        }
    }
}

/// Body twists of links for deviations, a column each, at deviations `d`: right Jacobians, link by link.
fn moved(deviations: &Mat<f64>, d: &[f64]) -> Mat<f64> {
    let mut out = deviations.clone();
    for (link, d) in d.chunks_exact(6).enumerate() {
        let turn = se3::right_jacobian(&Twist::from_column_slice(d));
        for j in 0..out.ncols() {
            let turned = turn * Twist::from_fn(|i, _| deviations[(6 * link + i, j)]);
            (0..6).for_each(|i| out[(6 * link + i, j)] = turned[i]);
        }
    }
    out
}

impl LimbCoordinates {
    /// Body twists (complete x n) replaced by those in the slice (slice x n) that no pose tells from them.
    fn in_slice_alone(&self, limb: &Limb, links: &[Se3], twists: &Mat<f64>) -> Mat<f64> {
        let stand_ins = self.stand_ins(limb, links);
        let mut out = Mat::zeros(self.slice.len(), twists.ncols());
        wide(
            #[inline(always)]
            || {
                for j in 0..twists.ncols() {
                    let (twist, column) = (twists.col_as_slice(j), out.col_as_slice_mut(j));
                    for (entry, &i) in column.iter_mut().zip(&self.slice) {
                        *entry = twist[i];
                    }
                    for (by_pivot, &pivot) in stand_ins.iter().zip(&self.pivots) {
                        linalg::subtract(twist[pivot], by_pivot, column);
                    }
                }
            },
        );
        out
    }

    /// Derivatives by every component of the body twists from those by the slice: no pose tells a pivot from the slice
    /// twists that stand for it.
    fn by_every_component(&self, limb: &Limb, links: &[Se3], by_slice: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.sigma.len()];
        for (&i, by) in self.slice.iter().zip(by_slice) {
            out[i] = *by;
        }
        for (by_pivot, &i) in self.stand_ins(limb, links).iter().zip(&self.pivots) {
            out[i] = -linalg::dot(by_pivot, by_slice);
        }
        out
    }

    /// Per pivot the redundant twist that has 1 there and 0 at the other pivots, to rounding, as it is in the slice. NaN
    /// where there is none.
    fn stand_ins(&self, limb: &Limb, links: &[Se3]) -> Vec<Vec<f64>> {
        let null = redundancy_of(limb, links, &self.reach, self.pivots.len());
        let mut twists: Vec<Vec<f64>> = (0..null.ncols()).map(|j| null.col_as_slice(j).to_vec()).collect();
        wide(
            #[inline(always)]
            || {
                for (at, &pivot) in self.pivots.iter().enumerate() {
                    let size = |j: &usize| twists[*j][pivot].abs();
                    let largest = (at..twists.len()).max_by(|i, j| size(i).total_cmp(&size(j)));
                    let nothing = || vec![f64::NAN; self.sigma.len()];
                    let mut twist = largest.map_or_else(nothing, |j| twists.swap_remove(j));
                    let scale = twist[pivot].recip();
                    twist.iter_mut().for_each(|v| *v *= scale);
                    for other in twists.iter_mut().filter(|other| other[pivot] != 0.0) {
                        linalg::subtract(other[pivot], &twist, other);
                    }
                    twists.insert(at, twist);
                }
            },
        );
        let in_slice = |twist: &Vec<f64>| self.slice.iter().map(|&i| twist[i]).collect();
        twists.iter().take(self.pivots.len()).map(in_slice).collect()
    }
}
