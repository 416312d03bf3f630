//! Motions that all limbs share: one in front of every first link, one behind every last (docs/theory.md section 6).
//!
//! A placement `X = exp(x)` moves link 0 of limb `i` by `Ad(g_i0^-1) x`, a tool mounting `Y = exp(y)` the last link by
//! `y`. Both are coordinates of their own; six combinations of each with the links change nothing, and minimal coordinates
//! leave them out.

use super::coordinates::{FREE_LINK, LimbCoordinates};
use crate::lie::Se3;
use crate::lie::se3::{self, Twist};
use crate::linalg;
use crate::model::{Mechanism, Prior, Tolerance};
use crate::problem::{Form, Param};
use faer::Mat;
use nalgebra::{Matrix3, Vector3};

/// Singular value, relative to the largest, below which a combination is redundant.
const REDUNDANT: f64 = 1e-9;

/// Coordinates of shared motions.
#[derive(Clone, Debug)]
pub(super) struct Shared {
    /// Deviations of all links, rad and m, by the motions, a column each, in their units.
    pub lift: Mat<f64>,
    /// The unit of each, rad or m, its name, and whether it belongs to the placement.
    pub units: Vec<(f64, String, bool)>,
    /// Orthonormal basis of what is not redundant of the limbs' coordinates and the motions behind them; `None` where the
    /// redundancy is kept.
    pub gauge: Option<Mat<f64>>,
    /// Which of the motions are turns.
    angular: Vec<bool>,
    /// Number of the limbs' own coordinates.
    pub own_count: usize,
}

impl Shared {
    /// The motions that the mechanism states, none of them redundant yet; `None` where it states none.
    pub fn of(mechanism: &Mechanism, form: Form, length: f64) -> Option<Self> {
        let rows = mechanism.link_component_count();
        let mut columns: Vec<Vec<f64>> = Vec::new();
        let (mut units, mut angular) = (Vec::new(), Vec::new());
        let ends = mechanism.ends;
        for (tolerance, placement) in [(ends.placement, true), (ends.tool_mounting, false)] {
            let Some(tolerance) = tolerance else { continue };
            let centre = Se3 { r: Matrix3::identity(), p: centre(mechanism, tolerance) };
            for i in 0..6 {
                let sigma = sigma(tolerance, i, length);
                if sigma == 0.0 {
                    continue;
                }
                let unit = if form == Form::Plain { 1.0 } else { sigma };
                let twist = Twist::from_fn(|k, _| if k == i { unit } else { 0.0 });
                columns.push(column(mechanism, rows, &centre, &twist, placement));
                angular.push(i < 3);
                let what = if placement { "placement" } else { "tool mounting" };
                let kind = if i < 3 { "rotation" } else { "translation" };
                units.push((unit, format!("{what} {kind} {}", ["x", "y", "z"][i % 3]), placement));
            }
        }
        let lift = Mat::from_fn(rows, columns.len(), |i, j| columns[j][i]);
        (!units.is_empty()).then_some(Self { lift, units, gauge: None, angular, own_count: 0 })
    }

    /// Number of motions.
    pub fn count(&self) -> usize {
        self.units.len()
    }

    /// Of each motion, whether it is a turn and whether it belongs to the placement.
    pub fn kinds(&self) -> impl Iterator<Item = (bool, bool)> {
        self.angular.iter().zip(&self.units).map(|(angular, unit)| (*angular, unit.2))
    }

    /// Standard deviation that the motions give component `i` of all links.
    pub fn reach(&self, i: usize) -> f64 {
        (0..self.count()).map(|j| self.lift[(i, j)].powi(2)).sum::<f64>().sqrt()
    }

