//! The same machine, described otherwise, predicts the same poses after identification.

mod support;

use gough::calibration::Sample;
use gough::files::problem::parse_problem;
use gough::files::{
    DataDrawing, DataPlaces, ProblemDrawing, ProblemFile, SampleDrawing, Units, json, redraw,
};
use gough::identify::identify;
use gough::lie::{Se3, so3};
use gough::measure::Pose;
use gough::model::{Ends, Mechanism, Prior, Tolerance};
use gough::simulate::close;
use gough::solve::Stop;
use gough::solve::minimal::Minimal;
use nalgebra::{Matrix6, Vector3};
use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;
use support::{apart, file, golden};

fn parse(text: &[u8]) -> ProblemFile {
    let places = DataPlaces { data_dir: None, shared: "no such folder".into() };
    parse_problem(Path::new("machine.json"), text, &places).unwrap()
}

/// A machine, what was measured of it, and readings at which it is to predict.
struct Case {
    name: String,
    text: Vec<u8>,
    mechanism: Mechanism,
    samples: Vec<Sample>,
    fresh: Vec<Vec<f64>>,
    noise: Matrix6<f64>,
}

impl Case {
    fn new(path: &Path) -> Self {
        let text = std::fs::read(path).unwrap();
        let read = parse(&text);
        let fresh = read.data.samples.iter().map(|s| s.actuators.iter().map(|q| 0.8 * q).collect());
        Self {
            name: read.name,
            text,
            mechanism: read.mechanism,
            fresh: fresh.collect(),
            samples: read.data.samples,
            noise: read.data.noise.unwrap(),
        }
    }

    fn with_pose(&self, sample: &Sample, pose: Se3) -> Sample {
        let pose = Pose::new(pose, [true; 6], &self.noise).unwrap();
        Sample { measurement: Arc::new(pose), ..sample.clone() }
    }
}

fn pose(g: &Se3) -> support::Pose {
    support::Pose { r: g.r, p: g.p }
}

/// Poses at `fresh` after identification, and before.
fn predicted(mechanism: &Mechanism, samples: &[Sample], fresh: &[Vec<f64>]) -> (Vec<Se3>, Vec<Se3>) {
    let found = identify(mechanism, samples, &Minimal::default(), &Stop::default()).unwrap();
    assert!(found.report.outcome.converged(), "{}", found.report.outcome);
    let after = |q: &Vec<f64>| close(&found.start, &found.geometry, q).unwrap().tool();
    let before = |q: &Vec<f64>| close(mechanism, &mechanism.nominal(), q).unwrap().tool();
    (fresh.iter().map(after).collect(), fresh.iter().map(before).collect())
}

/// Largest difference from what the machine as given predicts, in parts of its largest deviation from nominal.
#[track_caller]
fn assert_same(case: &Case, what: &str, poses: &[Se3]) {
    let (reference, nominal) = predicted(&case.mechanism, &case.samples, &case.fresh);
    let most = |a: &[Se3]| {
        let pairs = a.iter().zip(&reference).map(|(a, b)| apart(&pose(a), &pose(b)));
        pairs.fold((0.0_f64, 0.0_f64), |m, (w, v)| (m.0.max(w), m.1.max(v)))
    };
    let (deviation, difference) = (most(&nominal), most(poses));
    let parts = (difference.0 / deviation.0, difference.1 / deviation.1);
    eprintln!("{}, {what}: {:.1e} and {:.1e} of the deviation", case.name, parts.0, parts.1);
    assert!(parts.0 <= 1e-7 && parts.1 <= 1e-7, "{}, {what}: {parts:?}", case.name);
}

fn cases() -> Vec<Case> {
    let paths = [
        golden("hexapod-6ups", "problem.json"),
        golden("tripod-3rps", "problem.json"),
        golden("serial-6r", "problem.json"),
        file("problems/hexapod-ballscrew.json"),
        file("problems/hexapod-6ucu.json"),
        file("problems/serial-scara-screw.json"),
    ];
    paths.iter().map(|path| Case::new(path)).collect()
}

