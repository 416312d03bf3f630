//! Poses as files write them.

use super::error::FileError;
use super::fault::Fault;
use super::place::Place;
use super::units::{Units, limited};
use crate::lie::{Se3, so3};
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Largest deviation of a quaternion's length from 1.
const QUATERNION_LENGTH: f64 = 1e-3;

/// A pose in {S}: position, and rotation vector or quaternion. `null` stands for what was not measured.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseDrawing {
    /// Length of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position: Option<[Option<f64>; 3]>,
    /// Rotation vector, angle of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotation: Option<[Option<f64>; 3]>,
    /// `[w, x, y, z]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quaternion: Option<[Option<f64>; 4]>,
}

/// The components of a pose that were measured, the others at zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Components {
    /// rad and m.
    pub pose: Se3,
    /// Whether the rotation was measured.
    pub rotation: bool,
    /// Which coordinates of the position were measured.
    pub position: [bool; 3],
}

impl PoseDrawing {
    /// Whether nothing is stated.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// The pose as a file with these units states it.
    pub fn of(pose: &Se3, units: Units) -> Self {
        let (position, rotation) = units.from_pose(pose);
        Self { position: Some(position.map(Some)), rotation: Some(rotation.map(Some)), quaternion: None }
    }

    /// The pose, all of it, in rad and m.
    pub(super) fn complete(&self, units: Units, at: &Place<'_>) -> Result<Se3, FileError> {
        let seen = self.components(units, at)?;
        if seen.rotation && seen.position == [true; 3] {
            Ok(seen.pose)
        } else {
            Err(at.error(Fault::Incomplete))
        }
    }

    /// What there is of the pose, rad and m. Position and rotation must be stated, if only as missing.
    pub(super) fn components(&self, units: Units, at: &Place<'_>) -> Result<Components, FileError> {
        let (p, position) = self.position(units, at)?;
        let rotation = match (&self.rotation, &self.quaternion) {
            (Some(_), Some(_)) => return Err(at.error(Fault::TwoRotations)),
            (Some(vector), None) => rotation_vector(vector, units, &at.key("rotation"))?,
            (None, Some(quaternion)) => from_quaternion(quaternion, &at.key("quaternion"))?,
            (None, None) => return Err(at.error(Fault::NoRotation)),
        };
        let pose = Se3 { r: rotation.unwrap_or_else(Matrix3::identity), p };
        Ok(Components { pose, rotation: rotation.is_some(), position })
    }

    /// What there is of the position, m; a rotation, if stated, is left aside.
    pub(super) fn position_only(&self, units: Units, at: &Place<'_>) -> Result<Components, FileError> {
        let (p, position) = self.position(units, at)?;
        Ok(Components { pose: Se3 { r: Matrix3::identity(), p }, rotation: false, position })
    }

    fn position(&self, units: Units, at: &Place<'_>) -> Result<(Vector3<f64>, [bool; 3]), FileError> {
        let Some(stated) = &self.position else { return Err(at.error(Fault::NoPosition)) };
        let point = units.point(&stated.map(|v| v.unwrap_or(0.0)), &at.key("position"))?;
        Ok((point, stated.map(|v| v.is_some())))
    }
}

/// All of the components, or `None` where all are missing.
fn whole<const N: usize>(stated: &[Option<f64>; N], at: &Place<'_>) -> Result<Option<[f64; N]>, FileError> {
    let count = stated.iter().flatten().count();
    match count {
        0 => Ok(None),
        _ if count == N => Ok(Some(stated.map(|v| v.unwrap_or(0.0)))),
        _ => Err(at.error(Fault::PartRotation)),
    }
}

fn rotation_vector(
    stated: &[Option<f64>; 3],
    units: Units,
    at: &Place<'_>,
) -> Result<Option<Matrix3<f64>>, FileError> {
    let Some(stated) = whole(stated, at)? else { return Ok(None) };
    let mut w = Vector3::zeros();
    for (i, (to, from)) in w.iter_mut().zip(stated).enumerate() {
        *to = units.angle(from, &at.index(i))?;
    }
    Ok(Some(so3::exp(&w)))
}

fn from_quaternion(stated: &[Option<f64>; 4], at: &Place<'_>) -> Result<Option<Matrix3<f64>>, FileError> {
    let Some(stated) = whole(stated, at)? else { return Ok(None) };
    for (i, component) in stated.iter().enumerate() {
        limited(*component, "", &at.index(i))?;
    }
    let length = stated.iter().map(|v| v * v).sum::<f64>().sqrt();
    if length == 0.0 {
        return Err(at.error(Fault::ZeroQuaternion));
    }
    if (length - 1.0).abs() > QUATERNION_LENGTH {
        return Err(at.error(Fault::QuaternionLength(length)));
    }
    let [w, x, y, z] = stated.map(|v| v / length);
    Ok(Some(Matrix3::new(
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    )))
}
