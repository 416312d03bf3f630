//! Uncertainty of predicted poses, from that of the links (docs/theory.md (10.3)).

use super::twists::twists_by_links;
use crate::linalg;
use crate::model::{Ends, Mechanism, Posture, Prior, Tolerance};
use crate::problem::{EvalError, Form};
use faer::Mat;
use nalgebra::Matrix6;
use rayon::prelude::*;

/// Square root of the covariance of a machine's links.
#[derive(Clone, Debug)]
pub struct LinkRoot {
    /// Column by column independent errors of one standard deviation: six rows a link, the body twist of its frame, rad
    /// and m.
    pub root: Mat<f64>,
    /// Of each column's variance, the share that stems from the tolerances.
    pub prior_share: Vec<f64>,
}

/// Covariance of a predicted pose error `[w; dp]` (rad and m, {S} axes, dp that of the tool point).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseCovariance {
    /// All of it.
    pub total: Matrix6<f64>,
    /// The part that stems from the tolerances and not from the noise of the measurements.
    pub prior: Matrix6<f64>,
}

impl PoseCovariance {
    /// Standard deviation of each component.
    pub fn std(&self) -> [f64; 6] {
        std::array::from_fn(|i| self.total[(i, i)].max(0.0).sqrt())
    }
}

/// Covariances of the poses that `machine`, as nominal, takes at closed postures, in their order.
pub fn pose_covariances(
    machine: &Mechanism,
    postures: &[(Vec<f64>, Posture)],
    links: &LinkRoot,
) -> Result<Vec<PoseCovariance>, EvalError> {
    // Unit tolerances, so that coordinates are the components of the links in rad and m, none of them held.
    let mut unit = machine.clone();
    unit.instrument.clear();
    unit.ends = Ends::default();
    for link in unit.limbs.iter_mut().flat_map(|limb| &mut limb.links) {
        link.tolerance = Tolerance { angle: Prior::Sigma(1.0), length: Prior::Sigma(1.0) };
    }
    let zero = vec![0.0; unit.component_count()];
    let one = |(actuators, posture): &(Vec<f64>, Posture)| {
        let by_links = twists_by_links(&unit, &[(actuators, posture.tool())], Form::Complete, &zero)?;
        Ok(covariance(&(by_links * &links.root), &links.prior_share))
    };
    postures.par_iter().map(one).collect()
}

fn covariance(root: &Mat<f64>, prior_share: &[f64]) -> PoseCovariance {
    let rows: Vec<Vec<f64>> = (0..6).map(|i| root.row(i).iter().copied().collect()).collect();
    let prior: Vec<Vec<f64>> =
        rows.iter().map(|row| row.iter().zip(prior_share).map(|(v, share)| v * share).collect()).collect();
    PoseCovariance {
        total: Matrix6::from_fn(|i, j| linalg::dot(&rows[i], &rows[j])),
        prior: Matrix6::from_fn(|i, j| linalg::dot(&prior[i], &rows[j])),
    }
}