#[test]
fn in_other_units() {
    let units: [Units; 2] = [("m", "rad"), ("mm", "deg")]
        .map(|(length, angle)| serde_json::from_value(json!({"length": length, "angle": angle})).unwrap());
    for case in cases() {
        let read = parse(&case.text);
        let other = if read.units == units[0] { units[1] } else { units[0] };
        let drawn = |s: &Sample| {
            SampleDrawing::of(&case.mechanism, other, &s.actuators, s.measurement.pose().unwrap())
        };
        let noise = json!({"angle": other.from_radians(case.noise[(0, 0)].sqrt()),
                           "length": other.from_metres(case.noise[(3, 3)].sqrt())});
        let drawing = ProblemDrawing {
            units: other,
            mechanism: redraw(&case.mechanism, &case.mechanism.nominal(), other),
            data: Some(DataDrawing {
                noise: Some(serde_json::from_value(noise).unwrap()),
                samples: Some(case.samples.iter().map(drawn).collect()),
                ..DataDrawing::default()
            }),
            truth: None,
            ..read.drawing
        };
        let again = parse(&json::text(&drawing).unwrap());
        let (poses, _) = predicted(&again.mechanism, &again.data.samples, &case.fresh);
        assert_same(&case, "in other units", &poses);
    }
}

#[test]
fn with_the_instrument_elsewhere() {
    let mut rng = ChaCha8Rng::seed_from_u64(41);
    for case in cases() {
        let vector = |rng: &mut ChaCha8Rng, size: f64| {
            Vector3::from(std::array::from_fn::<f64, 3, _>(|_| rng.random_range(-size..size)))
        };
        let moved = Se3 { r: so3::exp(&vector(&mut rng, 1.8)), p: vector(&mut rng, 2.0) };
        let mechanism = case.mechanism.relocated(&moved, &Se3::identity());
        let samples: Vec<Sample> =
            case.samples.iter().map(|s| case.with_pose(s, moved * *s.measurement.pose().unwrap())).collect();
        let (poses, _) = predicted(&mechanism, &samples, &case.fresh);
        let poses: Vec<Se3> = poses.into_iter().map(|pose| moved.inverse() * pose).collect();
        assert_same(&case, "{S} moved", &poses);
    }
}

/// Base and tool free: the data say where they are, whatever the drawing says. (Of an arm that turns about one
/// direction only, poses do not place both.)
#[test]
fn with_base_and_tool_anywhere() {
    for path in [golden("serial-6r", "problem.json"), file("problems/serial-kuka-lbr.json")] {
        let mut case = Case::new(&path);
        let free = Tolerance { angle: Prior::Free, length: Prior::Free };
        let links = &mut case.mechanism.limbs[0].links;
        let last = links.len() - 1;
        (links[0].tolerance, links[last].tolerance) = (free, free);
        let base = Se3 { r: so3::exp(&Vector3::new(1.0, -1.5, 0.7)), p: Vector3::new(3.0, -2.0, 0.5) };
        let tool = Se3 { r: so3::exp(&Vector3::new(0.3, 2.0, -1.0)), p: Vector3::new(0.1, 0.0, 0.2) };
        let moved = |s: &Sample| case.with_pose(s, base * *s.measurement.pose().unwrap() * tool);
        // Noise is that of the tool point, which has moved: both sides are measured at the new one.
        let here = |s: &Sample| case.with_pose(s, *s.measurement.pose().unwrap() * tool);
        let (samples, at): (Vec<Sample>, Vec<Sample>) =
            case.samples.iter().map(|s| (moved(s), here(s))).unzip();
        let (poses, _) = predicted(&case.mechanism, &samples, &case.fresh);
        case.samples = at;
        let poses: Vec<Se3> = poses.into_iter().map(|pose| base.inverse() * pose).collect();
        assert_same(&case, "base and tool anywhere", &poses);
    }
}

