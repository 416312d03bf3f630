//! What was read at a posture, in plain numbers that a correction can change.

use crate::calibration::{ByPosture, Sample};
use crate::lie::{Se3, so3};
use crate::measure::{Measurement, Point, Pose, Position};
use crate::model::Mechanism;
use nalgebra::{Matrix3, Matrix6, Vector3};
use std::sync::Arc;

/// A measured posture, or one target of it, in plain numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// Of the sample.
    pub name: String,
    /// Readings (not reading - home) in actuator order, rad or m.
    pub actuators: Vec<f64>,
    /// Position of the tool point or of the target, m.
    pub position: Vector3<f64>,
    /// Rotation, where it was measured.
    pub rotation: Option<Matrix3<f64>>,
    /// The rotation vector as it is written, in rad: beyond half a turn the matrix does not tell it.
    pub vector: Option<Vector3<f64>>,
    /// Whether the rotation is written as a quaternion.
    pub quaternion: bool,
    /// The point of the tool whose position was measured.
    pub target: Point,
    /// Covariance by which it is weighted: rotation first, rad and m.
    pub noise: Box<Matrix6<f64>>,
}

impl Reading {
    /// The whole pose, where it was measured.
    pub fn pose(&self) -> Option<Se3> {
        self.rotation.map(|r| Se3 { r, p: self.position })
    }

    /// Rotation vector: as written, or that of the matrix.
    pub fn rotation_vector(&self) -> Option<Vector3<f64>> {
        self.vector.or_else(|| self.rotation.map(|r| so3::log(&r)))
    }

    /// Joint variables, reading - home.
    pub fn variables(&self, mechanism: &Mechanism) -> Vec<f64> {
        let joints = mechanism.limbs.iter().flat_map(|limb| &limb.joints).filter(|joint| joint.actuated);
        self.actuators.iter().zip(joints).map(|(reading, joint)| reading - joint.home).collect()
    }

    /// As a sample; `None` where its noise cannot be whitened.
    pub fn sample(&self, mechanism: &Mechanism) -> Option<Sample> {
        let measurement: Arc<dyn Measurement> = match (self.rotation, self.target == Point::default()) {
            (None, false) => {
                Arc::new(Position::new(self.position, [true; 3], self.target, &self.noise).ok()?)
            }
            (rotation, _) => {
                let turned = rotation.is_some();
                let seen = [turned, turned, turned, true, true, true];
                let pose = Se3 { r: rotation.unwrap_or_else(Matrix3::identity), p: self.position };
                Arc::new(Pose::new(pose, seen, &self.noise).ok()?)
            }
        };
        Some(Sample { name: self.name.clone(), actuators: self.variables(mechanism), measurement })
    }
}

/// Indices of the readings posture by posture: those whose actuators read the same, in the order of their first.
pub(super) fn postures(data: &[Reading]) -> Vec<Vec<usize>> {
    let by = ByPosture::of_readings(data.len(), |k| {
        data.get(k).map_or((&[], None), |reading| (reading.actuators.as_slice(), None))
    });
    by.iter().map(<[usize]>::to_vec).collect()
}

/// The readings of at most so many postures, evenly chosen.
pub(super) fn some_of(data: &[Reading], most: usize) -> Vec<Reading> {
    let all = postures(data);
    let chosen = all.iter().step_by(all.len().div_ceil(most).max(1));
    let mut indices: Vec<usize> = chosen.flatten().copied().collect();
    indices.sort_unstable();
    indices.into_iter().filter_map(|k| data.get(k).cloned()).collect()
}
