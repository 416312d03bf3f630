//! Actuators that bring the machine to a wanted pose: Newton's method on active and passive joints together
//! (docs/theory.md section 12).

use super::closure::NotClosed;
use super::inverse::close_from_home;
use super::joint::Motion;
use super::mechanism::{Geometry, Mechanism, pose_difference};
use super::posture::{LONGEST_STEP, Posture, scaled};
use crate::lie::{Se3, so3};
use nalgebra::{DMatrix, DVector, Vector6};
use std::f64::consts::TAU;

/// Largest remaining error of the components that are followed, rad and machine sizes.
const REACHED: f64 = 1e-10;
/// Error at which nothing is left to gain.
const EXACT: f64 = 1e-14;
const MAX_ITERATIONS: usize = 60;
/// Relative decrease below which a point on the way counts as reached as well as may be.
const STALLED: f64 = 1e-3;
/// Singular values below this part of the largest belong to motions that the tool does not follow.
const NO_MOTION: f64 = 1e-9;
/// Shortest part of the way to the pose that is taken in one go.
const SHORTEST_STRIDE: f64 = 1.0 / 1024.0;
/// Longest motion of a joint in one stride, rad or m: a longer one may have changed branch.
const NEAR: f64 = 0.5;
/// Further starts: postures with actuators spread over their ranges.
const FURTHER_STARTS: usize = 24;

/// Why a pose cannot be commanded.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NotReached {
    /// The machine does not close where the search begins.
    #[error("the posture from which the pose is sought does not close: {0}")]
    Start(NotClosed),
    /// The components to follow cannot be had.
    #[error("out of reach: the closest posture is {rotation:.3e} rad and {translation:.3e} m away")]
    Away {
        /// Rotation that remains, components to follow only, rad.
        rotation: f64,
        /// Distance that remains, components to follow only, m.
        translation: f64,
    },
    /// Reached by a way that predictions do not take.
    #[error("reached only in another assembly mode than that of home")]
    OtherMode,
}

/// Actuators for a wanted pose.
#[derive(Clone, Debug, PartialEq)]
pub struct Commanded {
    /// Actuator variables (reading - home), rad or m.
    pub actuators: Vec<f64>,
    /// The pose that they lead to.
    pub pose: Se3,
    /// From it to the wanted pose, `[w; dp]` in {S} axes, rad and m: what is not followed.
    pub residual: Vector6<f64>,
}

/// Where a search ended: the posture, and the error of the components to follow.
type Found = (Posture, f64);

/// The actuators that bring the tool to `pose` in the components `followed` (rotations first, {S} axes), by the way from
/// `start` (actuator variables, rad or m) or, where that fails, from other postures within the ranges.
///
/// Where more actuators than components are there, every step is the smallest one; where there are fewer, the pose has to
/// be one that the machine can take.
pub fn command(
    mechanism: &Mechanism,
    geometry: &Geometry,
    start: &[f64],
    pose: &Se3,
    followed: [bool; 6],
) -> Result<Commanded, NotReached> {
    let mut closest: Option<Found> = None;
    let mut outside: Option<Commanded> = None;
    let mut failure = None;
    for attempt in 0..=FURTHER_STARTS {
        let from = if attempt == 0 { start.to_vec() } else { further_start(mechanism, attempt) };
        let found = match at(mechanism, geometry, &from) {
            Ok(posture) => along(mechanism, geometry, posture, pose, followed),
            Err(why) => {
                failure.get_or_insert(NotReached::Start(why));
                continue;
            }
        };
        if found.1 > REACHED {
            if closest.as_ref().is_none_or(|best| found.1 < best.1) {
                closest = Some(found);
            }
            continue;
        }
        let actuators = turned(mechanism, &active(mechanism, &found.0), start);
        let Ok(reached) = at(mechanism, geometry, &actuators).map(|posture| posture.tool()) else {
            failure = Some(NotReached::OtherMode);
            continue;
        };
        let (w, dp) = pose_difference(pose, &reached);
        let residual = Vector6::new(w.x, w.y, w.z, dp.x, dp.y, dp.z);
        if error(&residual, followed, found.0.length()).norm() > REACHED {
            failure = Some(NotReached::OtherMode);
            continue;
        }
        let commanded = Commanded { actuators, pose: reached, residual };
        if outside_range(mechanism, &commanded.actuators).is_empty() {
            return Ok(commanded);
        }
        outside.get_or_insert(commanded);
    }
    if let Some(commanded) = outside {
        return Ok(commanded);
    }
    if let (Some((posture, _)), false) = (closest, matches!(failure, Some(NotReached::OtherMode))) {
        let (w, dp) = pose_difference(pose, &posture.tool());
        let part = |v: &nalgebra::Vector3<f64>, first: usize| {
            (0..3).filter(|i| followed[first + i]).map(|i| v[i] * v[i]).sum::<f64>().sqrt()
        };
        return Err(NotReached::Away { rotation: part(&w, 0), translation: part(&dp, 3) });
    }
    Err(failure.unwrap_or(NotReached::OtherMode))
}

