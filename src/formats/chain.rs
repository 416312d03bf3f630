//! A serial chain as foreign formats know one: axes in {S} with all readings at zero, then the tool.

use super::error::Wrong;
use crate::files::values::{OneOrEach, RangeDrawing, RangeEntry};
use crate::files::{JointDrawing, LimbDrawing, MechanismDrawing, PoseDrawing, Units};
use crate::lie::Se3;
use crate::model::joint::frame_on_axis;
use crate::model::{Mechanism, Motion};
use nalgebra::Vector3;

/// A driven joint of the chain.
#[derive(Clone, Debug)]
pub struct Axis {
    /// Its name.
    pub name: String,
    /// Revolute or prismatic.
    pub motion: Motion,
    /// Its frame in {S} with all readings at zero, z along the axis, rad and m.
    pub frame: Se3,
    /// Readings between which it is used, rad or m.
    pub range: Option<(f64, f64)>,
}

/// A serial chain.
#[derive(Clone, Debug)]
pub struct Chain {
    /// From base to tool.
    pub axes: Vec<Axis>,
    /// Pose of the tool in {S} with all readings at zero, rad and m.
    pub tool: Se3,
}

impl Axis {
    /// An axis through `point` along `direction` (not zero), m.
    pub fn new(name: String, motion: Motion, point: Vector3<f64>, direction: &Vector3<f64>) -> Self {
        Self { name, motion, frame: frame_on_axis(point, direction), range: None }
    }

    /// Direction of the axis.
    pub fn direction(&self) -> Vector3<f64> {
        self.frame.r.column(2).into_owned()
    }

    /// The joint as a problem file draws it.
    pub fn draw(&self, units: Units) -> JointDrawing {
        let reading = |value| RangeEntry::Limit(units.from_joint(self.motion, value));
        JointDrawing {
            name: Some(self.name.clone()),
            kind: if self.motion.is_angular() { "revolute" } else { "prismatic" }.to_owned(),
            point: self.frame.p.map(|v| units.from_metres(v)).into(),
            axis: Some(self.direction().into()),
            actuated: Some(OneOrEach::One(true)),
            range: self.range.map(|(low, high)| RangeDrawing(vec![reading(low), reading(high)])),
            ..JointDrawing::default()
        }
    }
}

/// A point is slid along its axis where it lies farther from the machine than this many sizes of the machine.
const FAR: f64 = 3.0;

impl Chain {
    /// The same chain with points that lie far out slid along their axes to the foot of the perpendicular from the point
    /// before, and words about each.
    ///
    /// Where axes are nearly parallel, a Denavit-Hartenberg table puts its frames at their common normal, hundreds of
    /// metres away. No motion depends on where along its axis a point lies, but a link's deviation is stated there: a
    /// tolerance of angle would move the machine by as much as the lever is long.
    pub fn gathered(mut self, units: Units) -> (Self, Vec<String>) {
        let mut from = Vector3::zeros();
        let feet: Vec<Vector3<f64>> = (self.axes.iter())
            .map(|axis| {
                let z = axis.direction();
                from = axis.frame.p + z * z.dot(&(from - axis.frame.p));
                from
            })
            .collect();
        let reach = feet.iter().chain([&self.tool.p]).map(|p| p.norm()).fold(0.0, f64::max);
        let mut notes = Vec::new();
        for (axis, foot) in self.axes.iter_mut().zip(feet) {
            let slid = (axis.frame.p - foot).norm();
            if slid > FAR * reach {
                axis.frame.p = foot;
                notes.push(format!(
                    "the point of {} lay {:.4} {} out along its axis, nearly parallel to its neighbour; it is drawn at the \
                     foot of the perpendicular from the axis before, which changes no motion",
                    axis.name,
                    units.from_metres(slid),
                    units.length_symbol(),
                ));
            }
        }
        (self, notes)
    }

    /// The chain of a machine of one limb, for a format of this name, which has neither loops nor screws.
    pub fn of(mechanism: &Mechanism, format: &'static str) -> Result<Self, Wrong> {
        let not_serial = |found| Wrong::NotSerial { format, found };
        let [limb] = mechanism.limbs.as_slice() else {
            return Err(not_serial(format!("{} limbs", mechanism.limbs.len())));
        };
        if let Some(passive) = limb.joints.iter().find(|joint| !joint.actuated) {
            return Err(not_serial(format!("the passive joint {}", passive.name)));
        }
        let mut at = Se3::identity();
        let mut links = limb.links.iter();
        let mut axes = Vec::with_capacity(limb.joints.len());
        for (joint, link) in limb.joints.iter().zip(links.by_ref()) {
            if matches!(joint.motion, Motion::Helical { .. }) {
                return Err(Wrong::Helical { format, joint: joint.name.clone() });
            }
            at = at * link.nominal;
            axes.push(Axis { name: joint.name.clone(), motion: joint.motion, frame: at, range: joint.range });
            // The drawing is at home, where the joint reads `home`.
            at = joint.motion.moved(&at, -joint.home);
        }
        let tool = links.next().map_or(at, |link| at * link.nominal);
        Ok(Self { axes, tool })
    }

    /// Pose of the tool at these readings, rad and m.
    pub fn pose(&self, readings: &[f64]) -> Se3 {
        let pairs = self.axes.iter().zip(readings).rev();
        pairs.fold(self.tool, |tool, (axis, q)| {
            axis.motion.moved(&axis.frame, *q) * axis.frame.inverse() * tool
        })
    }

    /// The chain as a problem file draws it: one limb, at home where all readings are zero.
    pub fn draw(&self, limb: &str, units: Units) -> MechanismDrawing {
        MechanismDrawing {
            tool: Some(PoseDrawing::of(&self.tool, units)),
            limbs: vec![LimbDrawing {
                name: Some(limb.to_owned()),
                joints: self.axes.iter().map(|axis| axis.draw(units)).collect(),
                ..LimbDrawing::default()
            }],
            ..MechanismDrawing::default()
        }
    }
}
