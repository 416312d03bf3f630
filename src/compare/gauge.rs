//! The description of a machine that deviates least, among all that predict the same poses.

use crate::calibration::{Coordinates, LimbCoordinates};
use crate::lie::Se3;
use crate::lie::se3::{self, Twist};
use crate::linalg;
use crate::model::{Geometry, Limb, Mechanism};
use crate::problem::Form;
use faer::Mat;

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
        if own.free.len() == own.sigma.len() {
            shift(limb, own, links);
        }
    }
    coordinates.nearest(&shifted.deviations_from(&mechanism.nominal()))
}

/// Moves along the redundancy until nothing of the deviation in tolerances lies along that at nominal.
fn shift(limb: &Limb, own: &LimbCoordinates, links: &mut [Se3]) {
    let nominal: Vec<Se3> = limb.links.iter().map(|link| link.nominal).collect();
    let scaled = |links: &[Se3]| {
        let columns = limb.null_basis(links);
        Mat::from_fn(own.sigma.len(), columns.len(), |i, j| columns[j][i] / own.sigma[i])
    };
    let slice = scaled(&nominal).qr().compute_thin_Q();
    for _ in 0..ROUNDS {
        let deviations = links.iter().zip(&nominal).flat_map(|(link, nominal)| {
            let d = se3::log(&(nominal.inverse() * *link));
            d.as_slice().to_vec()
        });
        let u: Vec<f64> = deviations.zip(&own.sigma).map(|(d, sigma)| d / sigma).collect();
        let along = linalg::mul_transpose(slice.as_ref(), &u);
        let left = linalg::norm(&along);
        if left <= LEFT || !left.is_finite() {
            return;
        }
        use faer::linalg::solvers::Solve;
        let rates = slice.transpose() * scaled(links);
        let right = Mat::from_fn(along.len(), 1, |i, _| -along[i]);
        let amounts = rates.partial_piv_lu().solve(right);
        for column in 0..amounts.nrows() {
            carry_out(limb, links, column, amounts[(column, 0)]);
        }
    }
}

/// Carries out `amount` of the redundant change in column `column` of the null basis.
fn carry_out(limb: &Limb, links: &mut [Se3], column: usize, amount: f64) {
    let change = &limb.null_basis(links)[column];
    let mut blocks = change.chunks_exact(6).enumerate().filter(|(_, b)| b.iter().any(|v| *v != 0.0));
    let Some((before, twist)) = blocks.next() else { return };
    let passes_on = blocks.next().is_some();
    let twist = Twist::from_column_slice(twist) * amount;
    links[before] = links[before] * se3::exp(&twist);
    if passes_on {
        links[before + 1] = se3::exp(&-twist) * links[before + 1];
    }
}
