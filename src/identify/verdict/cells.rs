//! Kinds of residuals: what was read, in which set, along which axis.

use crate::calibration::Sample;
use crate::measure::{Evaluation, View};
use nalgebra::Matrix3;

/// Most rounds of a decomposition: without a limit one of numbers that are not finite never ends.
const ROUNDS: usize = 1000;

/// Part of a row's largest entry up to which the others do not count: the row stands for one axis.
const ALONG: f64 = 0.1;

/// What a residual is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Quantity {
    /// Rotation of a pose.
    Rotation,
    /// Position of the tool point or of a target.
    Position,
    /// Distance from a fixed point.
    Distance,
    /// Distance between the places of one target in two postures.
    Separation,
    /// Height above a plane.
    Height,
    /// Angle of a sensed joint.
    JointAngle,
    /// Length of a sensed joint.
    JointLength,
}

impl Quantity {
    /// Whether it is an angle; else it is a length.
    pub fn is_angular(self) -> bool {
        matches!(self, Quantity::Rotation | Quantity::JointAngle)
    }

    /// In the plural.
    pub fn name(self) -> &'static str {
        match self {
            Quantity::Rotation => "rotations",
            Quantity::Position => "positions",
            Quantity::Distance => "distances",
            Quantity::Separation => "separations",
            Quantity::Height => "heights",
            Quantity::JointAngle => "joint angles",
            Quantity::JointLength => "joint lengths",
        }
    }
}

/// An axis along which components were read, or the sensor that read them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Axis {
    /// x, y or z of {S}.
    Frame(usize),
    /// Principal axis of the stated noise, the least noisy first.
    Principal(usize),
    /// A sensor of a joint, in the order in which they are read.
    Sensor(usize),
}

/// Residuals that share set, quantity and axis: the smallest group that is tested.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Cell {
    /// Set of the data, from 0.
    pub set: usize,
    /// What was read.
    pub quantity: Quantity,
    /// Along which axis, where there is one.
    pub axis: Option<Axis>,
}

/// Three neighbouring rows and the rotation that leads from them to the principal axes of their noise.
pub(super) type Principal = (usize, Matrix3<f64>);

/// Quantity and axis of each row of a sample that was evaluated, and the rows that are turned to principal axes.
pub(super) fn kinds(
    sample: &Sample,
    view: &View<'_>,
    evaluation: &Evaluation,
) -> (Vec<(Quantity, Option<Axis>)>, Vec<Principal>) {
    let measurement = sample.measurement.as_ref();
    let errors = measurement.error(view);
    let count = evaluation.rows.len();
    let plain = |quantity: Quantity| (vec![(quantity, None); count], Vec::new());
    if errors.joint_angle.is_some() || errors.joint_length.is_some() {
        let of = |row| if measurement.is_angle(row) { Quantity::JointAngle } else { Quantity::JointLength };
        return ((0..count).map(|row| (of(row), Some(Axis::Sensor(row)))).collect(), Vec::new());
    }
    if errors.distance.is_some() {
        let two = measurement.second().is_some();
        return plain(if two { Quantity::Separation } else { Quantity::Distance });
    }
    if errors.plane.is_some() {
        return plain(Quantity::Height);
    }
    let moves = |row: usize| evaluation.rows[row].by_tool[3..].iter().any(|v| *v != 0.0);
    let (mut found, mut turned) = (Vec::with_capacity(count), Vec::new());
    for quantity in [Quantity::Rotation, Quantity::Position] {
        let is_position = quantity == Quantity::Position;
        let own: Vec<usize> = (0..count).filter(|&row| moves(row) == is_position).collect();
        let part = |row: usize| -> [f64; 3] {
            let by = &evaluation.rows[row].by_tool;
            if is_position { [by[3], by[4], by[5]] } else { [by[0], by[1], by[2]] }
        };
        let axes: Option<Vec<usize>> = own.iter().map(|&row| along(part(row))).collect();
        match (axes, own.as_slice()) {
            (Some(axes), _) => {
                found.extend(
                    own.iter().zip(axes).map(|(&row, axis)| (row, quantity, Some(Axis::Frame(axis)))),
                );
            }
            (None, &[first, _, last]) if last == first + 2 => {
                let rows = Matrix3::from_fn(|i, j| part(first + i)[j]);
                // Noise is least where the rows are largest: singular values descend.
                match rows.try_svd(true, false, 5.0 * f64::EPSILON, ROUNDS).and_then(|svd| svd.u) {
                    Some(u) => {
                        turned.push((first, u.transpose()));
                        found.extend((0..3).map(|i| (first + i, quantity, Some(Axis::Principal(i)))));
                    }
                    None => found.extend(own.iter().map(|&row| (row, quantity, None))),
                }
            }
            (None, _) => found.extend(own.iter().map(|&row| (row, quantity, None))),
        }
    }
    found.sort_by_key(|(row, ..)| *row);
    (found.into_iter().map(|(_, quantity, axis)| (quantity, axis)).collect(), turned)
}

/// The one axis that a row answers to.
fn along(row: [f64; 3]) -> Option<usize> {
    let axis = (0..3).max_by(|a, b| row[*a].abs().total_cmp(&row[*b].abs()))?;
    (0..3).all(|i| i == axis || row[i].abs() <= ALONG * row[axis].abs()).then_some(axis)
}
