//! The structural count of a limb whose links are held in part (docs/theory.md section 4).
//!
//! Links that are held keep axes meeting, parallel or square in every machine that respects them, and that may hide
//! directions beyond (17)-(21): where the axes of a ball joint meet, for one, a turn of the link before it about the
//! ball's centre is a turn of the ball itself. So the count is a rank: that of `W Phi` over random joint variables of
//! the limb, at a random machine which deviates wherever it may. A pose holds the limbs apart, (11), so that each limb
//! counts by itself.

use super::coordinates::{Coordinates, LimbCoordinates};
use crate::lie::Se3;
use crate::lie::se3::{self, Twist};
use crate::linalg;
use crate::model::{Ends, Geometry, Limb, Mechanism, Posture};
use crate::problem::Form;
use faer::Mat;
use nalgebra::Vector3;

/// Size of the random deviations, rad and machine sizes: far from every special geometry.
const APART: f64 = 0.4;
/// The same where the machines near one geometry are asked for.
const NEARBY: f64 = 1e-3;
/// Range of the random joint variables, rad and machine sizes.
const RANGE: f64 = 1.5;
/// Part of the largest singular value below which one is rounding: at such a machine the others are above 1e-5.
const RANK: f64 = 1e-9;

impl Coordinates {
    /// The structural count of identifiable parameters of each limb of the mechanism.
    pub fn structural_counts(&self, mechanism: &Mechanism) -> Vec<usize> {
        let length = mechanism.characteristic_length();
        let limbs = mechanism.limbs.iter().zip(&self.limbs);
        limbs.map(|(limb, own)| structural_count(limb, own, length)).collect()
    }

    /// The structural count of the machine, constants of the instrument included.
    pub fn structural_count(&self, mechanism: &Mechanism) -> usize {
        if self.shared.is_some() {
            // Limbs do not count by themselves; what is redundant was left out by rank.
            return Coordinates::new(mechanism, Form::Minimal).count();
        }
        self.structural_counts(mechanism).iter().sum::<usize>() + self.instrument.count
    }

    /// Orthonormal basis (count x k; complete coordinates) of all that no pose tells apart near this geometry, to some
    /// thousandths: the redundancy (17)-(21), and what held links hide besides.
    pub fn structural_null(&self, mechanism: &Mechanism, geometry: &Geometry) -> Mat<f64> {
        if self.shared.is_some() {
            return self.redundant(mechanism, geometry, &geometry.deviations_from(&mechanism.nominal()));
        }
        let length = mechanism.characteristic_length();
        let counts = self.structural_counts(mechanism);
        let total = self.limbs.iter().zip(&counts).map(|(own, count)| own.free.len() - count).sum();
        let mut out = Mat::zeros(self.count(), total);
        let mut column = 0;
        for (((limb, own), links), count) in
            mechanism.limbs.iter().zip(&self.limbs).zip(&geometry.limbs).zip(counts)
        {
            let null = structural_null(limb, own, links, length, count);
            out.as_mut().submatrix_mut(own.offset, column, null.nrows(), null.ncols()).copy_from(&null);
            column += null.ncols();
        }
        out
    }
}

/// Number of combinations of the limb's deviations that poses can tell apart in machines that respect what is held.
fn structural_count(limb: &Limb, own: &LimbCoordinates, length: f64) -> usize {
    let nominal: Vec<Se3> = limb.links.iter().map(|link| link.nominal).collect();
    if own.free.len() == own.sigma.len() {
        return own.slice.len();
    }
    let mut rows = rows(limb, own, &nominal, APART, length);
    for (column, _) in own.free.iter().enumerate().filter(|(_, component)| **component % 6 > 2) {
        rows.as_mut().col_mut(column).iter_mut().for_each(|v| *v *= length);
    }
    let Some(values) = linalg::singular_values(rows.as_ref()) else { return own.slice.len() };
    // Rows are of order one, unless nothing is seen at all.
    let largest = values.first().copied().unwrap_or(0.0).max(1.0);
    values.iter().filter(|value| **value > RANK * largest).count().min(own.slice.len())
}

/// Combinations of the limb's components that are not held (in tolerances; orthonormal columns) which no pose tells apart
/// at these links nor at machines near them, `free - count` of them, where `count` is the structural count.
///
/// The limit of the null space of deviated machines, to some thousandths.
fn structural_null(limb: &Limb, own: &LimbCoordinates, links: &[Se3], length: f64, count: usize) -> Mat<f64> {
    let mut rows = rows(limb, own, links, NEARBY, length);
    for (column, &component) in own.free.iter().enumerate() {
        rows.as_mut().col_mut(column).iter_mut().for_each(|v| *v *= own.sigma[component]);
    }
    match linalg::svd(rows.as_ref()) {
        Some(svd) => svd.v.get(.., count.min(svd.v.ncols())..).to_owned(),
        None => Mat::zeros(own.free.len(), 0),
    }
}

/// `W Phi` by the components that are not held, over random joint variables at links that deviate by some `size` (rad and
/// machine sizes) wherever they may.
fn rows(limb: &Limb, own: &LimbCoordinates, links: &[Se3], size: f64, length: f64) -> Mat<f64> {
    let free = &own.free;
    let mut limb = limb.clone();
    // A sensor shows what a passive joint would hide (8.9).
    limb.joints.iter_mut().for_each(|joint| joint.actuated |= joint.sensed);
    let rows_each = 6 - limb.passive_count().min(6);
    let mut numbers = Numbers(0);
    let mut deviated = links.to_vec();
    for (j, link) in deviated.iter_mut().enumerate() {
        let d = Twist::from_fn(|i, _| {
            let unit = if i < 3 { 1.0 } else { length };
            if own.sigma[6 * j + i] > 0.0 { size * unit * numbers.next() } else { 0.0 }
        });
        *link = *link * se3::exp(&d);
    }
    let geometry = Geometry { limbs: vec![deviated], instrument: Vec::new() };
    let machine = Mechanism { limbs: vec![limb], instrument: Vec::new(), ends: Ends::default() };
    let mut posture = Posture::new(&machine);
    let postures = 2 * free.len().div_ceil(rows_each.max(1)) + 4;
    let mut rows = Mat::zeros(postures * rows_each, free.len());
    for k in 0..postures {
        for (q, joint) in posture.q.iter_mut().zip(machine.limbs.iter().flat_map(|limb| &limb.joints)) {
            *q = RANGE * numbers.next() * if joint.motion.is_angular() { 1.0 } else { length };
        }
        posture.open(&machine, &geometry);
        let tool = posture.tool().p;
        for (row, wrench) in posture.splits.iter().flat_map(|split| split.wrenches()).enumerate() {
            let turning = Vector3::new(wrench[0], wrench[1], wrench[2]);
            let moving = Vector3::new(wrench[3], wrench[4], wrench[5]) / posture.length();
            for (column, &component) in free.iter().enumerate() {
                let frame = Se3::from(posture.frames[component / 6]);
                let axis = frame.r.column(component % 3).into_owned();
                rows[(k * rows_each + row, column)] = match component % 6 < 3 {
                    true => turning.dot(&axis) + moving.dot(&axis.cross(&(tool - frame.p))),
                    false => moving.dot(&axis),
                };
            }
        }
    }
    rows
}

/// Numbers between -1 and 1 without order, the same every time (a multiplicative congruential generator: Park & Miller,
/// Comm. ACM 31, 1988).
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = (self.0 + 1_234_567) * 16_807 % 2_147_483_647;
        self.0 as f64 / 1_073_741_823.5 - 1.0
    }
}