/// Indices of the actuators whose reading leaves the range of the drawing, by more than rounding.
pub fn outside_range(mechanism: &Mechanism, actuators: &[f64]) -> Vec<usize> {
    let joints = mechanism.limbs.iter().flat_map(|limb| &limb.joints).filter(|joint| joint.actuated);
    let mut outside = Vec::new();
    for (index, (joint, variable)) in joints.zip(actuators).enumerate() {
        let Some((low, high)) = joint.range else { continue };
        let (reading, slack) = (variable + joint.home, 1e-9 * (high - low));
        if reading < low - slack || reading > high + slack {
            outside.push(index);
        }
    }
    outside
}

/// The posture at these actuators, on home's branch.
fn at(mechanism: &Mechanism, geometry: &Geometry, actuators: &[f64]) -> Result<Posture, NotClosed> {
    let mut posture = Posture::new(mechanism);
    posture.close(mechanism, geometry)?;
    close_from_home(mechanism, geometry, &mut posture, actuators)?;
    Ok(posture)
}

fn further_start(mechanism: &Mechanism, attempt: usize) -> Vec<f64> {
    let joints = mechanism.limbs.iter().flat_map(|limb| &limb.joints).filter(|joint| joint.actuated);
    let share =
        |index: usize| (0.5 + 0.618_033_988_749_895 * ((attempt - 1) * (2 * index + 1)) as f64).fract();
    let value = |(index, joint): (usize, &super::Joint)| {
        joint.range.map_or(0.0, |(low, high)| low + share(index) * (high - low) - joint.home)
    };
    joints.enumerate().map(value).collect()
}

fn active(mechanism: &Mechanism, posture: &Posture) -> Vec<f64> {
    let joints = mechanism.limbs.iter().flat_map(|limb| &limb.joints);
    posture.q.iter().zip(joints).filter(|(_, joint)| joint.actuated).map(|(q, _)| *q).collect()
}

/// Joints of an open chain turned by whole turns: into their ranges, and there as near to `start` as may be.
fn turned(mechanism: &Mechanism, actuators: &[f64], start: &[f64]) -> Vec<f64> {
    if mechanism.limbs.len() > 1 {
        return actuators.to_vec();
    }
    let joints = mechanism.limbs.iter().flat_map(|limb| &limb.joints).filter(|joint| joint.actuated);
    let turn = |((joint, q), start): ((&super::Joint, &f64), &f64)| {
        if joint.motion != Motion::Revolute {
            return *q;
        }
        let nearest = q - TAU * ((q - start) / TAU).round();
        match joint.range.map(|(low, high)| (low - joint.home, high - joint.home)) {
            Some((low, _)) if nearest < low => nearest + TAU * ((low - nearest) / TAU).ceil(),
            Some((_, high)) if nearest > high => nearest - TAU * ((nearest - high) / TAU).ceil(),
            _ => nearest,
        }
    };
    joints.zip(actuators).zip(start).map(turn).collect()
}

