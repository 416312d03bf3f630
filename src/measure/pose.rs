//! A measured pose, or some of its components.

use super::measurement::{Clue, Errors, Evaluation, Measurement, Row, View, Weights};
use super::point::Point;
use crate::lie::{Se3, so3};
use crate::model::mechanism::pose_difference;
use nalgebra::{DMatrix, DVector, Matrix6, Vector3};
use std::array::from_fn;
use std::sync::Arc;

/// Noise that cannot be whitened.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("the noise covariance is not positive definite")]
pub struct NotPositive;

/// Rows by which pose errors `[rotation; displacement of the tool point]` are weighted, k x 6.
#[derive(Clone, Debug)]
pub struct Weighting(Vec<[f64; 6]>);

impl Weighting {
    /// `C^(-1/2)`, lower triangular, of the covariance (6 x 6, rotation first, rad and m, {S} axes) of the components in
    /// `seen`.
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
    pub(super) fn isotropic(seen: [bool; 6], angle: f64, length: f64) -> Self {
        let row = |i: usize| {
            std::array::from_fn(|j| if i != j { 0.0 } else { 1.0 / if i < 3 { angle } else { length } })
        };
        Self((0..6).filter(|&i| seen[i]).map(row).collect())
    }

    /// For noise of so many times the size.
    pub(super) fn scaled(&self, factor: f64) -> Self {
        Self(self.0.iter().map(|row| row.map(|v| v / factor)).collect())
    }

    /// The rows.
    pub(super) fn rows(&self) -> &[[f64; 6]] {
        &self.0
    }

    /// A draw of the noise that these rows whiten, zero in components that have no row.
    pub(super) fn draw(&self, normal: &mut dyn FnMut() -> f64) -> [f64; 6] {
        let k = self.0.len();
        let seen: Vec<usize> = (0..6).filter(|&i| self.0.iter().any(|row| row[i] != 0.0)).collect();
        let whitening = DMatrix::from_fn(k, seen.len(), |i, j| self.0[i][seen[j]]);
        let white = DVector::from_fn(k, |_, _| normal());
        let mut error = [0.0; 6];
        if let Some(found) = whitening.lu().solve(&white) {
            seen.iter().zip(found.iter()).for_each(|(&i, v)| error[i] = *v);
        }
        error
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

    /// A whole pose of which only the components in `weighed` have a part in residuals: what is known to be compared
    /// with, where an instrument does not measure all of it.
    pub fn known(measured: Se3, weighed: [bool; 6], covariance: &Matrix6<f64>) -> Result<Self, NotPositive> {
        Ok(Self { measured, seen: [true; 6], weighting: Weighting::whitening(covariance, weighed)? })
    }
}

impl Measurement for Pose {
    fn rows(&self) -> usize {
        self.weighting.0.len()
    }

    /// (8.1), (8.2)
    fn evaluate(&self, view: &View<'_>, out: &mut Evaluation) {
        let (w, dp) = pose_difference(&view.tool, &self.measured);
        // The rotation vector of R R_m' changes by the inverse left Jacobian, which is 1 at no error.
        let turn = so3::left_jacobian_inverse(&w);
        let [t, u, v] = [0, 1, 2].map(|i| [turn[(i, 0)], turn[(i, 1)], turn[(i, 2)]]);
        out.rows.reserve(self.weighting.0.len());
        for &[a, b, c, x, y, z] in &self.weighting.0 {
            let [d, e, f]: [f64; 3] = from_fn(|i| a * t[i] + b * u[i] + c * v[i]);
            let r = (a * w.x + b * w.y + c * w.z) + (x * dp.x + y * dp.y + z * dp.z);
            out.rows.push(Row { r, by_tool: [d, e, f, x, y, z] });
        }
    }

    fn is_angle(&self, row: usize) -> bool {
        self.weighting.0.get(row).is_some_and(|k| k[..3].iter().any(|v| *v != 0.0))
    }

    fn pose(&self) -> Option<&Se3> {
        (self.seen == [true; 6]).then_some(&self.measured)
    }

    fn clue(&self) -> Clue {
        match self.seen {
            [true, true, true, true, true, true] => Clue::Pose(self.measured),
            [_, _, _, true, true, true] => Clue::Position { target: Point::default(), at: self.measured.p },
            _ => Clue::None,
        }
    }

    fn readings(&self) -> Vec<f64> {
        so3::log(&self.measured.r).iter().chain(&self.measured.p).copied().collect()
    }

    fn error(&self, view: &View<'_>) -> Errors {
        let (w, dp) = pose_difference(&view.tool, &self.measured);
        let norm = |v: Vector3<f64>, seen: &[bool]| {
            let square: f64 = v.iter().zip(seen).filter(|(_, seen)| **seen).map(|(v, _)| v * v).sum();
            seen.contains(&true).then_some(square.sqrt())
        };
        let (rotation, position) = (norm(w, &self.seen[..3]), norm(dp, &self.seen[3..]));
        Errors { rotation, position, ..Errors::default() }
    }

    fn expected(&self, view: &View<'_>) -> Arc<dyn Measurement> {
        Arc::new(Self { measured: view.tool, ..self.clone() })
    }

    fn perturbed(&self, normal: &mut dyn FnMut() -> f64) -> Arc<dyn Measurement> {
        let [a, b, c, x, y, z] = self.weighting.draw(normal);
        let r = so3::exp(&Vector3::new(a, b, c)) * self.measured.r;
        Arc::new(Self { measured: Se3 { r, p: self.measured.p + Vector3::new(x, y, z) }, ..self.clone() })
    }

    fn reweighted(&self, weights: Weights) -> Arc<dyn Measurement> {
        let weighting = match weights {
            Weights::Unit => Weighting::isotropic(self.seen, 1.0, 1.0),
            Weights::Isotropic { angle, length } => Weighting::isotropic(self.seen, angle, length),
            Weights::SpatialTwist => Weighting::spatial_twist(&self.measured, self.seen),
            Weights::Scaled(factor) => self.weighting.scaled(factor),
        };
        Arc::new(Self { weighting, ..self.clone() })
    }
}
