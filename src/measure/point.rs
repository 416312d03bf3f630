//! What instruments refer to: targets on the tool, fixed points, planes, gauges. Each is known, or some of its numbers
//! are constants that are identified.

use super::measurement::{ConstantDerivative, Evaluation, Row};
use crate::lie::{Se3, so3};
use nalgebra::{Vector3, Vector6};

/// A point: of the tool, in the tool's frame, or a fixed one in {S}; m.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Point {
    /// Where it is as far as it is known.
    pub nominal: Vector3<f64>,
    /// Index of the first of its three constants, where it is identified.
    pub constants: Option<usize>,
}

impl Point {
    /// A point that is known, m.
    pub fn known(at: Vector3<f64>) -> Self {
        Self { nominal: at, constants: None }
    }

    /// Where it is with these values of the constants.
    pub fn at(&self, instrument: &[f64]) -> Vector3<f64> {
        let stated = self.constants.and_then(|k| instrument.get(k..k + 3));
        stated.map_or(self.nominal, Vector3::from_column_slice)
    }

    /// Appends the derivatives of `row` by its constants, `by` being the row's gradient by the point.
    pub(super) fn derive(&self, row: usize, by: &Vector3<f64>, out: &mut Evaluation) {
        if let Some(first) = self.constants {
            let entry = |i: usize| ConstantDerivative { row, constant: first + i, value: by[i] };
            out.by_constant.extend((0..3).map(entry));
        }
    }
}

/// Gradient by the tool twist of a function with gradient `by` by the position of a point `arm` away from the tool
/// point (8.3): `[arm x by; by]`.
pub(super) fn by_twist(arm: &Vector3<f64>, by: &Vector3<f64>) -> [f64; 6] {
    let turn = arm.cross(by);
    [turn.x, turn.y, turn.z, by.x, by.y, by.z]
}

/// Appends a row of a target on the tool: its value, and its gradient `by` by the target's position in {S}.
pub(super) fn push_target_row(
    r: f64,
    by: &Vector3<f64>,
    target: &Point,
    tool: &Se3,
    instrument: &[f64],
    out: &mut Evaluation,
) {
    let arm = tool.r * target.at(instrument);
    target.derive(out.rows.len(), &tool.r.tr_mul(by), out);
    out.rows.push(Row { r, by_tool: by_twist(&arm, by) });
}

/// A plane `n . p = c` in {S}. Its constants are two tilts (rad) of `n` and the offset `c` (m).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Unit normal at no tilt.
    pub normal: Vector3<f64>,
    /// Offset as far as it is known, m.
    pub offset: f64,
    /// Indices of the two tilts, where they are identified.
    pub tilts: Option<usize>,
    /// Index of the offset, where it is identified.
    pub shift: Option<usize>,
}

impl Plane {
    /// A plane that is known; `normal` of any length but zero, `offset` in m along the unit normal.
    pub fn known(normal: Vector3<f64>, offset: f64) -> Self {
        Self { normal: normal.normalize(), offset, tilts: None, shift: None }
    }

    /// The axes about which it tilts: unit vectors square to the normal and to each other.
    pub fn tilt_axes(&self) -> [Vector3<f64>; 2] {
        let mut seed = Vector3::zeros();
        seed[self.normal.iamin()] = 1.0;
        let first = seed.cross(&self.normal).normalize();
        [first, self.normal.cross(&first)]
    }

    fn tilt(&self, instrument: &[f64]) -> Option<Vector3<f64>> {
        let [a, b] = self.tilt_axes();
        let tilts = self.tilts.and_then(|k| instrument.get(k..k + 2))?;
        Some(a * tilts[0] + b * tilts[1])
    }

    /// Unit normal and offset (m) with these values of the constants (8.6).
    pub fn at(&self, instrument: &[f64]) -> (Vector3<f64>, f64) {
        let normal = self.tilt(instrument).map_or(self.normal, |w| so3::exp(&w) * self.normal);
        let offset = self.shift.and_then(|k| instrument.get(k)).copied().unwrap_or(self.offset);
        (normal, offset)
    }

    /// The two tilts at which the normal is `normal` (unit length).
    pub fn tilts_of(&self, normal: &Vector3<f64>) -> [f64; 2] {
        let [a, b] = self.tilt_axes();
        let axis = self.normal.cross(normal);
        let size = axis.norm();
        let angle = size.atan2(self.normal.dot(normal));
        let w = if size > 0.0 { axis * (angle / size) } else { a * angle };
        [w.dot(&a), w.dot(&b)]
    }

    /// Appends the derivatives of `row`, `scale` times the height of `p`, by the constants.
    pub(super) fn derive(
        &self,
        row: usize,
        scale: f64,
        p: &Vector3<f64>,
        instrument: &[f64],
        out: &mut Evaluation,
    ) {
        if let (Some(first), Some(w)) = (self.tilts, self.tilt(instrument)) {
            let turn = so3::left_jacobian(&w);
            let (normal, _) = self.at(instrument);
            for (i, axis) in self.tilt_axes().iter().enumerate() {
                let value = scale * (turn * axis).cross(&normal).dot(p);
                out.by_constant.push(ConstantDerivative { row, constant: first + i, value });
            }
        }
        if let Some(constant) = self.shift {
            out.by_constant.push(ConstantDerivative { row, constant, value: -scale });
        }
    }
}

/// What an instrument makes of a distance (8.4): `reading = scale * distance + zero`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gauge {
    /// Reading at no distance as far as it is known, m.
    pub zero: f64,
    /// Scale as far as it is known.
    pub scale: f64,
    /// Index of the zero, where it is identified.
    pub zero_constant: Option<usize>,
    /// Index of the scale, where it is identified.
    pub scale_constant: Option<usize>,
}

impl Default for Gauge {
    fn default() -> Self {
        Self { zero: 0.0, scale: 1.0, zero_constant: None, scale_constant: None }
    }
}

impl Gauge {
    /// Zero (m) and scale with these values of the constants.
    pub fn at(&self, instrument: &[f64]) -> (f64, f64) {
        let value =
            |index: Option<usize>, known| index.and_then(|k| instrument.get(k)).copied().unwrap_or(known);
        (value(self.zero_constant, self.zero), value(self.scale_constant, self.scale))
    }

    /// Appends the derivatives of `row`, the reading over `sigma`, by the constants.
    pub(super) fn derive(&self, row: usize, distance: f64, sigma: f64, out: &mut Evaluation) {
        if let Some(constant) = self.zero_constant {
            out.by_constant.push(ConstantDerivative { row, constant, value: 1.0 / sigma });
        }
        if let Some(constant) = self.scale_constant {
            out.by_constant.push(ConstantDerivative { row, constant, value: distance / sigma });
        }
    }
}

/// Distance between two points and its gradient by the first; the gradient vanishes where they coincide.
pub(super) fn distance(a: &Vector3<f64>, b: &Vector3<f64>) -> (f64, Vector3<f64>) {
    let apart = a - b;
    let d = apart.norm();
    (d, if d > 0.0 { apart / d } else { Vector3::zeros() })
}

/// A covector at the tool point with its length part per machine size, per m.
pub(super) fn per_metre(covector: &[f64; 6], length: f64) -> [f64; 6] {
    let v = Vector6::from_column_slice(covector);
    [v[0], v[1], v[2], v[3] / length, v[4] / length, v[5] / length]
}
