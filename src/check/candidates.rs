//! Every usual mistake that a machine and its data can have, and the stories of two of them that hold together.

use super::correction::{Correction, Numbers, actuated, applied};
use super::euler::Euler;
use super::reading::Reading;
use super::turns::within_one_turn;
use crate::identify::registration::FreeEnds;
use crate::measure::Point;
use crate::model::{Joint, Limb, Mechanism, Motion, Prior};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// rad per degree.
const DEGREE: f64 = PI / 180.0;
/// Turns in place of rad, and of degrees.
const REVOLUTIONS: [f64; 2] = [TAU, 360.0];
/// Targets up to which exchanges of two are tried; of more, none.
const TARGETS: usize = 6;
/// Offsets of homes that come from where an axis counts from, rad.
const HOMES: [f64; 3] = [FRAC_PI_2, -FRAC_PI_2, PI];

/// Every correction that this machine and data can have, the plainest first. Of those that change the numbers alike the
/// first stays.
pub(super) fn corrections(mechanism: &Mechanism, data: &[Reading]) -> Vec<Correction> {
    let joints = actuated(mechanism);
    let vectors = data.iter().all(|reading| reading.vector.is_some());
    let rotations = data.iter().all(|reading| reading.rotation.is_some());
    let mut list = units(&joints, vectors);
    if rotations {
        if data.iter().all(|reading| reading.quaternion) {
            list.push(Correction::QuaternionOrder);
        }
        list.extend([Correction::Transposed, Correction::Inverted]);
    }
    list.extend(orders(&joints));
    list.extend(signs(&joints));
    list.extend(hands(mechanism));
    let wrapped = within_one_turn(&joints, data);
    list.extend((!wrapped.is_empty()).then_some(Correction::Unwrapped(wrapped)));
    list.extend(exchanges(mechanism, data));
    if joints.iter().any(|joint| joint.home != 0.0) {
        list.push(Correction::FromHome);
    }
    list.extend([[0, 2, 1], [1, 0, 2], [2, 1, 0], [1, 2, 0], [2, 0, 1]].map(Correction::PositionOrder));
    if vectors {
        for factor in [1.0, DEGREE, 1.0 / DEGREE] {
            list.extend(Euler::all().into_iter().map(|euler| Correction::Euler(euler, factor)));
        }
    }
    list.extend(couplings(mechanism));
    for (i, _) in joints.iter().enumerate().filter(|(_, joint)| joint.motion.is_angular()) {
        list.extend(HOMES.map(|offset| Correction::Offsets(vec![(i, offset)])));
    }
    let ends = FreeEnds::of(mechanism);
    for (base, tool) in [(true, false), (false, true), (true, true)] {
        if !(base && ends.base || tool && ends.tool) {
            list.push(Correction::Elsewhere(FreeEnds { base, tool }));
        }
    }
    distinct(mechanism, data, list)
}

fn units(joints: &[&Joint], vectors: bool) -> Vec<Correction> {
    let angular = joints.iter().any(|joint| joint.motion.is_angular());
    let sliding = joints.iter().any(|joint| !joint.motion.is_angular());
    let homes = joints.iter().any(|joint| joint.motion.is_angular() && joint.home != 0.0);
    let mut list = [1e-3, 1e3].map(Correction::PositionScale).to_vec();
    let turns = [DEGREE, 1.0 / DEGREE];
    if vectors {
        list.extend(turns.map(Correction::RotationScale));
    }
    if sliding {
        list.extend([1e-3, 1e3].map(|factor| Correction::ActuatorScale(true, factor)));
    }
    if angular {
        list.extend(turns.map(|factor| Correction::ActuatorScale(false, factor)));
        list.extend(turns.into_iter().filter(|_| homes).map(Correction::TurningScale));
        list.extend(REVOLUTIONS.map(|factor| Correction::ActuatorScale(false, factor)));
        for (i, _) in joints.iter().enumerate().filter(|(_, joint)| joint.motion.is_angular()) {
            list.extend(REVOLUTIONS.map(|factor| Correction::OneScale(i, factor)));
        }
    }
    if sliding {
        list.extend([1e-3, 1e3].map(Correction::LengthScale));
    }
    if vectors && angular {
        list.extend(turns.map(|factor| Correction::AngleScale(factor, false)));
        list.extend(turns.into_iter().filter(|_| homes).map(|factor| Correction::AngleScale(factor, true)));
    }
    list
}

fn orders(joints: &[&Joint]) -> Vec<Correction> {
    let n = joints.len();
    let alike = |i: usize, j: usize| joints[i].motion.is_angular() == joints[j].motion.is_angular();
    let mut list = Vec::new();
    for i in 0..n {
        list.extend((i + 1..n).filter(|&j| alike(i, j)).map(|j| Correction::Swapped(i, j)));
    }
    if n > 2 && (1..n).all(|i| alike(0, i)) {
        list.push(Correction::Backwards);
        list.extend((1..n).map(Correction::Shifted));
    }
    list
}

