//! Points drawn far out along their axes.

use super::Mechanism;
use nalgebra::Vector3;

/// A point counts as far out where it lies farther along its axis than this many times the machine's reach.
const FAR: f64 = 3.0;

/// A joint whose point lies far out along its axis.
#[derive(Clone, Debug, PartialEq)]
pub struct FarPoint {
    /// The joint, `limb.joint`.
    pub joint: String,
    /// How far it lies from the foot, m.
    pub out: f64,
    /// The foot of the perpendicular from the tool at home, {S}, m: the nearest point of the axis.
    pub foot: Vector3<f64>,
}

/// Joints with an axis whose points are drawn far from the machine, as at the common normal of nearly parallel axes.
///
/// Where along its axis a point lies changes no motion, but the deviation of the link that leads to it is stated there.
pub fn far_points(mechanism: &Mechanism) -> Vec<FarPoint> {
    let nominal = mechanism.nominal();
    let mut all = Vec::new();
    for (i, limb) in mechanism.limbs.iter().enumerate() {
        let frames = nominal.home_frames(i);
        let Some(tool) = frames.last().map(|frame| frame.p) else { continue };
        for (joint, frame) in limb.joints.iter().zip(&frames).filter(|(joint, _)| joint.motion.is_angular()) {
            let z = frame.r.column(2).into_owned();
            let foot = frame.p + z * z.dot(&(tool - frame.p));
            let name = format!("{}.{}", limb.name, joint.name);
            all.push((FarPoint { joint: name, out: (frame.p - foot).norm(), foot }, (foot - tool).norm()));
        }
    }
    // Axes that all meet the tool have no reach of their own; half of the points are near the machine all the same.
    let mut drawn: Vec<f64> = all.iter().map(|(far, reach)| far.out.hypot(*reach)).collect();
    drawn.sort_by(f64::total_cmp);
    let middle = drawn.get(drawn.len().saturating_sub(1) / 2).copied().unwrap_or(0.0);
    let reach = all.iter().map(|(_, reach)| *reach).fold(middle, f64::max);
    all.into_iter().map(|(far, _)| far).filter(|far| far.out > FAR * reach).collect()
}
