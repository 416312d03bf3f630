//! Ways to a closed posture: from a measured pose, or from home along the actuators' path.

use super::closure::NotClosed;
use super::limb::Limb;
use super::mechanism::{Geometry, Mechanism, pose_difference};
use super::passive::PassiveSplit;
use super::posture::{LONGEST_STEP, Posture, scaled};
use crate::lie::{Columns, Se3};

const MAX_ITERATIONS: usize = 60;
/// Relative reduction of the gap below which inverse kinematics stops: it is a start for closure, no more.
const STALLED: f64 = 1e-3;
/// Shortest part of the way from home that continuation takes in one go.
const SHORTEST_STRIDE: f64 = 1.0 / 1024.0;

/// Passive joint variables (machine order) that bring each limb's tool closest to `pose`, actuators held.
///
/// Gauss-Newton per limb from `passive`, steps halved until the gap shrinks; distances in machine sizes.
pub fn passive_at_pose(
    mechanism: &Mechanism,
    geometry: &Geometry,
    actuators: &[f64],
    passive: &[f64],
    pose: &Se3,
) -> Vec<f64> {
    let length = mechanism.characteristic_length();
    let (mut actuator, mut joint) = (0, 0);
    let mut solved = passive.to_vec();
    for (limb, links) in mechanism.limbs.iter().zip(&geometry.limbs) {
        let m = limb.passive_count();
        let active = limb.joints.len() - m;
        let a = &actuators[actuator..actuator + active];
        limb_at_pose(limb, links, a, &mut solved[joint..joint + m], pose, length);
        actuator += active;
        joint += m;
    }
    solved
}

fn limb_at_pose(limb: &Limb, links: &[Se3], actuators: &[f64], theta: &mut [f64], pose: &Se3, length: f64) {
    let mut before = Vec::with_capacity(limb.joints.len());
    let place = |theta: &[f64], before: &mut Vec<Se3>| -> Se3 {
        let (mut a, mut p) = (actuators.iter(), theta.iter());
        let mut at = links[0];
        before.clear();
        for (joint, link) in limb.joints.iter().zip(&links[1..]) {
            let q = if joint.actuated { a.next() } else { p.next() };
            before.push(at);
            at = joint.motion.moved(&at, q.copied().unwrap_or(0.0)) * *link;
        }
        at
    };
    let gap = |at: &Se3| -> ([f64; 6], f64) {
        let (w, v) = pose_difference(pose, at);
        let gap = [w.x, w.y, w.z, v.x / length, v.y / length, v.z / length];
        (gap, gap.iter().map(|v| v * v).sum::<f64>().sqrt())
    };
    let mut split = PassiveSplit::rigid();
    let mut columns = Vec::with_capacity(6);
    let mut at = place(theta, &mut before);
    let (mut twist, mut size) = gap(&at);
    let mut trial = theta.to_vec();
    for _ in 0..MAX_ITERATIONS {
        columns.clear();
        for (joint, g) in limb.joints.iter().zip(&before).filter(|(joint, _)| !joint.actuated) {
            columns.push(scaled(joint.motion.tool_twist(&Columns::from(g), &at.p), length));
        }
        split.factor(&columns);
        let step = split.motions(&twist);
        let passive = limb.joints.iter().filter(|joint| !joint.actuated);
        let longest = passive.zip(&step).fold(0.0_f64, |m, (j, s)| m.max(j.motion.size_of(*s, length)));
        let mut fraction = LONGEST_STEP / longest.max(LONGEST_STEP);
        let shrunk = loop {
            for ((t, from), s) in trial.iter_mut().zip(theta.iter()).zip(&step) {
                *t = from + fraction * s;
            }
            let reached = place(&trial, &mut before);
            let (next, next_size) = gap(&reached);
            if next_size < size {
                let shrunk = size - next_size;
                theta.copy_from_slice(&trial);
                (at, twist, size) = (reached, next, next_size);
                break shrunk;
            }
            fraction *= 0.5;
            if fraction < 1e-3 {
                break 0.0;
            }
        };
        // The gap need not vanish, so its decrease is what tells the end.
        if shrunk <= STALLED * size || longest < STALLED {
            return;
        }
    }
}

/// Closes the posture by following the straight path of the actuators from home, in strides short enough
/// that the assembly mode of home is kept. `posture` must be closed at home.
pub fn close_from_home(
    mechanism: &Mechanism,
    geometry: &Geometry,
    posture: &mut Posture,
    actuators: &[f64],
) -> Result<(), NotClosed> {
    let mode = posture.mode;
    let mut reached = 0.0;
    let mut stride = 1.0;
    let mut passive = posture.passive(mechanism);
    let mut iterations = 0;
    while reached < 1.0 {
        let to = if reached + stride > 1.0 - 1e-9 { 1.0 } else { reached + stride };
        let at: Vec<f64> = actuators.iter().map(|a| a * to).collect();
        posture.set_joints(mechanism, &at, &passive);
        let closed = posture.close(mechanism, geometry);
        iterations += posture.iterations;
        match closed {
            Ok(()) if posture.mode == mode && near(&passive, &posture.passive(mechanism)) => {
                passive = posture.passive(mechanism);
                reached = to;
                stride *= 2.0;
            }
            outcome if stride <= SHORTEST_STRIDE => {
                return Err(match outcome {
                    Err(why) => why,
                    Ok(()) => NotClosed::OtherMode,
                });
            }
            _ => stride *= 0.5,
        }
    }
    posture.iterations = iterations;
    Ok(())
}

/// Whether one stride moved no passive joint so far that it may have changed branch, rad or m.
fn near(from: &[f64], to: &[f64]) -> bool {
    from.iter().zip(to).all(|(a, b)| (a - b).abs() < 0.5)
}