#[test]
fn with_limbs_in_another_order() {
    let mut rng = ChaCha8Rng::seed_from_u64(42);
    for case in cases().into_iter().filter(|case| case.mechanism.limbs.len() > 1) {
        let mut order: Vec<usize> = (0..case.mechanism.limbs.len()).collect();
        // The tool is then that of another limb.
        while order[0] == 0 {
            order.shuffle(&mut rng);
        }
        let counts: Vec<usize> =
            case.mechanism.limbs.iter().map(|limb| limb.joints.len() - limb.passive_count()).collect();
        let reorder = |q: &[f64]| -> Vec<f64> {
            let first = |limb: usize| counts[..limb].iter().sum::<usize>();
            order.iter().flat_map(|&limb| q[first(limb)..first(limb) + counts[limb]].to_vec()).collect()
        };
        let limbs = order.iter().map(|&limb| case.mechanism.limbs[limb].clone()).collect();
        let samples: Vec<Sample> =
            case.samples.iter().map(|s| Sample { actuators: reorder(&s.actuators), ..s.clone() }).collect();
        let fresh: Vec<Vec<f64>> = case.fresh.iter().map(|q| reorder(q)).collect();
        let (poses, _) =
            predicted(&Mechanism { limbs, instrument: Vec::new(), ends: Ends::default() }, &samples, &fresh);
        assert_same(&case, "limbs reordered", &poses);
    }
}

/// Axes turned round, each with its reading, and of any length.
#[test]
fn with_axes_flipped_and_scaled() {
    let mut rng = ChaCha8Rng::seed_from_u64(43);
    for case in cases() {
        let mut value: Value = serde_json::from_slice(&case.text).unwrap();
        let mut flipped = Vec::new();
        for limb in value["mechanism"]["limbs"].as_array_mut().unwrap() {
            for joint in limb["joints"].as_array_mut().unwrap() {
                // Both axes of a cylindrical joint are one, of which only its slide is actuated.
                let mut turn = |axis: &mut Value| {
                    let sign = if rng.random_bool(0.5) { -1.0 } else { 1.0 };
                    let scale = sign * rng.random_range(0.1..10.0);
                    axis.as_array_mut()
                        .unwrap()
                        .iter_mut()
                        .for_each(|v| *v = json!(scale * v.as_f64().unwrap()));
                    sign
                };
                let signs: Vec<f64> = match joint.get_mut("axis") {
                    Some(axis) => vec![turn(axis)],
                    None => joint["axes"].as_array_mut().unwrap().iter_mut().map(&mut turn).collect(),
                };
                match &joint["actuated"] {
                    Value::Bool(true) => flipped.extend(signs),
                    Value::Array(list) => {
                        let active =
                            list.iter().zip(signs.iter().cycle()).filter(|(a, _)| a == &&json!(true));
                        flipped.extend(active.map(|(_, sign)| *sign));
                    }
                    _ => {}
                }
                // Ranges are for simulation, and homes here are zero.
                joint.as_object_mut().unwrap().remove("range");
                assert!(joint.get("home").is_none_or(|home| home.as_f64() == Some(0.0)));
            }
        }
        assert_eq!(flipped.len(), case.mechanism.actuator_count());
        let turn = |q: &[f64]| -> Vec<f64> { q.iter().zip(&flipped).map(|(q, sign)| q * sign).collect() };
        value.as_object_mut().unwrap().remove("truth");
        let mechanism = parse(value.to_string().as_bytes()).mechanism;
        let samples: Vec<Sample> =
            case.samples.iter().map(|s| Sample { actuators: turn(&s.actuators), ..s.clone() }).collect();
        let fresh: Vec<Vec<f64>> = case.fresh.iter().map(|q| turn(q)).collect();
        let (poses, _) = predicted(&mechanism, &samples, &fresh);
        assert_same(&case, "axes flipped and scaled", &poses);
    }
}

#[test]
fn with_frames_turned_about_their_axes() {
    let mut rng = ChaCha8Rng::seed_from_u64(44);
    for case in cases() {
        let mut mechanism = case.mechanism.clone();
        for limb in &mut mechanism.limbs {
            for (j, joint) in limb.joints.iter_mut().enumerate() {
                let z = Vector3::new(0.0, 0.0, rng.random_range(-3.0..3.0));
                let turn = Se3 { r: so3::exp(&z), p: Vector3::zeros() };
                joint.frame = joint.frame * turn;
                limb.links[j].nominal = limb.links[j].nominal * turn;
                limb.links[j + 1].nominal = turn.inverse() * limb.links[j + 1].nominal;
            }
        }
        let (poses, _) = predicted(&mechanism, &case.samples, &case.fresh);
        assert_same(&case, "frames turned", &poses);
    }
}