    /// Leaves out what changes nothing; `complements` are, limb by limb, bases of what poses tell of its links, in units
    /// of their reach.
    pub fn reduce(&mut self, limbs: &[LimbCoordinates], complements: &[Mat<f64>]) {
        let own: usize = limbs.iter().map(|limb| limb.count).sum();
        let told: usize = complements.iter().map(Mat::ncols).sum();
        let mut all = Mat::<f64>::zeros(told, own + self.count());
        let (mut row, mut start) = (0, 0);
        for (limb, complement) in limbs.iter().zip(complements) {
            let reached: Vec<usize> = (0..limb.reach.len()).filter(|&i| limb.reach[i] > 0.0).collect();
            let by_own = |j: usize| -> Vec<f64> {
                let mut u = vec![0.0; limb.reach.len()];
                for (k, &i) in limb.free.iter().enumerate() {
                    u[i] = limb.basis[(k, j)] * limb.sigma[i] / limb.reach[i];
                }
                reached.iter().map(|&i| u[i]).collect()
            };
            let by_motion = |j: usize| -> Vec<f64> {
                reached.iter().map(|&i| self.lift[(start + i, j)] / limb.reach[i]).collect()
            };
            let mut put = |column: usize, u: &[f64]| {
                let told = linalg::mul_transpose(complement.as_ref(), u);
                told.iter().enumerate().for_each(|(k, v)| all[(row + k, column)] = *v);
            };
            (0..limb.count).for_each(|j| put(limb.offset + j, &by_own(j)));
            (0..self.count()).for_each(|j| put(own + j, &by_motion(j)));
            row += complement.ncols();
            start += limb.reach.len();
        }
        let Some(svd) = linalg::svd(all.as_ref()) else { return };
        let largest = svd.s.first().copied().unwrap_or(0.0);
        let rank = svd.s.iter().filter(|s| **s > REDUNDANT * largest).count();
        self.gauge = Some(svd.v.get(.., ..rank).to_owned());
    }

    /// Names of the coordinates: combinations where the redundancy is left out, else of the motions alone.
    pub fn params(&self) -> Vec<Param> {
        let unbounded = (f64::NEG_INFINITY, f64::INFINITY);
        let combination = |k: usize| Param {
            name: format!("combination {}", k + 1),
            unit: "",
            scale: 1.0,
            bounds: unbounded,
        };
        let motion = |(i, (unit, name, _)): (usize, &(f64, String, bool))| Param {
            name: name.clone(),
            unit: if self.angular[i] { "rad" } else { "m" },
            scale: *unit,
            bounds: unbounded,
        };
        match &self.gauge {
            Some(gauge) => (0..gauge.ncols()).map(combination).collect(),
            None => self.units.iter().enumerate().map(motion).collect(),
        }
    }

    /// The motions and how many coordinates each has.
    pub fn groups(&self) -> Vec<(&'static str, usize)> {
        let count = |placement: bool| self.units.iter().filter(|unit| unit.2 == placement).count();
        let both = [("placement", count(true)), ("tool mounting", count(false))];
        both.into_iter().filter(|(_, count)| *count > 0).collect()
    }

    /// Twists of a limb's links by all coordinates, from those by its own and by the motions.
    pub fn by_all(&self, limb: &LimbCoordinates, own: &Mat<f64>, motions: &Mat<f64>) -> Mat<f64> {
        if let Some(gauge) = &self.gauge {
            let first = gauge.nrows() - self.count();
            let of_limb = gauge.get(limb.offset..limb.offset + limb.count, ..);
            return own * of_limb + motions * gauge.get(first.., ..);
        }
        let mut out = Mat::zeros(own.nrows(), self.own_count + self.count());
        out.as_mut().subcols_mut(limb.offset, limb.count).copy_from(own);
        out.as_mut().subcols_mut(self.own_count, self.count()).copy_from(motions);
        out
    }

