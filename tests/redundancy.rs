//! Directions that no pose can see: how many there are, and that nothing is seen along them.

mod random_machine;
mod support;

use faer::Mat;
use gough::calibration::{Calibration, Sample};
use gough::files::problem::parse_model;
use gough::files::{DataPlaces, read_problem};
use gough::linalg::singular_values;
use gough::model::{Joint, Mechanism, Prior};
use gough::problem::{Form, Problem, check};
use gough::simulate::draw_deviations;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use random_machine::{PATTERNS, random_machine, random_samples};
use serde_json::{Value, json};
use std::path::Path;
use support::{file, name, problems};

/// Without limbs of six passive joints, which transmit no wrench: no pose sees anything of them.
const SEEN: [&[usize]; 5] = [PATTERNS[0], PATTERNS[1], PATTERNS[2], PATTERNS[4], PATTERNS[5]];

/// 4r + 2p + 6.
fn structural(mechanism: &Mechanism) -> usize {
    let (r, p) = mechanism.joint_counts();
    4 * r + 2 * p + 6
}

fn assert_redundant(mechanism: &Mechanism, samples: &[Sample], what: &str) {
    for form in [Form::Complete, Form::Plain] {
        for distance in [0.0, 1.0] {
            let at = draw_deviations(mechanism, 21, distance);
            let problem = Calibration::new(mechanism, samples, form, &at);
            let x = problem.coordinates().nearest(&at);
            let jac = problem.linearize(&x).unwrap().jac;
            let null = problem.redundant(&x);
            assert_eq!(null.ncols(), x.len() - problem.coordinates().slice_count(), "{what}");
            let seen = (&jac * &null).norm_max() / jac.norm_max();
            assert!(seen <= 1e-12, "{what} {form:?} {distance}: {seen:.1e}");
            let identity = Mat::<f64>::identity(null.ncols(), null.ncols());
            assert!((null.transpose() * &null - identity).norm_max() <= 1e-13, "{what}");
        }
    }
    let minimal = Calibration::new(mechanism, samples, Form::Minimal, &draw_deviations(mechanism, 0, 0.0));
    assert_eq!(minimal.params().len(), minimal.coordinates().slice_count(), "{what}");
    assert_eq!(minimal.redundant(&vec![0.0; minimal.params().len()]).ncols(), 0, "{what}");
}

#[test]
fn no_pose_of_any_problem_sees_them() {
    let places = DataPlaces { data_dir: None, shared: "no such folder".into() };
    for path in problems() {
        let read = read_problem(&path, &places).unwrap();
        let samples: Vec<Sample> = read.data.samples.iter().step_by(20).cloned().collect();
        assert_redundant(&read.mechanism, &samples, &name(&path));
        let problem = Calibration::new(
            &read.mechanism,
            &samples,
            Form::Complete,
            &draw_deviations(&read.mechanism, 0, 0.0),
        );
        assert_eq!(problem.coordinates().slice_count(), structural(&read.mechanism), "{}", name(&path));
    }
}

/// Whether passive slides work together as one: of two in a plane nothing but the plane is seen, of three no
/// translation at all, so that 4r + 2p + 6 counts too many.
fn slides_together(mechanism: &Mechanism) -> bool {
    mechanism.limbs.iter().any(|limb| {
        let count = |joints: &[Joint]| {
            joints.iter().filter(|joint| !joint.actuated && !joint.motion.is_angular()).count()
        };
        let in_planes = limb.joints.split(|joint| joint.motion.is_angular());
        count(&limb.joints) > 2 || in_planes.into_iter().any(|joints| count(joints) > 1)
    })
}

/// A machine whose platform moves in six ways, so that no limb hides errors of another.
fn mobile_machine(pattern: &[usize], rng: &mut ChaCha8Rng) -> Mechanism {
    loop {
        let mechanism = random_machine(pattern, 6, rng);
        if !slides_together(&mechanism) {
            return mechanism;
        }
    }
}

/// Rank of the complete Jacobian: singular values before the widest gap.
fn rank(problem: &Calibration<'_>, x: &[f64], expected: usize, what: &str) -> usize {
    let s = singular_values(problem.linearize(x).unwrap().jac.as_ref()).unwrap();
    let found = s.iter().filter(|v| **v > 1e-11 * s[0]).count();
    let next = s.get(found).map_or(0.0, |v| v / s[0]);
    assert!(
        found == 0 || s[found - 1] > 100.0 * next * s[0],
        "{what}: no gap: {expected} expected, {:?}",
        &s[expected.saturating_sub(3)..(expected + 3).min(s.len())]
    );
    found
}

#[test]
fn all_others_are_seen_by_random_machines() {
    let mut rng = ChaCha8Rng::seed_from_u64(22);
    for pattern in SEEN {
        let mechanism = mobile_machine(pattern, &mut rng);
        let expected = structural(&mechanism);
        let samples = random_samples(&mechanism, expected, 0.4, false, &mut rng);
        // Away from the drawing, where the axes of universal and spherical joints meet.
        let at = draw_deviations(&mechanism, 27, 10.0);
        let problem = Calibration::new(&mechanism, &samples, Form::Complete, &at);
        assert!(2 * problem.rows() >= 3 * expected, "{pattern:?}: too few postures");
        let x = problem.coordinates().nearest(&at);
        assert_eq!(rank(&problem, &x, expected, &format!("{pattern:?}")), expected, "{pattern:?}");
        assert_redundant(&mechanism, &samples[..5], &format!("{pattern:?}"));
    }
}

