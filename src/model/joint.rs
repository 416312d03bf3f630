//! Equivalent one-degree-of-freedom joints, and the joint types that expand to them.

use crate::lie::{Columns, Se3};
use nalgebra::{Matrix3, Vector3};

/// Motion of a joint along the z axis of its frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// Rotation, rad.
    Revolute,
    /// Translation, m.
    Prismatic,
    /// Rotation, rad, that advances along its axis.
    Helical {
        /// Advance, m per rad.
        advance: f64,
    },
}

impl Motion {
    /// Whether the joint variable is an angle.
    pub fn is_angular(self) -> bool {
        !matches!(self, Motion::Prismatic)
    }

    /// Size of a step of the joint variable, rad or, of a length, parts of the machine's size `length` (m).
    pub fn size_of(self, step: f64, length: f64) -> f64 {
        step.abs() / if self.is_angular() { 1.0 } else { length }
    }

    /// `g exp(z q)`: the frame moved by the joint variable `q`, rad or m.
    pub fn moved(self, g: &Se3, q: f64) -> Se3 {
        let turn = if self.is_angular() { q.sin_cos() } else { (0.0, 1.0) };
        self.moved_by(&Columns::from(g), q, turn).into()
    }

    /// The same with sine and cosine of an angular joint variable at hand.
    #[inline(always)]
    pub fn moved_by(self, Columns([x, y, z, p]): &Columns, q: f64, (sin, cos): (f64, f64)) -> Columns {
        let slide = match self {
            Motion::Prismatic => q,
            Motion::Revolute => 0.0,
            Motion::Helical { advance } => advance * q,
        };
        let p = std::array::from_fn(|i| p[i] + z[i] * slide);
        match self.is_angular() {
            true => Columns([Columns::combined(x, cos, y, sin), Columns::combined(y, cos, x, -sin), *z, p]),
            false => Columns([*x, *y, *z, p]),
        }
    }

    /// Twist of the tool point `[w; dp]` per unit of the joint variable, for the joint frame `g` and the
    /// tool point `tool` in {S}.
    #[inline(always)]
    pub fn tool_twist(self, g: &Columns, tool: &Vector3<f64>) -> [f64; 6] {
        let axis = g.z();
        let (w, v) = match self {
            Motion::Prismatic => (Vector3::zeros(), axis),
            Motion::Revolute => (axis, axis.cross(&(tool - g.p()))),
            Motion::Helical { advance } => (axis, axis.cross(&(tool - g.p())) + axis * advance),
        };
        [w.x, w.y, w.z, v.x, v.y, v.z]
    }
}

/// One equivalent joint of a limb.
#[derive(Clone, Debug)]
pub struct Joint {
    /// Name within its limb, such as `ball.2`, or `leg` for a joint of one degree of freedom.
    pub name: String,
    /// How it moves.
    pub motion: Motion,
    /// Its frame at home in {S}: origin at the drawn point, z along the axis.
    pub frame: Se3,
    /// Commanded or sensed.
    pub actuated: bool,
    /// Not actuated, but read by a sensor of its own: its zero is then no matter of choice.
    pub sensed: bool,
    /// Actuator reading at home, rad or m; the joint variable is reading - home.
    pub home: f64,
    /// Readings between which the joint is used, rad or m, where the drawing states them.
    pub range: Option<(f64, f64)>,
}

/// A joint type of the problem file: which equivalent joints it stands for.
///
/// A new type is one more row of [`KINDS`]; nothing else knows the list.
#[derive(Debug)]
pub struct Kind {
    /// Its name in the problem file.
    pub name: &'static str,
    /// How many axes a drawing gives.
    pub axes: usize,
    /// Each equivalent joint in chain order: its motion and which of the axes it uses. The advance of a
    /// helical joint comes from the drawing.
    pub motions: &'static [(Motion, usize)],
}

impl Kind {
    /// Whether the drawing must give a pitch.
    pub fn has_pitch(&self) -> bool {
        self.motions.iter().any(|(motion, _)| matches!(motion, Motion::Helical { .. }))
    }
}

/// Every joint type there is.
pub const KINDS: &[Kind] = &[
    Kind { name: "revolute", axes: 1, motions: &[(Motion::Revolute, 0)] },
    Kind { name: "prismatic", axes: 1, motions: &[(Motion::Prismatic, 0)] },
    Kind { name: "helical", axes: 1, motions: &[(Motion::Helical { advance: 0.0 }, 0)] },
    Kind { name: "cylindrical", axes: 1, motions: &[(Motion::Revolute, 0), (Motion::Prismatic, 0)] },
    Kind { name: "universal", axes: 2, motions: &[(Motion::Revolute, 0), (Motion::Revolute, 1)] },
    Kind {
        name: "spherical",
        axes: 3,
        motions: &[(Motion::Revolute, 0), (Motion::Revolute, 1), (Motion::Revolute, 2)],
    },
    Kind {
        name: "planar",
        axes: 3,
        motions: &[(Motion::Prismatic, 0), (Motion::Prismatic, 1), (Motion::Revolute, 2)],
    },
];

/// Right-handed frame at `point` with z along `axis` (not zero), the other two axes chosen by the smallest
/// component of `axis`, which no result depends on.
pub fn frame_on_axis(point: Vector3<f64>, axis: &Vector3<f64>) -> Se3 {
    let z = axis.normalize();
    let mut seed = Vector3::zeros();
    seed[z.iamin()] = 1.0;
    let x = seed.cross(&z).normalize();
    Se3 { r: Matrix3::from_columns(&[x, z.cross(&x), z]), p: point }
}
