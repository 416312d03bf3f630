//! Rows of a table and their motions.

use crate::formats::xml::turn;
use crate::formats::{Axis, Chain};
use crate::lie::Se3;
use crate::model::Motion;
use nalgebra::{Matrix3, Vector3};

/// Which screw of a row comes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Convention {
    /// `Rz(theta) Tz(d) Tx(a) Rx(alpha)`: `a` and `alpha` lead to the next axis.
    Standard,
    /// `Rx(alpha) Tx(a) Rz(theta) Tz(d)`: `a` and `alpha` lead from the axis before.
    Modified,
}

/// What moves in a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RowKind {
    /// R: the reading adds to `theta`.
    Revolute,
    /// P: the reading adds to `d`.
    Prismatic,
    /// F: nothing.
    Fixed,
}

/// A row, rad and m.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Name of the joint.
    pub name: String,
    /// What moves.
    pub kind: RowKind,
    /// About z, rad.
    pub theta: f64,
    /// Along z, m.
    pub d: f64,
    /// Along x, m.
    pub a: f64,
    /// About x, rad.
    pub alpha: f64,
    /// Readings between which the joint is used, rad or m.
    pub range: Option<(f64, f64)>,
}

impl RowKind {
    /// Its letter in a table.
    pub fn letter(self) -> &'static str {
        match self {
            RowKind::Revolute => "R",
            RowKind::Prismatic => "P",
            RowKind::Fixed => "F",
        }
    }

    /// The row of a letter.
    pub fn of_letter(letter: &str) -> Option<Self> {
        [RowKind::Revolute, RowKind::Prismatic, RowKind::Fixed]
            .into_iter()
            .find(|kind| kind.letter().eq_ignore_ascii_case(letter))
    }

    pub(super) fn motion(self) -> Option<Motion> {
        match self {
            RowKind::Revolute => Some(Motion::Revolute),
            RowKind::Prismatic => Some(Motion::Prismatic),
            RowKind::Fixed => None,
        }
    }
}

impl Row {
    /// `Rz(theta) Tz(d)`
    fn about_z(&self) -> Se3 {
        Se3 { r: turn(2, self.theta), p: Vector3::new(0.0, 0.0, self.d) }
    }

    /// `Rx(alpha) Tx(a)`, in either order.
    fn about_x(&self) -> Se3 {
        Se3 { r: turn(0, self.alpha), p: Vector3::new(self.a, 0.0, 0.0) }
    }

    /// What comes before the joint's own motion, and behind it.
    fn halves(&self, convention: Convention) -> (Se3, Se3) {
        match convention {
            Convention::Standard => (Se3::identity(), self.about_z() * self.about_x()),
            Convention::Modified => (self.about_x(), self.about_z()),
        }
    }
}

/// The chain that the rows describe, from {S} = frame 0 to {T} = the frame behind the last row.
pub(super) fn chain(rows: &[Row], convention: Convention) -> Chain {
    let mut at = Se3 { r: Matrix3::identity(), p: Vector3::zeros() };
    let mut axes = Vec::new();
    for row in rows {
        let (before, behind) = row.halves(convention);
        at = at * before;
        if let Some(motion) = row.kind.motion() {
            axes.push(Axis { name: row.name.clone(), motion, frame: at, range: row.range });
        }
        at = at * behind;
    }
    Chain { axes, tool: at }
}