/// Holds components at random, as a tolerance of 0 does; not inside joints of several axes, which would stay
/// special for good.
fn hold(mechanism: &mut Mechanism, rng: &mut ChaCha8Rng) {
    for link in mechanism.limbs.iter_mut().flat_map(|limb| &mut limb.links) {
        if link.name.contains('.') && !link.name.ends_with(".1") {
            continue;
        }
        match rng.random_range(0..6) {
            0 => link.tolerance.angle = Prior::Held,
            1 => link.tolerance.length = Prior::Held,
            2 => (link.tolerance.angle, link.tolerance.length) = (Prior::Held, Prior::Held),
            _ => {}
        }
    }
}

/// What a machine with held links must satisfy: its count is the rank at a machine that deviates, nothing is seen
/// along the redundant directions, and the Jacobian is that of the kinematics. Universal and spherical joints that
/// are held ideal stay `special`, as do passive slides that work together: then the rank may be less.
fn assert_held(mechanism: &Mechanism, samples: &[Sample], special: bool, what: &str) -> usize {
    // As far as the drawing allows, so that axes no longer meet or stand parallel where they can deviate.
    let at = draw_deviations(mechanism, 23, 10.0);
    let problem = Calibration::new(mechanism, samples, Form::Complete, &at);
    let count = problem.coordinates().slice_count();
    assert!(2 * problem.rows() >= 3 * count, "{what}: too few postures");
    let x = problem.coordinates().nearest(&at);
    let rank = rank(&problem, &x, count, what);
    assert!(rank == count || (special && rank < count), "{what}: {count} counted, {rank} seen");
    assert_redundant(mechanism, &samples[..4], what);
    for form in [Form::Minimal, Form::Complete] {
        for distance in [0.0, 1.0] {
            let at = draw_deviations(mechanism, 24, distance);
            let problem = Calibration::new(mechanism, &samples[..4], form, &at);
            let x = problem.coordinates().nearest(&at);
            let error = check::jacobian_error(&problem, &x, 0.01).unwrap();
            assert!(error <= 1e-8, "{what} {form:?} {distance}: {error:.1e}");
        }
    }
    count
}

#[test]
fn held_links_of_random_machines_reduce_the_count_as_rank_says() {
    let mut rng = ChaCha8Rng::seed_from_u64(25);
    for pattern in SEEN {
        for round in 0..4 {
            let mut mechanism = mobile_machine(pattern, &mut rng);
            hold(&mut mechanism, &mut rng);
            let samples = random_samples(&mechanism, structural(&mechanism), 0.4, false, &mut rng);
            let count = assert_held(&mechanism, &samples, false, &format!("{pattern:?} {round}"));
            assert!(count < structural(&mechanism));
        }
    }
}

/// The drawing with `tolerance` under `key` of every joint of the kinds named.
fn with_held(problem: &str, kinds: &[&str], key: &str, tolerance: &Value) -> Mechanism {
    let mut value = support::json(&file(problem));
    for limb in value["mechanism"]["limbs"].as_array_mut().unwrap() {
        for joint in limb["joints"].as_array_mut().unwrap() {
            if kinds.contains(&joint["type"].as_str().unwrap()) {
                joint[key] = tolerance.clone();
            }
        }
    }
    parse_model(Path::new(problem), value.to_string().as_bytes()).unwrap().mechanism
}

/// Ideal joints, exact mounting, known slides: axes here meet, stand square or parallel, so that a drawing hides
/// dependencies that a real machine does not have.
#[test]
fn held_links_of_drawings_reduce_the_count_as_rank_says() {
    let (angle, length) = (json!({"angle": 0, "length": 5e-4}), json!({"angle": 1e-3, "length": 0}));
    let both = json!({"angle": 0, "length": 0});
    let mut rng = ChaCha8Rng::seed_from_u64(26);
    for (problem, kinds, key) in [
        ("problems/serial-scara.json", &["revolute"][..], "tolerance"),
        ("problems/serial-scara.json", &["prismatic"], "tolerance"),
        ("problems/serial-scara-screw.json", &["helical"], "tolerance"),
        ("problems/serial-ur10.json", &["revolute"], "tolerance"),
        ("problems/serial-puma560.json", &["revolute"], "tolerance"),
        ("problems/serial-stanford.json", &["revolute"], "tolerance"),
        ("problems/serial-stanford.json", &["prismatic"], "tolerance"),
        ("problems/hexapod-6ups.json", &["universal", "spherical"], "inner_tolerance"),
        ("problems/hexapod-6ups.json", &["prismatic"], "tolerance"),
        ("problems/hexapod-6ucu.json", &["cylindrical"], "inner_tolerance"),
        ("problems/positioner-321.json", &["prismatic"], "tolerance"),
        ("problems/tripod-3rps.json", &["revolute", "spherical"], "tolerance"),
        ("problems/tripod-3prs.json", &["spherical"], "inner_tolerance"),
        ("problems/delta-3puu.json", &["universal"], "tolerance"),
        ("problems/delta-3puu.json", &["universal"], "inner_tolerance"),
    ] {
        for (held, tolerance) in [("angle", &angle), ("length", &length), ("both", &both)] {
            let mechanism = with_held(problem, kinds, key, tolerance);
            let samples = random_samples(&mechanism, structural(&mechanism) / 2, 0.3, false, &mut rng);
            let what = format!("{problem} {kinds:?} {key} {held}");
            let special = key == "inner_tolerance" || slides_together(&mechanism);
            let count = assert_held(&mechanism, &samples, special, &what);
            eprintln!("{problem} {kinds:?} {key}, {held} held: {count} of {}", structural(&mechanism));
        }
    }
}
