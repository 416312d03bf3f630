//! A measured pose, or some of its components.

use super::measurement::{Measurement, PoseError, Row, Weights};
use crate::lie::{Se3, so3};
use crate::model::mechanism::pose_difference;
use nalgebra::{Matrix6, Vector3};
use std::sync::Arc;

/// Noise that cannot be whitened.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("the noise covariance is not positive definite")]
pub struct NotPositive;

/// Rows by which pose errors `[rotation; displacement of the tool point]` are weighted, k x 6.
#[derive(Clone, Debug)]
pub struct Weighting(Vec<[f64; 6]>);

impl Weighting {
    /// `L^-1` of the covariance (6 x 6, rotation first, rad and m, {S} axes) of the components in `seen`.
    ///
    /// Components that are not seen have no row: the covariance of the others is their block.
    pub fn whitening(covariance: &Matrix6<f64>, seen: [bool; 6]) -> Result<Self, NotPositive> {
        let index: Vec<usize> = (0..6).filter(|&i| seen[i]).collect();
        let k = index.len();
        let block = nalgebra::DMatrix::from_fn(k, k, |i, j| covariance[(index[i], index[j])]);
        // Rotations and lengths differ by orders of magnitude: the test is on the correlation matrix.
        let sigma: Vec<f64> = (0..k).map(|i| block[(i, i)].sqrt()).collect();
        if sigma.iter().any(|s| !s.is_finite() || *s <= 0.0) {
            return Err(NotPositive);
        }
        let correlation = nalgebra::DMatrix::from_fn(k, k, |i, j| block[(i, j)] / (sigma[i] * sigma[j]));
        let lower = correlation.cholesky().ok_or(NotPositive)?.l();
        let inverse = lower.try_inverse().ok_or(NotPositive)?;
        let mut rows = vec![[0.0; 6]; k];
        for (i, row) in rows.iter_mut().enumerate() {
            for (j, &component) in index.iter().enumerate() {
                row[component] = inverse[(i, j)] / sigma[j];
            }
        }
        if rows.iter().flatten().all(|v| v.is_finite()) { Ok(Self(rows)) } else { Err(NotPositive) }
    }

    /// Independent noise of standard deviations `angle` (rad) and `length` (m).
    fn isotropic(seen: [bool; 6], angle: f64, length: f64) -> Self {
        let row = |i: usize| {
            std::array::from_fn(|j| if i != j { 0.0 } else { 1.0 / if i < 3 { angle } else { length } })
        };
        Self((0..6).filter(|&i| seen[i]).map(row).collect())
    }

    /// The unweighted spatial twist of (30): `v = dp + p x w` at the measured position.
    fn spatial_twist(measured: &Se3, seen: [bool; 6]) -> Self {
        let mut m = Matrix6::identity();
        if seen == [true; 6] {
            m.fixed_view_mut::<3, 3>(3, 0).copy_from(&so3::hat(&measured.p));
        }
        let rows = m.row_iter().zip(seen).filter(|(_, seen)| *seen);
        Self(rows.map(|(row, _)| std::array::from_fn(|i| row[i])).collect())
    }
}

/// A pose measured in {S}, weighted.
#[derive(Clone, Debug)]
pub struct Pose {
    measured: Se3,
    /// Components that were measured, rotation first.
    seen: [bool; 6],
    weighting: Weighting,
}

impl Pose {
    /// A measured pose with the noise covariance (6 x 6, rotation first, rad and m, {S} axes) of its components;
    /// those not in `seen` are placeholders.
    pub fn new(measured: Se3, seen: [bool; 6], covariance: &Matrix6<f64>) -> Result<Self, NotPositive> {
        Ok(Self { measured, seen, weighting: Weighting::whitening(covariance, seen)? })
    }
}

impl Measurement for Pose {
    fn rows(&self) -> usize {
        self.weighting.0.len()
    }

    fn evaluate(&self, tool: &Se3, rows: &mut [Row]) {
        let (w, dp) = pose_difference(tool, &self.measured);
        let error = [w.x, w.y, w.z, dp.x, dp.y, dp.z];
        // The rotation vector of R R_m' changes by the inverse left Jacobian, which is 1 at no error.
        let turn = so3::left_jacobian_inverse(&w);
        for (row, k) in rows.iter_mut().zip(&self.weighting.0) {
            row.r = k.iter().zip(&error).map(|(k, e)| k * e).sum();
            let by_rotation = |j: usize| k[0] * turn[(0, j)] + k[1] * turn[(1, j)] + k[2] * turn[(2, j)];
            row.by_tool = [by_rotation(0), by_rotation(1), by_rotation(2), k[3], k[4], k[5]];
        }
    }

    fn pose(&self) -> Option<&Se3> {
        (self.seen == [true; 6]).then_some(&self.measured)
    }

    fn without_pose(&self) -> Arc<dyn Measurement> {
        Arc::new(Self { seen: [false; 6], weighting: Weighting(Vec::new()), ..self.clone() })
    }

    fn position(&self) -> Option<Vector3<f64>> {
        self.seen[3..].iter().all(|seen| *seen).then_some(self.measured.p)
    }

    fn error(&self, tool: &Se3) -> PoseError {
        let (w, dp) = pose_difference(tool, &self.measured);
        let norm = |v: Vector3<f64>, seen: &[bool]| {
            let square: f64 = v.iter().zip(seen).filter(|(_, seen)| **seen).map(|(v, _)| v * v).sum();
            seen.contains(&true).then_some(square.sqrt())
        };
        PoseError { rotation: norm(w, &self.seen[..3]), position: norm(dp, &self.seen[3..]) }
    }

    fn expected(&self, tool: &Se3) -> Arc<dyn Measurement> {
        Arc::new(Self { measured: *tool, ..self.clone() })
    }

    fn reweighted(&self, weights: Weights) -> Arc<dyn Measurement> {
        let weighting = match weights {
            Weights::Unit => Weighting::isotropic(self.seen, 1.0, 1.0),
            Weights::Isotropic { angle, length } => Weighting::isotropic(self.seen, angle, length),
            Weights::SpatialTwist => Weighting::spatial_twist(&self.measured, self.seen),
        };
        Arc::new(Self { weighting, ..self.clone() })
    }
}