/// Follows the straight way from the posture's pose to `pose`, in strides short enough that no branch is changed.
fn along(
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
fn approach(
    mechanism: &Mechanism,
    geometry: &Geometry,
    posture: &mut Posture,
    target: &Se3,
    followed: [bool; 6],
    stalled: f64,
) -> f64 {
    let mode = posture.mode;
    let error_of = |posture: &Posture| {
        let (w, dp) = pose_difference(target, &posture.tool());
        error(&Vector6::new(w.x, w.y, w.z, dp.x, dp.y, dp.z), followed, posture.length())
    };
    let mut left = error_of(posture);
    for _ in 0..MAX_ITERATIONS {
        let size = left.norm();
        if size <= EXACT {
            return size;
        }
        let Some(step) = newton_step(mechanism, posture, &left, followed) else { return size };
        let joints = mechanism.limbs.iter().flat_map(|limb| &limb.joints).zip(&step);
        let sizes = joints.map(|(joint, s)| joint.motion.size_of(*s, posture.length()));
        let longest = sizes.fold(0.0_f64, f64::max);
        let mut fraction = LONGEST_STEP / longest.max(LONGEST_STEP);
        loop {
            let mut trial = posture.clone();
            trial.q.iter_mut().zip(&step).for_each(|(q, s)| *q += fraction * s);
            let closed = trial.close(mechanism, geometry).is_ok() && trial.mode == mode;
            let next = error_of(&trial);
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

/// The components to follow, lengths in machine sizes.
fn error(residual: &Vector6<f64>, followed: [bool; 6], length: f64) -> DVector<f64> {
    let parts = (0..6).filter(|&i| followed[i]).map(|i| residual[i] / if i < 3 { 1.0 } else { length });
    DVector::from_vec(parts.collect())
}

/// Motions of all joints, in machine order: the smallest motion of the actuators that takes the tool by `left` (12.1),
/// with the passive joints that go with it (12.2).
fn newton_step(
    mechanism: &Mechanism,
    posture: &Posture,
    left: &DVector<f64>,
    followed: [bool; 6],
) -> Option<Vec<f64>> {
    let open = mechanism.is_open_chain();
    let count = mechanism.actuator_count();
    let mut by_actuators = DMatrix::zeros(6, count);
    let mut twists = Vec::with_capacity(count);
    let (mut frame, mut wrench) = (0, 0);
    for (limb, split) in mechanism.limbs.iter().zip(&posture.splits) {
        let tool = posture.frames[frame + limb.joints.len()].p();
        for (joint, g) in limb.joints.iter().zip(&posture.frames[frame..]).filter(|(joint, _)| joint.actuated)
        {
            let twist = scaled(joint.motion.tool_twist(g, &tool), posture.length());
            let mut column = Vector6::from(twist);
            if !open {
                column = Vector6::zeros();
                for (k, w) in split.wrenches().iter().enumerate() {
                    let power: f64 = w.iter().zip(&twist).map(|(w, t)| w * t).sum();
                    column += posture.wrench_inverse.column(wrench + k) * power;
                }
            }
            by_actuators.set_column(twists.len(), &column);
            twists.push(twist);
        }
        frame += limb.joints.len() + 1;
        wrench += split.wrenches().len();
    }
    let rows: Vec<usize> = (0..6).filter(|&i| followed[i]).collect();
    let svd = by_actuators.select_rows(&rows).svd(true, true);
    let largest = svd.singular_values.max();
    let motion = svd.solve(left, NO_MOTION * largest).ok()?;
    let platform = &by_actuators * &motion;
    let mut step = Vec::with_capacity(posture.q.len());
    let mut actuator = 0;
    for (limb, split) in mechanism.limbs.iter().zip(&posture.splits) {
        let mut rest: [f64; 6] = std::array::from_fn(|i| platform[i]);
        let own = actuator;
        for _ in 0..limb.joints.len() - limb.passive_count() {
            for (rest, t) in rest.iter_mut().zip(&twists[actuator]) {
                *rest -= t * motion[actuator];
            }
            actuator += 1;
        }
        let passive = split.motions(&rest);
        let (mut a, mut p) = (motion.iter().skip(own), passive.iter());
        for joint in &limb.joints {
            let next = if joint.actuated { a.next() } else { p.next() };
            step.push(next.copied().unwrap_or(0.0));
        }
    }
    step.iter().all(|s| s.is_finite()).then_some(step)
}
