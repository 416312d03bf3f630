//! How far the drawing is from a measured posture, for data that may be wrong by orders of magnitude.
//!
//! Loops that do not close have no predicted pose. So every limb is brought to the measured pose by itself: its
//! passive joints move until its tool is as near as the actuators' readings let it come, and what is left counts.

use super::reading::Reading;
use crate::identify::registration::FreeEnds;
use crate::measure::Point;
use crate::model::inverse::passive_at_pose;
use crate::model::mechanism::pose_difference;
use crate::model::{Mechanism, Posture, Prior};
use crate::simulate::{close, draw_deviations, draw_postures};
use crate::statistics::median;
use nalgebra::Matrix6;

/// Machines drawn from the tolerances.
const MACHINES: u64 = 24;
/// Postures of each.
const POSTURES: usize = 5;
/// The worst of a few machines is not the worst of all.
const MARGIN: f64 = 1.3;

/// Distance between the drawing and each measured posture, m; rotations count with the size of the machine.
/// Infinite where a position alone is measured and the posture does not close.
pub fn misfits(mechanism: &Mechanism, data: &[Reading]) -> Vec<f64> {
    let geometry = mechanism.nominal();
    let mut posture = Posture::new(mechanism);
    let passive: usize = mechanism.limbs.iter().map(|limb| limb.passive_count()).sum();
    let home = vec![0.0; passive];
    data.iter()
        .map(|reading| {
            let variables = reading.variables(mechanism);
            let Some(pose) = reading.pose() else {
                return close(mechanism, &geometry, &variables).map_or(f64::INFINITY, |posture| {
                    let (tool, offset) = (posture.tool(), reading.target.at(&geometry.instrument));
                    (tool.p + tool.r * offset - reading.position).norm()
                });
            };
            let solved = passive_at_pose(mechanism, &geometry, &variables, &home, &pose);
            posture.set_joints(mechanism, &variables, &solved);
            posture.open(mechanism, &geometry);
            let mut last = 0;
            let mut square = 0.0;
            for limb in &mechanism.limbs {
                last += limb.links.len();
                let (w, v) = pose_difference(&posture.frames[last - 1].into(), &pose);
                square += v.norm_squared() + (w * posture.length()).norm_squared();
            }
            let size = (square / mechanism.limbs.len() as f64).sqrt();
            if size.is_finite() { size } else { f64::INFINITY }
        })
        .collect()
}

/// Whether links are free that are no end of the whole machine: registration does not place these, and they explain
/// whatever misfit they make.
pub fn has_free_links(mechanism: &Mechanism) -> bool {
    let ends = FreeEnds::of(mechanism);
    mechanism.limbs.iter().any(|limb| {
        let last = limb.links.len().saturating_sub(1);
        limb.links.iter().enumerate().any(|(k, link)| {
            let placed = k == 0 && ends.base || k == last && ends.tool;
            !placed && (link.tolerance.angle == Prior::Free || link.tolerance.length == Prior::Free)
        })
    })
}

/// Misfits that tolerances and noise explain, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// Of the median posture.
    pub median: f64,
    /// Of any posture.
    pub single: f64,
}

/// The largest misfits that machines within the tolerances show, with measurements of this noise (rotation first, rad
/// and m).
///
/// By simulation at random postures in the actuators' ranges, at home where too few of them close.
pub fn expected(mechanism: &Mechanism, noise: Option<&Matrix6<f64>>, position_only: bool) -> Expected {
    let nominal = mechanism.nominal();
    let (mut typical, mut largest) = (0.0_f64, 0.0_f64);
    for seed in 0..MACHINES {
        let truth = mechanism.deviated(&draw_deviations(mechanism, seed, 1.0));
        let home = vec![vec![0.0; mechanism.actuator_count()]];
        let postures = draw_postures(mechanism, &[&nominal, &truth], POSTURES, seed).unwrap_or(home);
        let joints = || mechanism.limbs.iter().flat_map(|limb| &limb.joints).filter(|joint| joint.actuated);
        let seen: Vec<Reading> = postures
            .iter()
            .filter_map(|variables| {
                let pose = close(mechanism, &truth, variables).ok()?.tool();
                Some(Reading {
                    name: String::new(),
                    actuators: variables.iter().zip(joints()).map(|(q, joint)| q + joint.home).collect(),
                    position: pose.p,
                    rotation: (!position_only).then_some(pose.r),
                    vector: None,
                    quaternion: false,
                    target: Point::default(),
                    noise: Box::new(Matrix6::identity()),
                })
            })
            .collect();
        let found: Vec<f64> = misfits(mechanism, &seen).into_iter().filter(|m| m.is_finite()).collect();
        typical = median(found.iter().copied()).map_or(typical, |median| typical.max(median));
        largest = found.into_iter().fold(largest, f64::max);
    }
    let length = mechanism.characteristic_length();
    let noise = noise.map_or(0.0, |c| {
        let rotation: f64 = if position_only { 0.0 } else { (0..3).map(|i| c[(i, i)]).sum() };
        let position: f64 = (3..6).map(|i| c[(i, i)]).sum();
        (position + rotation * length * length).sqrt()
    });
    let with_noise = |misfit: f64| (MARGIN * misfit).hypot(3.0 * noise);
    Expected { median: with_noise(typical), single: with_noise(largest) }
}
