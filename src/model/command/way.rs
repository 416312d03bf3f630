//! The way to a pose: Newton's method along the straight line to it, loops closed at every step.

use super::velocity::Velocity;
use super::{Found, NO_MOTION, error_to};
use crate::lie::{Se3, so3};
use crate::model::mechanism::{Geometry, Mechanism, pose_difference};
use crate::model::posture::{ITERATIONS, LONGEST_STEP, Posture};
use nalgebra::DVector;

/// Error at which nothing is left to gain.
const EXACT: f64 = 1e-14;
const MAX_ITERATIONS: usize = 60;
/// Relative decrease below which a point on the way counts as reached as well as may be.
const STALLED: f64 = 1e-3;
/// Shortest part of the way to the pose that is taken in one go.
const SHORTEST_STRIDE: f64 = 1.0 / 1024.0;
/// Longest motion of a joint in one stride, rad or m: a longer one may have changed branch.
const NEAR: f64 = 0.5;

/// Follows the straight way from the posture's pose to `pose`, in strides short enough that no branch is changed.
pub(super) fn along(
    mechanism: &Mechanism,
    geometry: &Geometry,
    mut posture: Posture,
    pose: &Se3,
    followed: [bool; 6],
) -> Found {
    let from = posture.tool();
    let (w, dp) = pose_difference(pose, &from);
    let (mut reached, mut stride) = (0.0, 1.0_f64);
    loop {
        let to = if reached + stride > 1.0 - 1e-9 { 1.0 } else { reached + stride };
        let target = match to {
            1.0 => *pose,
            _ => Se3 { r: so3::exp(&(w * to)) * from.r, p: from.p + dp * to },
        };
        let mut trial = posture.clone();
        let stalled = if to == 1.0 { 0.0 } else { STALLED };
        let left = approach(mechanism, geometry, &mut trial, &target, followed, stalled);
        let moved = posture.q.iter().zip(&trial.q).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
        if moved < NEAR || stride <= SHORTEST_STRIDE {
            posture = trial;
            reached = to;
            stride *= 2.0;
            if reached == 1.0 {
                return (posture, left);
            }
        } else {
            stride *= 0.5;
        }
    }
}

/// Newton's method from a closed posture, loops closed again after each step: the error that is left.
pub(super) fn approach(
    mechanism: &Mechanism,
    geometry: &Geometry,
    posture: &mut Posture,
    target: &Se3,
    followed: [bool; 6],
    stalled: f64,
) -> f64 {
    let mode = posture.mode;
    let mut left = error_to(target, posture, followed);
    for _ in 0..MAX_ITERATIONS {
        let size = left.norm();
        if size <= EXACT {
            return size;
        }
        let Some(step) = newton_step(mechanism, posture, &left, followed) else { return size };
        let mut fraction = longest_fraction(mechanism, posture, &step);
        loop {
            let mut trial = posture.clone();
            trial.q.iter_mut().zip(&step).for_each(|(q, s)| *q += fraction * s);
            let closed = trial.close(mechanism, geometry).is_ok() && trial.mode == mode;
            let next = error_to(target, &trial, followed);
            if closed && next.norm() < size {
                *posture = trial;
                left = next;
                break;
            }
            fraction *= 0.5;
            if fraction < 1e-3 {
                return size;
            }
        }
        if size - left.norm() < stalled * size {
            break;
        }
    }
    left.norm()
}

/// The part of a step of all joints that moves none of them too far.
pub(super) fn longest_fraction(mechanism: &Mechanism, posture: &Posture, step: &[f64]) -> f64 {
    let joints = mechanism.limbs.iter().flat_map(|limb| &limb.joints).zip(step);
    let sizes = joints.map(|(joint, s)| joint.motion.size_of(*s, posture.length()));
    LONGEST_STEP / sizes.fold(0.0_f64, f64::max).max(LONGEST_STEP)
}

/// Motions of all joints, in machine order: the smallest motion of the actuators that takes the tool by `left`, with the
/// passive joints that go with it.
fn newton_step(
    mechanism: &Mechanism,
    posture: &Posture,
    left: &DVector<f64>,
    followed: [bool; 6],
) -> Option<Vec<f64>> {
    let velocity = Velocity::of(mechanism, posture);
    let svd = velocity.followed(followed).try_svd(true, true, 5.0 * f64::EPSILON, ITERATIONS)?;
    let largest = svd.singular_values.max();
    let motion = svd.solve(left, NO_MOTION * largest).ok()?;
    velocity.of_joints(mechanism, posture, &motion)
}
