//! Where an element stands in its parent: `pos`, and one of five ways to write a rotation.

use super::classes::Compiler;
use crate::formats::error::{FormatError, Wrong};
use crate::formats::xml::{Xml, shortest_turn, turn};
use crate::lie::{Se3, so3};
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use roxmltree::Node;

/// Pose of the element in its parent.
pub fn pose(xml: &Xml<'_>, compiler: &Compiler<'_>, node: Node<'_, '_>) -> Result<Se3, FormatError> {
    let p = Vector3::from(xml.numbers::<3>(node, "pos")?.unwrap_or_default());
    Ok(Se3 { r: rotation(xml, compiler, node)?, p })
}

fn rotation(xml: &Xml<'_>, compiler: &Compiler<'_>, node: Node<'_, '_>) -> Result<Matrix3<f64>, FormatError> {
    let zero = |attribute| xml.error(node, Wrong::ZeroAxis(attribute));
    if let Some(q) = xml.numbers::<4>(node, "quat")? {
        return quaternion(q).ok_or_else(|| zero("quat"));
    }
    if let Some([x, y, z, angle]) = xml.numbers::<4>(node, "axisangle")? {
        let axis = Vector3::new(x, y, z);
        return match axis.norm() {
            n if n < 1e-12 => Err(zero("axisangle")),
            n => Ok(so3::exp(&(axis * (angle * compiler.angle / n)))),
        };
    }
    if let Some(angles) = xml.numbers::<3>(node, "euler")? {
        let mut r = Matrix3::identity();
        for (letter, angle) in compiler.sequence.chars().zip(angles) {
            let axis = "xyz".find(letter.to_ascii_lowercase()).unwrap_or_default();
            let step = turn(axis, angle * compiler.angle);
            r = if letter.is_ascii_lowercase() { r * step } else { step * r };
        }
        return Ok(r);
    }
    if let Some([a, b, c, d, e, f]) = xml.numbers::<6>(node, "xyaxes")? {
        let x = Vector3::new(a, b, c).try_normalize(1e-12).ok_or_else(|| zero("xyaxes"))?;
        let y = Vector3::new(d, e, f);
        let y = (y - x * x.dot(&y)).try_normalize(1e-12).ok_or_else(|| zero("xyaxes"))?;
        return Ok(Matrix3::from_columns(&[x, y, x.cross(&y)]));
    }
    if let Some(z) = xml.direction(node, "zaxis")? {
        return Ok(shortest_turn(&Vector3::z(), &z));
    }
    Ok(Matrix3::identity())
}

/// Rotation of `[w, x, y, z]`, which need not have unit length; `None` for zero.
pub fn quaternion([w, x, y, z]: [f64; 4]) -> Option<Matrix3<f64>> {
    let q = Quaternion::new(w, x, y, z);
    (q.norm() > 1e-12).then(|| UnitQuaternion::from_quaternion(q).to_rotation_matrix().into_inner())
}
