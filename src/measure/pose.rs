//! A measured pose, or some of its components.

use super::measurement::{Measurement, Row};
use crate::lie::{Se3, so3};
use crate::model::mechanism::pose_difference;
use nalgebra::{Matrix6, SMatrix, Vector6};

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

    /// The unweighted spatial twist of (30): `v = dp + p x w` at the measured position.
    pub fn spatial_twist(measured: &Se3) -> Self {
        let mut m = Matrix6::identity();
        m.fixed_view_mut::<3, 3>(3, 0).copy_from(&so3::hat(&measured.p));
        Self(m.row_iter().map(|row| std::array::from_fn(|i| row[i])).collect())
    }
}

/// A pose measured in {S}, weighted.
#[derive(Clone, Debug)]
pub struct Pose {
    measured: Se3,
    /// Whether the rotation was measured, so that `measured` can start inverse kinematics.
    complete: bool,
    weighting: Weighting,
}

impl Pose {
    /// A measured pose; `complete` says that no component of it is a placeholder.
    pub fn new(measured: Se3, complete: bool, weighting: Weighting) -> Self {
        Self { measured, complete, weighting }
    }
}

impl Measurement for Pose {
    fn rows(&self) -> usize {
        self.weighting.0.len()
    }

    fn evaluate(&self, tool: &Se3, rows: &mut [Row]) {
        let (w, dp) = pose_difference(tool, &self.measured);
        let error = Vector6::new(w.x, w.y, w.z, dp.x, dp.y, dp.z);
        // The rotation vector of R R_m' changes by the inverse left Jacobian, which is 1 at no error.
        let turn = so3::left_jacobian_inverse(&w);
        for (row, weights) in rows.iter_mut().zip(&self.weighting.0) {
            let weights = SMatrix::<f64, 1, 6>::from_row_slice(weights);
            row.r = (weights * error)[0];
            let by_rotation = weights.fixed_columns::<3>(0) * turn;
            row.by_tool =
                [by_rotation[0], by_rotation[1], by_rotation[2], weights[3], weights[4], weights[5]];
        }
    }

    fn pose(&self) -> Option<&Se3> {
        self.complete.then_some(&self.measured)
    }
}
