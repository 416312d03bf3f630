//! Random machines of every joint type, active and passive joints in any order, no two axes related.

// Each test file is a crate of its own and uses a part of this.
#![allow(dead_code)]

use gough::calibration::Sample;
use gough::files::problem::parse_model;
use gough::lie::{Se3, so3};
use gough::measure::Pose;
use gough::model::joint::KINDS;
use gough::model::{Mechanism, Posture, mobility};
use gough::simulate::close;
use nalgebra::{Matrix6, Vector3};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;

/// Passive joints of each limb: all patterns transmit six wrenches in all.
pub const PATTERNS: [&[usize]; 7] =
    [&[0], &[3, 3], &[4, 2], &[0, 6], &[4, 4, 4], &[5, 3, 4], &[5, 5, 5, 5, 5, 5]];

fn vector(rng: &mut ChaCha8Rng, size: f64) -> [f64; 3] {
    std::array::from_fn(|_| rng.random_range(-size..size))
}

fn limb(passive: usize, least: usize, rng: &mut ChaCha8Rng) -> Value {
    let mut joints = Vec::new();
    let (mut left, mut count) = (passive, 0);
    // Past the last passive joint a limb may go on with active ones.
    while left > 0 || count < least || rng.random_bool(0.3) {
        let kind = &KINDS[rng.random_range(0..KINDS.len())];
        let actuated: Vec<bool> = (0..kind.motions.len())
            .map(|_| {
                let active = left == 0 || rng.random_bool(0.4);
                left -= usize::from(!active);
                active
            })
            .collect();
        let axes: Vec<[f64; 3]> = (0..kind.axes).map(|_| vector(rng, 2.0)).collect();
        let mut joint = json!({"type": kind.name, "point": vector(rng, 0.5), "actuated": actuated});
        match kind.axes {
            1 => joint["axis"] = json!(axes[0]),
            _ => joint["axes"] = json!(axes),
        }
        if kind.has_pitch() {
            joint["pitch"] = json!(rng.random_range(0.05..0.3));
        }
        count += actuated.len();
        joints.push(joint);
    }
    json!({ "joints": joints })
}

/// Far from singularities of the platform and of the limbs.
fn is_regular(posture: &Posture) -> bool {
    let s = posture.wrench_singular_values();
    s[5] > 0.03 * s[0] && posture.splits.iter().all(|split| split.smallest_pivot() > 0.1)
}

/// A machine that is far from singular at home, with at least `least` joints a limb and tolerances of 1 mrad and
/// 0.5 mm.
pub fn random_machine(pattern: &[usize], least: usize, rng: &mut ChaCha8Rng) -> Mechanism {
    loop {
        let limbs: Vec<Value> = pattern.iter().map(|passive| limb(*passive, least, rng)).collect();
        let file = json!({"format": "gough-problem/1", "units": {"length": "m", "angle": "rad"},
            "mechanism": {"tool": {"position": vector(rng, 0.5), "rotation": vector(rng, 2.0)},
                          "tolerance": {"angle": 1e-3, "length": 5e-4}, "limbs": limbs}});
        let Ok(model) = parse_model(Path::new("random.json"), file.to_string().as_bytes()) else { continue };
        let Ok(home) = mobility::check(&model.mechanism, &model.mechanism.nominal()) else { continue };
        if is_regular(&home) {
            return model.mechanism;
        }
    }
}

/// Positive definite, about 20 urad and 10 um, correlated.
pub fn random_covariance(rng: &mut ChaCha8Rng) -> Matrix6<f64> {
    let root = Matrix6::from_fn(|i, j| {
        let size = if i < 3 { 2e-5 } else { 1e-5 };
        size * (if i == j { 1.0 } else { 0.0 } + rng.random_range(-0.4..0.4))
    });
    root * root.transpose()
}

/// Which components are measured: all, or the rotation and some of the position, or the position alone.
pub fn random_components(rng: &mut ChaCha8Rng) -> [bool; 6] {
    let some: [bool; 3] = std::array::from_fn(|_| rng.random_bool(0.5));
    match rng.random_range(0..3) {
        0 => [true; 6],
        1 => [true, true, true, some[0], some[1], some[2]],
        _ => [false, false, false, true, some[1], some[2]],
    }
}

/// `count` postures near home, measured about a milliradian and half a millimetre off; with `partial` some lack
/// components.
pub fn random_samples(
    mechanism: &Mechanism,
    count: usize,
    reach: f64,
    partial: bool,
    rng: &mut ChaCha8Rng,
) -> Vec<Sample> {
    let mut samples = Vec::new();
    while samples.len() < count {
        let joints = mechanism.limbs.iter().flat_map(|limb| &limb.joints).filter(|joint| joint.actuated);
        let reaches: Vec<f64> =
            joints.map(|joint| if joint.motion.is_angular() { reach } else { 0.3 * reach }).collect();
        let actuators: Vec<f64> = reaches.into_iter().map(|reach| rng.random_range(-reach..reach)).collect();
        let Ok(posture) = close(mechanism, &mechanism.nominal(), &actuators) else { continue };
        if !is_regular(&posture) {
            continue;
        }
        let turn = so3::exp(&Vector3::from(vector(rng, 1e-3)));
        let measured =
            Se3 { r: turn * posture.tool().r, p: posture.tool().p + Vector3::from(vector(rng, 5e-4)) };
        let seen = if partial { random_components(rng) } else { [true; 6] };
        let pose = Pose::new(measured, seen, &random_covariance(rng)).unwrap();
        let name = format!("sample {}", samples.len() + 1);
        samples.push(Sample { name, actuators, measurement: Arc::new(pose) });
    }
    samples
}
