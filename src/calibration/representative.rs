//! The description of a machine that deviates least, among all that predict the same poses.

use super::coordinates::{Coordinates, LimbCoordinates};
use crate::lie::Se3;
use crate::lie::se3::{self, Twist};
use crate::linalg;
use crate::model::{Geometry, Limb, Mechanism};
use crate::problem::{Form, Representative};
use faer::Mat;
use faer::linalg::solvers::Solve;

/// Most rounds; each shrinks what is left by the size of the deviations, some 1e-3.
const ROUNDS: usize = 12;
/// Deviation along the redundancy, in tolerances, that is left.
const LEFT: f64 = 1e-11;

/// Minimal coordinates of the machine with the links of `geometry`: the description that predicts the same poses and
/// has no part along the redundancy at nominal (docs/theory.md section 6).
///
/// Each redundant change is carried out as the finite motion that it is: along or about a joint's own axis, taken
/// from the link before it and given to the link behind it. Limbs with links that are held in part have no such
/// motions; there the redundancy is left out to first order.
pub fn representative(mechanism: &Mechanism, geometry: &Geometry) -> Vec<f64> {
    let coordinates = Coordinates::new(mechanism, Form::Minimal);
    let mut shifted = geometry.clone();
    for ((limb, own), links) in mechanism.limbs.iter().zip(&coordinates.limbs).zip(&mut shifted.limbs) {
        if own.moves_as_a_whole() {
            Shift::of(limb, own).carry_out(links);
        }
    }
    coordinates.nearest(&shifted.deviations_from(&mechanism.nominal()))
}

/// The same of the machine with deviations `d` (rad, m) of its links, with its derivative by their components in
/// tolerances that are not held; `minimal` are the coordinates of that form.
pub(super) fn with_derivative(
    mechanism: &Mechanism,
    minimal: &Coordinates,
    geometry: &Geometry,
    d: &[f64],
) -> Representative {
    let complete: usize = minimal.blocks().map(|block| block.free.len()).sum();
    let mut jac = Mat::zeros(minimal.count(), complete);
    let mut shifted = geometry.clone();
    let (mut start, mut column) = (0, 0);
    for ((limb, own), links) in mechanism.limbs.iter().zip(&minimal.limbs).zip(&mut shifted.limbs) {
        let part = match own.moves_as_a_whole() {
            true => {
                let shift = Shift::of(limb, own);
                let behind = shift.carry_out(links);
                shift.derivative(links, &behind, &d[start..start + own.sigma.len()])
            }
            false => own.basis.transpose().to_owned(),
        };
        jac.as_mut().submatrix_mut(own.offset, column, own.count, own.free.len()).copy_from(&part);
        (start, column) = (start + own.sigma.len(), column + own.free.len());
    }
    for k in 0..minimal.instrument.count {
        jac[(minimal.instrument.offset + k, column + k)] = 1.0;
    }
    Representative { z: minimal.nearest(&shifted.deviations_from(&mechanism.nominal())), jac }
}

impl LimbCoordinates {
    /// Whether no component is held, so that every redundant change is a motion that the limb may make.
    fn moves_as_a_whole(&self) -> bool {
        self.free.len() == self.sigma.len()
    }
}

/// One redundant change: the twist that the link before the joint takes, and whether the link behind it gives it back.
struct Change {
    before: usize,
    twist: Twist,
    passes_on: bool,
}

/// What moves a limb along its redundancy.
struct Shift<'a> {
    limb: &'a Limb,
    own: &'a LimbCoordinates,
    nominal: Vec<Se3>,
    /// Orthonormal basis of the redundancy at nominal, in tolerances.
    slice: Mat<f64>,
    changes: Vec<Change>,
}

