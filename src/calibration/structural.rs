//! The structural count of a limb whose links are held in part (docs/theory.md section 4).
//!
//! Where links are held, axes meet, are parallel or square in every machine that respects what is held, and that may
//! hide directions besides the redundancy (17)-(21). An example: where the axes of a ball joint meet, a turn of the
//! link before it about the ball's centre is a turn of the ball itself. So the count is the rank of `W Phi`, stacked
//! over random joint variables of the limb, at a random machine that deviates in every component that is not held.
//! Nearly every such machine has the largest rank that there is. Given the pose, every limb has rows of its own (11):
//! each limb counts by itself.

use super::coordinates::{Coordinates, LimbCoordinates};
use crate::lie::Se3;
use crate::lie::se3::{self, Twist};
use crate::linalg;
use crate::model::{Ends, Geometry, Limb, Mechanism, Posture};
use crate::problem::Form;
use faer::Mat;
use nalgebra::Vector3;

/// Largest random deviation from the drawing in a count, rad and machine sizes: drawings have parallel and square
/// axes, at which the rank is too low, and a machine so far from them is near no other such geometry but by chance.
const APART: f64 = 0.4;
/// The same for the null space about a given geometry: small, because that of this very geometry is wanted; large
/// enough that what appears with deviations, in proportion to them, stands above rounding.
const NEARBY: f64 = 1e-3;
/// Largest random joint variable, rad and machine sizes: about a quarter of a turn.
const RANGE: f64 = 1.5;
/// Part of the largest singular value up to which one counts as zero. Rounding leaves some 1e-15; tests/held_links.rs
/// compares the counts with ranks of the whole Jacobian.
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

/// Orthonormal basis of the combinations of the limb's components, in tolerances, that no pose shows at the given
/// links nor at machines near them: free x (free - count), with `free` the number of components that are not held and
/// `count` the structural count.
///
/// At the links themselves the null space may be larger (what appears only with deviations is in it, too). So it is
/// taken at a machine that deviates by [`NEARBY`], and is that of the given links to about so much.
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

/// `W Phi` at random joint variables: a column for each component that is not held (per rad and m), rows of all
/// postures one below the other, at least twice as many as columns. The links deviate from `links` by up to `size`
/// (rad, machine sizes) in every component that is not held. The same for equal arguments.
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

/// Numbers from -1 to 1, spread evenly, the same sequence every time: Lehmer's congruential generator with modulus
/// 2^31 - 1 and multiplier 16807 (Park & Miller, Comm. ACM 31, 1988).
///
/// A constant is added before the multiplication, so that the state may begin at zero. That shifts the states by a
/// constant (modulo the modulus) and leaves the period at 2^31 - 2.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = (self.0 + 1_234_567) * 16_807 % 2_147_483_647;
        self.0 as f64 / 1_073_741_823.5 - 1.0
    }
}