    /// The redundancy of the limbs, a column each, with that of the motions: a motion, and links that undo it.
    pub fn with_redundancy(
        &self,
        limbs: &[LimbCoordinates],
        of_limbs: Mat<f64>,
        unit: impl Fn(&LimbCoordinates, usize) -> f64,
    ) -> Mat<f64> {
        let sigma: Vec<f64> = limbs.iter().flat_map(|limb| limb.sigma.iter().copied()).collect();
        let held: Vec<usize> = (0..sigma.len()).filter(|&i| sigma[i] == 0.0 && self.reach(i) > 0.0).collect();
        let at_held = Mat::from_fn(held.len(), self.count(), |i, j| self.lift[(held[i], j)]);
        let motions = match linalg::svd(at_held.as_ref()).filter(|_| !held.is_empty()) {
            Some(svd) => {
                let largest = svd.s.first().copied().unwrap_or(0.0);
                let rank = svd.s.iter().filter(|s| **s > REDUNDANT * largest).count();
                svd.v.get(.., rank..).to_owned()
            }
            None => Mat::identity(self.count(), self.count()),
        };
        let links = &self.lift * &motions;
        let mut all = Mat::<f64>::zeros(of_limbs.nrows(), of_limbs.ncols() + motions.ncols());
        all.as_mut().subcols_mut(0, of_limbs.ncols()).copy_from(&of_limbs);
        for j in 0..motions.ncols() {
            let column = of_limbs.ncols() + j;
            let mut start = 0;
            for limb in limbs {
                for (k, &i) in limb.free.iter().enumerate() {
                    all[(limb.offset + k, column)] = -links[(start + i, j)] / unit(limb, i);
                }
                start += limb.sigma.len();
            }
            for i in 0..self.count() {
                all[(self.own_count + i, column)] = motions[(i, j)];
            }
        }
        all.qr().compute_thin_Q()
    }

    /// The motions that held components ask for, in their units: those of `deviations` that no link can make itself.
    pub fn asked_for(&self, limbs: &[LimbCoordinates], deviations: &[f64]) -> Vec<f64> {
        let sigma: Vec<f64> = limbs.iter().flat_map(|limb| limb.sigma.iter().copied()).collect();
        let held: Vec<usize> = (0..sigma.len()).filter(|&i| sigma[i] == 0.0 && self.reach(i) > 0.0).collect();
        if held.is_empty() {
            return vec![0.0; self.count()];
        }
        let jac = Mat::from_fn(held.len(), self.count(), |i, j| self.lift[(held[i], j)]);
        let r: Vec<f64> = held.iter().map(|&i| -deviations[i]).collect();
        linalg::pseudo_inverse_step(jac.as_ref(), &r, REDUNDANT).unwrap_or_else(|| vec![0.0; self.count()])
    }
}

/// Standard deviation of component `i` of a motion, rad or m; 0 where it is held.
fn sigma(tolerance: Tolerance, i: usize, length: f64) -> f64 {
    let (prior, size) = if i < 3 { (tolerance.angle, 1.0) } else { (tolerance.length, length) };
    match prior {
        Prior::Held => 0.0,
        Prior::Sigma(sigma) => sigma,
        Prior::Free => FREE_LINK * size,
    }
}

/// About where a placement turns: the origin of {S} where a tolerance of its turn, or of where that origin is, is stated;
/// amid the first joints where all of it is free.
fn centre(mechanism: &Mechanism, tolerance: Tolerance) -> Vector3<f64> {
    if tolerance.angle != Prior::Free || tolerance.length != Prior::Free {
        return Vector3::zeros();
    }
    let firsts = mechanism.limbs.iter().filter_map(|limb| limb.links.first());
    firsts.map(|link| link.nominal.p).sum::<Vector3<f64>>() / mechanism.limbs.len().max(1) as f64
}

/// Deviations of all links by one twist of a motion.
fn column(mechanism: &Mechanism, rows: usize, centre: &Se3, twist: &Twist, placement: bool) -> Vec<f64> {
    let mut column = vec![0.0; rows];
    let mut start = 0;
    for limb in &mechanism.limbs {
        let size = 6 * limb.links.len();
        match (placement, limb.links.first()) {
            (true, Some(link)) => {
                let moved = se3::adjoint(&(link.nominal.inverse() * *centre)) * twist;
                column[start..start + 6].copy_from_slice(moved.as_slice());
            }
            _ => column[start + size - 6..start + size].copy_from_slice(twist.as_slice()),
        }
        start += size;
    }
    column
}