impl<'a> Shift<'a> {
    fn of(limb: &'a Limb, own: &'a LimbCoordinates) -> Self {
        let nominal: Vec<Se3> = limb.links.iter().map(|link| link.nominal).collect();
        // In the frames of the joints the twist that the link before takes is the same at every geometry.
        let basis = limb.null_basis(&nominal);
        let changes = basis.iter().filter_map(|column| {
            let mut blocks = column.chunks_exact(6).enumerate().filter(|(_, b)| b.iter().any(|v| *v != 0.0));
            let (before, twist) = blocks.next()?;
            let twist = Twist::from_column_slice(twist);
            Some(Change { before, twist, passes_on: blocks.next().is_some() })
        });
        let changes = changes.collect();
        let slice = scaled(limb, own, &nominal).qr().compute_thin_Q();
        Self { limb, own, nominal, slice, changes }
    }

    /// Moves along the redundancy until nothing of the deviation in tolerances lies along that at nominal; returns by
    /// what motion each link ended up multiplied from behind.
    fn carry_out(&self, links: &mut [Se3]) -> Vec<Se3> {
        let mut behind = vec![Se3::identity(); links.len()];
        for _ in 0..ROUNDS {
            let deviations = self.deviations(links);
            let u: Vec<f64> = deviations.iter().zip(&self.own.sigma).map(|(d, sigma)| d / sigma).collect();
            let along = linalg::mul_transpose(self.slice.as_ref(), &u);
            let left = linalg::norm(&along);
            if left <= LEFT || !left.is_finite() {
                break;
            }
            let rates = self.slice.transpose() * scaled(self.limb, self.own, links);
            let right = Mat::from_fn(along.len(), 1, |i, _| -along[i]);
            let amounts = rates.partial_piv_lu().solve(right);
            for (column, change) in self.changes.iter().enumerate() {
                let motion = se3::exp(&(change.twist * amounts[(column, 0)]));
                links[change.before] = links[change.before] * motion;
                behind[change.before] = behind[change.before] * motion;
                if change.passes_on {
                    links[change.before + 1] = motion.inverse() * links[change.before + 1];
                }
            }
        }
        behind
    }

    /// Derivative of the minimal coordinates at `links`, which were moved by `behind` from where the deviations are `d`.
    ///
    /// A body twist `b` of a link there is `Ad(h^-1) b` here, `h` the motion behind it; what of it leaves the slice is
    /// taken back along the redundancy here.
    fn derivative(&self, links: &[Se3], behind: &[Se3], d: &[f64]) -> Mat<f64> {
        let n = self.own.sigma.len();
        let here = self.deviations(links);
        let mut carried = Mat::zeros(n, n);
        let mut along = scaled(self.limb, self.own, links);
        for (link, h) in behind.iter().enumerate() {
            let at = |of: &[f64]| Twist::from_column_slice(&of[6 * link..6 * link + 6]);
            // Body twists to deviations, the inverse of the right Jacobian.
            let back = se3::left_jacobian_inverse(&-at(&here));
            let block = back * se3::adjoint(&h.inverse()) * se3::right_jacobian(&at(d));
            let sigma = &self.own.sigma[6 * link..6 * link + 6];
            for i in 0..6 {
                for j in 0..6 {
                    carried[(6 * link + i, 6 * link + j)] = block[(i, j)] * sigma[j] / sigma[i];
                }
            }
            for j in 0..along.ncols() {
                let body = back * Twist::from_fn(|i, _| along[(6 * link + i, j)] * sigma[i]);
                (0..6).for_each(|i| along[(6 * link + i, j)] = body[i] / sigma[i]);
            }
        }
        let rates = self.slice.transpose() * &along;
        let amounts = rates.partial_piv_lu().solve(self.slice.transpose() * &carried);
        self.own.basis.transpose() * (carried - along * amounts)
    }

    fn deviations(&self, links: &[Se3]) -> Vec<f64> {
        let of = |(link, nominal): (&Se3, &Se3)| se3::log(&(nominal.inverse() * *link)).as_slice().to_vec();
        links.iter().zip(&self.nominal).flat_map(of).collect()
    }
}

/// The redundancy at `links` as body twists in tolerances, one column a change.
fn scaled(limb: &Limb, own: &LimbCoordinates, links: &[Se3]) -> Mat<f64> {
    let columns = limb.null_basis(links);
    Mat::from_fn(own.sigma.len(), columns.len(), |i, j| columns[j][i] / own.sigma[i])
}
