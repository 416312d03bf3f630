//! Ways to a closed posture: from a measured pose, or from home along the actuators' path.

use super::closure::NotClosed;
use super::joint::Motion;
use super::limb::Limb;
use super::mechanism::{Geometry, Mechanism, pose_difference};
use super::passive::PassiveSplit;
use super::posture::{LONGEST_STEP, Posture, scaled};
use crate::lie::{Columns, Se3};
use std::f64::consts::PI;

const MAX_ITERATIONS: usize = 60;
/// Relative reduction of the gap below which inverse kinematics stops: it is a start for closure, no more.
const STALLED: f64 = 1e-3;
/// Shortest part of the way from home that continuation takes in one go.
const SHORTEST_STRIDE: f64 = 1.0 / 1024.0;
/// Longest motion of a passive joint in one go, rad or machine sizes: a longer one may have changed branch.
pub const NEAR: f64 = 0.5;

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
    each_limb_at_pose(mechanism, geometry, actuators, passive, pose, limb_at_pose)
}

/// The same, each limb on the branch that comes closest: three revolute joints in a row, such as a drawn ball joint, point
/// the same way when they are turned over, and reach other points as soon as their axes do not quite meet.
pub fn passive_turned_over(
    mechanism: &Mechanism,
    geometry: &Geometry,
    actuators: &[f64],
    passive: &[f64],
    pose: &Se3,
) -> Vec<f64> {
    each_limb_at_pose(mechanism, geometry, actuators, passive, pose, |limb, links, actuators, theta, aim| {
        let from = theta.to_vec();
        let mut least = limb_at_pose(limb, links, actuators, theta, aim);
        let revolute: Vec<bool> = limb
            .joints
            .iter()
            .filter(|joint| !joint.actuated)
            .map(|joint| joint.motion == Motion::Revolute)
            .collect();
        for first in 0..revolute.len().saturating_sub(2) {
            if !revolute[first..first + 3].iter().all(|revolute| *revolute) {
                continue;
            }
            let mut over = from.clone();
            (over[first], over[first + 1], over[first + 2]) =
                (from[first] + PI, -from[first + 1], from[first + 2] - PI);
            let gap = limb_at_pose(limb, links, actuators, &mut over, aim);
            if gap < 0.5 * least {
                least = gap;
                theta.copy_from_slice(&over);
            }
        }
        least
    })
}

/// A measured pose, and the size of the machine by which its distances are divided, m.
type Aim<'a> = (&'a Se3, f64);

/// `solve` on the passive joints of every limb, from `passive`.
fn each_limb_at_pose(
    mechanism: &Mechanism,
    geometry: &Geometry,
    actuators: &[f64],
    passive: &[f64],
    pose: &Se3,
    solve: impl Fn(&Limb, &[Se3], &[f64], &mut [f64], Aim<'_>) -> f64,
) -> Vec<f64> {
    let aim = (pose, mechanism.characteristic_length());
    let (mut actuator, mut joint) = (0, 0);
    let mut solved = passive.to_vec();
    for (limb, links) in mechanism.limbs.iter().zip(&geometry.limbs) {
        let m = limb.passive_count();
        let active = limb.joints.len() - m;
        let a = &actuators[actuator..actuator + active];
        solve(limb, links, a, &mut solved[joint..joint + m], aim);
        actuator += active;
        joint += m;
    }
    solved
}

/// The gap that is left, rad and machine sizes.
fn limb_at_pose(
    limb: &Limb,
    links: &[Se3],
    actuators: &[f64],
    theta: &mut [f64],
    (pose, length): Aim<'_>,
) -> f64 {
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
            break;
        }
    }
    size
}

/// Closes the posture by following the straight path of the actuators from home, in strides short enough
/// that the branch of home is kept. `posture` must be closed at home.
pub fn close_from_home(
    mechanism: &Mechanism,
    geometry: &Geometry,
    posture: &mut Posture,
    actuators: &[f64],
) -> Result<(), NotClosed> {
    close_along(mechanism, geometry, posture, actuators)
}

/// Closes the posture by following the straight path of the actuators from where it is closed, in strides short enough
/// that its branch is kept. Where the path ends early, the joint variables are those of the last stride.
pub fn close_along(
    mechanism: &Mechanism,
    geometry: &Geometry,
    posture: &mut Posture,
    actuators: &[f64],
) -> Result<(), NotClosed> {
    let from = posture.actuators(mechanism);
    let mut reached = 0.0;
    let mut stride = 1.0;
    let mut last = posture.clone();
    let mut iterations = 0;
    while reached < 1.0 {
        let to = if reached + stride > 1.0 - 1e-9 { 1.0 } else { reached + stride };
        let between = |(from, a): (&f64, &f64)| if to == 1.0 { *a } else { from + (a - from) * to };
        let at: Vec<f64> = from.iter().zip(actuators).map(between).collect();
        posture.set_joints(mechanism, &at, &last.passive(mechanism));
        let start = posture.q.clone();
        let closed = posture.close(mechanism, geometry);
        iterations += posture.iterations;
        match closed {
            Ok(()) if posture.is_on_branch_of(&last) && posture.moved_from(mechanism, &start) < NEAR => {
                last.clone_from(posture);
                reached = to;
                stride *= 2.0;
            }
            outcome if stride <= SHORTEST_STRIDE => {
                posture.q.copy_from_slice(&last.q);
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

/// Closes the posture at these actuator variables (rad, m) on the branch of home.
pub fn close_by_path(
    mechanism: &Mechanism,
    geometry: &Geometry,
    actuators: &[f64],
    posture: &mut Posture,
) -> Result<(), NotClosed> {
    posture.q.fill(0.0);
    posture.close(mechanism, geometry)?;
    close_along(mechanism, geometry, posture, actuators)
}

/// Closes the posture at these actuator variables (rad, m) from the passive joints that inverse kinematics of `pose`
/// finds from those in `passive`.
///
/// It counts only if closing keeps the branch of these joints and moves none of them far: else the limbs did not reach
/// the pose, and where they meet says nothing of it.
pub fn close_at_pose(
    mechanism: &Mechanism,
    geometry: &Geometry,
    actuators: &[f64],
    passive: &[f64],
    pose: &Se3,
    posture: &mut Posture,
) -> Result<(), NotClosed> {
    let solved = passive_at_pose(mechanism, geometry, actuators, passive, pose);
    close_as_solved(mechanism, geometry, (actuators, &solved), posture)
}

/// Closes the posture at these actuator variables (rad, m) from passive joints that inverse kinematics found; it counts
/// only where these are kept.
pub fn close_as_solved(
    mechanism: &Mechanism,
    geometry: &Geometry,
    (actuators, passive): (&[f64], &[f64]),
    posture: &mut Posture,
) -> Result<(), NotClosed> {
    posture.set_joints(mechanism, actuators, passive);
    let start = posture.q.clone();
    let mode = posture.assembly_mode(mechanism, geometry);
    posture.close(mechanism, geometry)?;
    if posture.mode == mode && posture.moved_from(mechanism, &start) < NEAR {
        Ok(())
    } else {
        Err(NotClosed::OtherMode)
    }
}
