//! From a mechanism, as identified or as drawn, to a drawing that every reader takes.

use super::drawing::{JointDrawing, LimbDrawing, MechanismDrawing};
use super::pose::PoseDrawing;
use super::tolerance::{BoundsDrawing, ToleranceDrawing};
use super::units::Units;
use super::values::{OneOrEach, RangeDrawing, RangeEntry};
use crate::lie::Se3;
use crate::model::{Geometry, Joint, Limb, Link, Mechanism, Motion, Prior};
use std::f64::consts::TAU;

/// Draws the machine with the links of `geometry`: equivalent joints as lines in {S} at home, each limb with
/// the tool pose that it has there, tolerances and bounds as `mechanism` has them.
///
/// A line leaves the turn of a joint's frame about its axis and the frame's place along it open; neither
/// changes a pose, because both commute with the joint's motion and the next link undoes them.
pub fn redraw(mechanism: &Mechanism, geometry: &Geometry, units: Units) -> MechanismDrawing {
    let mut limbs = Vec::with_capacity(mechanism.limbs.len());
    for (limb, links) in mechanism.limbs.iter().zip(&geometry.limbs) {
        let mut at = Se3::identity();
        let mut joints = Vec::with_capacity(limb.joints.len());
        let mut home = links.iter().zip(&limb.links);
        for (joint, (g, link)) in limb.joints.iter().zip(home.by_ref()) {
            at = at * *g;
            joints.push(joint_drawing(joint, &at, link, units));
        }
        let last = home.next();
        limbs.push(LimbDrawing {
            name: Some(limb.name.clone()),
            tool: last.map(|(g, _)| PoseDrawing::of(&(at * *g), units)),
            tolerance: None,
            tool_tolerance: last.map(|(_, link)| ToleranceDrawing::of(&link.tolerance, units)),
            bounds: held_bounds(limb, units),
            tool_bounds: last.filter(|(_, link)| !is_held(link)).and_then(|(_, link)| bounds_of(link, units)),
            joints,
        });
    }
    MechanismDrawing {
        tool: limbs.first().and_then(|limb| limb.tool.clone()),
        placement: mechanism.ends.placement.map(|t| ToleranceDrawing::of(&t, units)),
        tool_mounting: mechanism.ends.tool_mounting.map(|t| ToleranceDrawing::of(&t, units)),
        limbs,
        ..MechanismDrawing::default()
    }
}

/// Bounds of held links, which only a general statement can give; left out where it would limit others that have none.
fn held_bounds(limb: &Limb, units: Units) -> Option<BoundsDrawing> {
    let harmless = limb.links.iter().all(|link| is_held(link) || link.bounds.is_some());
    let mut held = limb.links.iter().filter(|link| harmless && is_held(link));
    held.find_map(|link| bounds_of(link, units))
}

fn is_held(link: &Link) -> bool {
    link.tolerance.angle == Prior::Held && link.tolerance.length == Prior::Held
}

fn bounds_of(link: &Link, units: Units) -> Option<BoundsDrawing> {
    link.bounds.map(|bounds| BoundsDrawing::of(bounds, units))
}

fn joint_drawing(joint: &Joint, frame: &Se3, link: &Link, units: Units) -> JointDrawing {
    let (kind, pitch) = match joint.motion {
        Motion::Revolute => ("revolute", None),
        Motion::Prismatic => ("prismatic", None),
        Motion::Helical { advance } => ("helical", Some(units.from_metres(advance * TAU))),
    };
    let reading = |value| units.from_joint(joint.motion, value);
    let axis = frame.r.column(2);
    JointDrawing {
        name: Some(joint.name.clone()),
        kind: kind.to_owned(),
        point: [frame.p.x, frame.p.y, frame.p.z].map(|v| units.from_metres(v)),
        axis: Some([axis[0], axis[1], axis[2]]),
        axes: None,
        pitch,
        actuated: joint.actuated.then_some(OneOrEach::One(true)),
        home: (joint.home != 0.0).then(|| OneOrEach::One(reading(joint.home))),
        range: joint.range.map(|(low, high)| {
            RangeDrawing(vec![RangeEntry::Limit(reading(low)), RangeEntry::Limit(reading(high))])
        }),
        tolerance: Some(ToleranceDrawing::of(&link.tolerance, units)),
        inner_tolerance: None,
        bounds: bounds_of(link, units).filter(|_| !is_held(link)),
        inner_bounds: None,
    }
}

impl MechanismDrawing {
    /// The same machine without tolerances and bounds, as a truth or a measured machine is stated.
    pub fn without_priors(mut self) -> Self {
        (self.tolerance, self.tool_tolerance, self.bounds, self.tool_bounds) = (None, None, None, None);
        (self.placement, self.tool_mounting) = (None, None);
        for limb in &mut self.limbs {
            (limb.tolerance, limb.tool_tolerance, limb.bounds, limb.tool_bounds) = (None, None, None, None);
            for joint in &mut limb.joints {
                (joint.tolerance, joint.inner_tolerance) = (None, None);
                (joint.bounds, joint.inner_bounds) = (None, None);
            }
        }
        self
    }
}