fn signs(joints: &[&Joint]) -> Vec<Correction> {
    let mut list = Vec::new();
    for (i, joint) in joints.iter().enumerate() {
        list.push(Correction::Reversed(i, false));
        list.extend((joint.home != 0.0).then_some(Correction::Reversed(i, true)));
    }
    list.extend((joints.len() > 1).then_some(Correction::AllReversed(false)));
    list.extend((joints.len() > 1).then_some(Correction::AllReversed(true)));
    list
}

/// All screws of the other hand, and each by itself.
fn hands(mechanism: &Mechanism) -> Vec<Correction> {
    let screw = |motion: Motion| matches!(motion, Motion::Helical { advance } if advance != 0.0);
    let of = |(i, limb): (usize, &Limb)| -> Vec<(usize, usize)> {
        let joints = limb.joints.iter().enumerate().filter(|(_, joint)| screw(joint.motion));
        joints.map(|(j, _)| (i, j)).collect()
    };
    let screws: Vec<(usize, usize)> = mechanism.limbs.iter().enumerate().flat_map(of).collect();
    let mut list: Vec<Correction> = screws.iter().map(|at| Correction::Handed(vec![*at])).collect();
    if screws.len() > 1 {
        list.push(Correction::Handed(screws));
    }
    list
}

/// Two targets whose places are drawn, their names exchanged; those of free ones say nothing. None where there are more
/// than [`TARGETS`].
fn exchanges(mechanism: &Mechanism, data: &[Reading]) -> Vec<Correction> {
    let is_free = |k: usize| mechanism.instrument.get(k).is_some_and(|c| c.prior == Prior::Free);
    let mut targets: Vec<Point> = Vec::new();
    for target in data.iter().map(|reading| reading.target) {
        if !target.constants.is_some_and(is_free) && !targets.contains(&target) {
            targets.push(target);
        }
    }
    if targets.len() > TARGETS {
        return Vec::new();
    }
    let pairs = targets.iter().enumerate();
    pairs.flat_map(|(i, a)| targets.iter().skip(i + 1).map(|b| Correction::Exchanged(*a, *b))).collect()
}

/// A turning joint and one before it in the same limb.
fn couplings(mechanism: &Mechanism) -> Vec<Correction> {
    let mut list = Vec::new();
    let mut first = 0;
    for limb in &mechanism.limbs {
        let driven: Vec<&Joint> = limb.joints.iter().filter(|joint| joint.actuated).collect();
        for joint in 1..driven.len() {
            for by in (0..joint).rev() {
                if driven[joint].motion.is_angular() && driven[by].motion.is_angular() {
                    list.extend([1.0, -1.0].map(|factor| Correction::Coupled {
                        joint: first + joint,
                        by: first + by,
                        factor,
                    }));
                }
            }
        }
        first += driven.len();
    }
    list
}

/// Those that change some of the readings, each in a way of its own.
fn distinct(mechanism: &Mechanism, data: &[Reading], list: Vec<Correction>) -> Vec<Correction> {
    let some: Vec<Reading> = data.iter().step_by(data.len().div_ceil(3).max(1)).cloned().collect();
    let numbers = |data: &[Reading]| -> Vec<f64> {
        let of = |r: &Reading| {
            let turn = r.rotation.unwrap_or_default();
            let (position, turn, target) = (r.position, turn, r.target.nominal);
            let measured = position.iter().chain(turn.iter()).chain(target.iter());
            r.actuators.iter().chain(measured).copied().collect()
        };
        data.iter().flat_map(|r| -> Vec<f64> { of(r) }).collect()
    };
    let same = |a: &[f64], b: &[f64]| {
        a.len() == b.len()
            && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-9 * (a.abs() + b.abs()) + 1e-12)
    };
    let before = numbers(&some);
    let mut kept: Vec<(Correction, Vec<f64>)> = Vec::new();
    for correction in list {
        let Some(changed) = applied(mechanism, &some, std::slice::from_ref(&correction)) else { continue };
        let after = numbers(&changed);
        // Turns are counted posture by posture, and targets differ from reading to reading: a few do not tell.
        let untold = matches!(
            correction,
            Correction::Handed(_) | Correction::Unwrapped(_) | Correction::Exchanged(..)
        ) || correction.numbers() == Numbers::Place;
        if untold || !same(&before, &after) && !kept.iter().any(|(_, other)| same(other, &after)) {
            kept.push((correction, if untold { Vec::new() } else { after }));
        }
    }
    kept.into_iter().map(|(correction, _)| correction).collect()
}

/// Whether the two may stand in one story: neither changes what the other does for good.
pub(super) fn hold_together(a: &Correction, b: &Correction) -> bool {
    let (once, other) = (a.once(), b.once());
    // What was read is counted by the machine and the pose as they are.
    if [a, b].iter().any(|c| matches!(c, Correction::Unwrapped(_))) {
        return false;
    }
    let homes = |c: &Correction| match c {
        Correction::Offsets(offsets) => offsets.first().map(|(i, _)| *i),
        _ => None,
    };
    !once.iter().any(|part| other.contains(part)) && (homes(a).is_none() || homes(a) != homes(b))
}
