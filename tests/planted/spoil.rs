//! Mistakes of every kind, and data with them.

use gough::check::correction::actuated;
use gough::check::{Correction, Euler, Reading};
use gough::identify::registration::FreeEnds;
use gough::lie::{Se3, so3};
use gough::model::{Joint, Mechanism};
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::{FRAC_PI_2, PI};

/// Corrections that undo the mistakes to be planted, different in kind.
pub fn kinds(mechanism: &Mechanism, data: &[Reading], count: usize, rng: &mut ChaCha8Rng) -> Vec<Correction> {
    let joints = actuated(mechanism);
    let mut chosen: Vec<(usize, Correction)> = Vec::new();
    while chosen.len() < count {
        let kind = rng.random_range(0..12);
        // Neither two of a kind, nor two that scale, nor two of the rotation.
        let group = |kind: usize| match kind {
            0..=2 => 0,
            6..=8 => 6,
            k => k,
        };
        if chosen.iter().any(|(other, _)| group(*other) == group(kind)) {
            continue;
        }
        if let Some(correction) = draw(kind, mechanism, &joints, data, rng) {
            chosen.push((kind, correction));
        }
    }
    chosen.sort_by_key(|(kind, _)| *kind);
    chosen.into_iter().map(|(_, correction)| correction).collect()
}

fn draw(
    kind: usize,
    mechanism: &Mechanism,
    joints: &[&Joint],
    data: &[Reading],
    rng: &mut ChaCha8Rng,
) -> Option<Correction> {
    let n = joints.len();
    let vectors = data.iter().all(|r| r.vector.is_some());
    let rotations = data.iter().all(|r| r.rotation.is_some());
    let angular = joints[0].motion.is_angular();
    let degree = if rng.random::<bool>() { PI / 180.0 } else { 180.0 / PI };
    let thousand = if rng.random::<bool>() { 1e-3 } else { 1e3 };
    let i = rng.random_range(0..n);
    let j = rng.random_range(0..n);
    match kind {
        0 => Some(Correction::PositionScale(thousand)),
        1 if vectors => Some(Correction::RotationScale(degree)),
        2 if joints.iter().all(|joint| joint.motion.is_angular() == angular) => {
            Some(Correction::ActuatorScale(!angular, if angular { degree } else { thousand }))
        }
        3 if i < j && joints[i].motion.is_angular() == joints[j].motion.is_angular() => {
            Some(Correction::Swapped(i, j))
        }
        4 => Some(Correction::Reversed(i, false)),
        5 if joints[i].motion.is_angular() => {
            let offset = [FRAC_PI_2, -FRAC_PI_2, 0.3, -0.6][rng.random_range(0..4)];
            Some(Correction::Offsets(vec![(i, offset)]))
        }
        5 => {
            let size = mechanism.characteristic_length() * (0.03 + 0.05 * rng.random::<f64>());
            Some(Correction::Offsets(vec![(i, if rng.random::<bool>() { size } else { -size })]))
        }
        6 if rotations => {
            Some([Correction::Transposed, Correction::Inverted][rng.random_range(0..2)].clone())
        }
        7 if vectors => Some(Correction::Euler(Euler::all()[rng.random_range(0..12)], 1.0)),
        8 if data.iter().all(|r| r.quaternion) => Some(Correction::QuaternionOrder),
        9 if mechanism.limbs.len() == 1
            && i > j
            && joints[i].motion.is_angular()
            && joints[j].motion.is_angular() =>
        {
            Some(Correction::Coupled {
                joint: i,
                by: j,
                factor: if rng.random::<bool>() { 1.0 } else { -1.0 },
            })
        }
        10 if !FreeEnds::of(mechanism).base && data.iter().all(|r| r.rotation.is_some()) => {
            Some(Correction::Elsewhere(FreeEnds { base: true, tool: false }))
        }
        11 => Some(Correction::PositionOrder([[0, 2, 1], [1, 0, 2], [2, 1, 0]][rng.random_range(0..3)])),
        _ => None,
    }
}

/// The data as they are with the mistakes; `None` where they are no more than rounding apart from what they were.
pub fn spoiled(
    mechanism: &Mechanism,
    clean: &[Reading],
    planted: &[Correction],
    rng: &mut ChaCha8Rng,
) -> Option<Vec<Reading>> {
    let joints = actuated(mechanism);
    let mut data = clean.to_vec();
    let away = Se3 {
        r: so3::exp(&Vector3::new(0.4, 1.9, -0.3)),
        p: Vector3::new(rng.random(), rng.random(), rng.random()) * 2.0,
    };
    for correction in planted.iter().rev() {
        for reading in &mut data {
            spoil(correction, reading, &joints, &away)?;
        }
    }
    Some(data)
}

fn spoil(correction: &Correction, reading: &mut Reading, joints: &[&Joint], away: &Se3) -> Option<()> {
    let n = joints.len();
    match correction {
        Correction::PositionScale(f) => Correction::PositionScale(1.0 / f).apply(reading, joints),
        Correction::RotationScale(f) => Correction::RotationScale(1.0 / f).apply(reading, joints),
        Correction::ActuatorScale(sliding, f) => {
            Correction::ActuatorScale(*sliding, 1.0 / f).apply(reading, joints)
        }
        Correction::Shifted(k) => Correction::Shifted(n - k).apply(reading, joints),
        Correction::Offsets(offsets) => {
            Correction::Offsets(offsets.iter().map(|(i, v)| (*i, -v)).collect()).apply(reading, joints)
        }
        Correction::Coupled { joint, by, factor } => {
            Correction::Coupled { joint: *joint, by: *by, factor: -factor }.apply(reading, joints)
        }
        Correction::PositionOrder(order) => {
            let p = reading.position;
            (0..3).for_each(|i| reading.position[order[i]] = p[i]);
            Some(())
        }
        Correction::Euler(euler, _) => {
            let angles = angles(euler, &reading.rotation?);
            assert!((euler.rotation(&angles) - reading.rotation?).norm() < 1e-9);
            (reading.rotation, reading.vector) = (Some(so3::exp(&angles)), Some(angles));
            Some(())
        }
        Correction::QuaternionOrder => {
            let q =
                UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(reading.rotation?));
            let read = UnitQuaternion::from_quaternion(Quaternion::new(q.i, q.j, q.k, q.w));
            reading.rotation = Some(read.to_rotation_matrix().into_inner());
            Some(())
        }
        Correction::Elsewhere(_) => {
            let pose = *away * reading.pose()?;
            reading.position = pose.p;
            (reading.rotation, reading.vector) = (Some(pose.r), reading.vector.map(|_| so3::log(&pose.r)));
            Some(())
        }
        other => other.apply(reading, joints),
    }
}

/// The angles about three different axes that make the rotation.
fn angles(euler: &Euler, r: &Matrix3<f64>) -> Vector3<f64> {
    let [a, b, c] = euler.axes;
    // Turns about fixed axes are those about moving ones in reverse.
    let (a, c) = if euler.fixed { (c, a) } else { (a, c) };
    let sign = if (b + 3 - a) % 3 == 1 { 1.0 } else { -1.0 };
    let first = (-sign * r[(b, c)]).atan2(r[(c, c)]);
    let last = (-sign * r[(a, b)]).atan2(r[(a, a)]);
    let middle = (sign * r[(a, c)]).clamp(-1.0, 1.0).asin();
    if euler.fixed { Vector3::new(last, middle, first) } else { Vector3::new(first, middle, last) }
}
