//! Postures that do not close, or close otherwise: set aside, named, and taken back when the machine reaches them.

mod support;

use gough::calibration::Sample;
use gough::files::{DataPlaces, ProblemFile, SampleDrawing, read_problem};
use gough::identify::{Identification, identify, measured_elsewhere, score};
use gough::lie::{Se3, so3};
use gough::measure::Pose;
use gough::model::{Mechanism, NotClosed};
use gough::simulate::close;
use gough::solve::Stop;
use gough::solve::minimal::Minimal;
use nalgebra::{Matrix6, Vector3, Vector6};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde_json::json;
use std::f64::consts::PI;
use std::sync::Arc;
use support::{file, gough, json, write};

fn problem(name: &str) -> ProblemFile {
    let path = file("problems").join(format!("{name}.json"));
    read_problem(&path, &DataPlaces { data_dir: None, shared: "no such folder".into() }).unwrap()
}

/// Readings in `widen` times the actuators' ranges.
fn draw(mechanism: &Mechanism, widen: f64, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let joints = mechanism.limbs.iter().flat_map(|limb| &limb.joints).filter(|joint| joint.actuated);
    let ranges: Vec<(f64, f64)> =
        joints.map(|j| (j.range.unwrap().0 - j.home, j.range.unwrap().1 - j.home)).collect();
    ranges.into_iter().map(|(low, high)| widen * rng.random_range(low..high)).collect()
}

fn measured(pose: &Se3, noise: &Matrix6<f64>, rng: &mut ChaCha8Rng) -> Se3 {
    let normal = Vector6::from_fn(|_, _| StandardNormal.sample(rng));
    let error: Vector6<f64> = noise.cholesky().unwrap().l() * normal;
    Se3 { r: so3::exp(&error.fixed_rows::<3>(0).into_owned()) * pose.r, p: pose.p + error.fixed_rows::<3>(3) }
}

/// A workspace inside the drawing's reach, and `beyond` postures that only the true machine closes.
fn out_of_reach(problem: &ProblemFile, widen: f64, beyond: usize) -> Vec<Sample> {
    let (drawn, truth) = (&problem.mechanism, problem.truth.as_ref().unwrap());
    let noise = problem.data.noise.unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(31);
    let mut samples: Vec<Sample> = problem.data.samples.clone();
    let (inside, mut tries) = (samples.len(), 0);
    while samples.len() < inside + beyond {
        tries += 1;
        assert!(tries < 20_000, "{}: {} found", problem.name, samples.len() - inside);
        let actuators = draw(drawn, widen, &mut rng);
        let Ok(posture) = close(truth, &truth.nominal(), &actuators) else { continue };
        if close(drawn, &drawn.nominal(), &actuators).is_ok() {
            continue;
        }
        let pose = Pose::new(measured(&posture.tool(), &noise, &mut rng), [true; 6], &noise).unwrap();
        let name = format!("sample {}", samples.len() + 1);
        samples.push(Sample { name, actuators, measurement: Arc::new(pose) });
    }
    samples
}

/// Identifies from the samples; the error on the problem's hold-out must be at most twice its noise.
fn assert_identified(problem: &ProblemFile, samples: &[Sample]) -> Identification {
    let found = identify(&problem.mechanism, samples, &Minimal::default(), &Stop::default()).unwrap();
    let fit = score::score(&found.start, &found.geometry, &problem.holdout.samples).unwrap();
    let noise = problem.data.noise.unwrap();
    let rotation = fit.rotation.unwrap().rms / noise[(0, 0)].sqrt();
    let position = fit.position.unwrap().rms / noise[(3, 3)].sqrt();
    let name = &problem.name;
    eprintln!(
        "{name}: {} set aside at first, {} at last; {rotation:.2} and {position:.2} of the noise, {} iterations",
        found.set_aside_at_start.len(),
        found.set_aside.len(),
        found.trace.len()
    );
    assert!(found.report.outcome.converged(), "{name}: {}", found.report.outcome);
    assert!(rotation <= 2.0 && position <= 2.0, "{name}: {rotation} {position}");
    found
}

#[test]
fn postures_out_of_the_drawings_reach_are_set_aside_and_taken_back() {
    for (name, widen) in [("tripod-3rps", 3.0), ("tripod-3prs", 3.0), ("hexapod-squat", 2.5)] {
        let problem = problem(name);
        let found = assert_identified(&problem, &out_of_reach(&problem, widen, 3));
        let first: Vec<&str> = found.set_aside_at_start.iter().map(|s| s.name.as_str()).collect();
        assert_eq!(first, ["sample 61", "sample 62", "sample 63"], "{name}");
        assert!(
            found.set_aside_at_start.iter().all(|s| matches!(s.reason, NotClosed::Apart { .. })),
            "{name}"
        );
        assert!(found.set_aside.is_empty(), "{name}: {:?}", found.set_aside);
    }
}

/// From the measured poses the drawing closes here too, but almost singular and centimetres off: to begin with such
/// postures led the iteration astray.
#[test]
fn postures_that_are_singular_by_the_drawing_wait() {
    let problem = problem("tripod-3upu");
    for widen in [2.0, 2.5, 3.0] {
        assert_identified(&problem, &out_of_reach(&problem, widen, 3));
    }
}

fn with_pose(sample: &Sample, turn: Vector3<f64>, mirrored: bool, noise: &Matrix6<f64>) -> Sample {
    let pose = sample.measurement.pose().unwrap();
    let z = if mirrored { -pose.p.z } else { pose.p.z };
    let wrong = Se3 { r: so3::exp(&turn) * pose.r, p: Vector3::new(pose.p.x, pose.p.y, z) };
    Sample { measurement: Arc::new(Pose::new(wrong, [true; 6], noise).unwrap()), ..sample.clone() }
}

/// A platform that lies on its back where it was measured: Newton's method comes out at another branch than it
/// started on, and the posture takes no part.
#[test]
fn another_assembly_mode_is_detected_and_named() {
    let problem = problem("hexapod-6ups");
    let noise = problem.data.noise.unwrap();
    let mut samples = problem.data.samples.clone();
    samples[6] = with_pose(&samples[6], Vector3::new(2.0 * PI / 3.0, 0.0, 0.0), false, &noise);
    let found = assert_identified(&problem, &samples);
    let left_out: Vec<_> = found.set_aside.iter().map(|s| (s.name.as_str(), &s.reason)).collect();
    assert_eq!(left_out, [("sample 7", &NotClosed::OtherMode)]);
}

/// A platform measured below its base closes there, but no path from home leads to it.
#[test]
fn a_posture_beyond_a_singularity_is_named() {
    let problem = problem("hexapod-6ups");
    let noise = problem.data.noise.unwrap();
    let mut samples = problem.data.samples.clone();
    samples[6] = with_pose(&samples[6], Vector3::zeros(), true, &noise);
    let found = identify(&problem.mechanism, &samples, &Minimal::default(), &Stop::default()).unwrap();
    let elsewhere = measured_elsewhere(&found.start, &found.geometry, &found.taking);
    assert_eq!(elsewhere.iter().map(|of| of.name.as_str()).collect::<Vec<_>>(), ["sample 7"]);
    // The platform is 0.9 m above its base, and hung as far below.
    let (_, apart) = elsewhere[0].apart.unwrap();
    assert!((1.6..2.0).contains(&apart), "{apart}");
}

#[test]
fn the_result_names_the_postures() {
    let folder = tempfile::tempdir().unwrap();
    let read = problem("tripod-3rps");
    let mut value = json(&file("problems/tripod-3rps.json"));
    let samples = value["data"]["samples"].as_array_mut().unwrap();
    for sample in &out_of_reach(&read, 3.0, 2)[60..] {
        let pose = sample.measurement.pose().unwrap();
        samples.push(json!(SampleDrawing::of(&read.mechanism, read.units, &sample.actuators, pose)));
    }
    // And one that no tripod reaches.
    let mut lost = samples[3].clone();
    lost["actuators"][0] = json!(9.0);
    samples.push(lost);
    let (problem, out) = (write(folder.path(), "wide.json", &value), folder.path().join("result.json"));
    let ran = gough("identify {0} -o {1}", &[&problem, &out]);
    assert!(ran.status == 0, "{ran:?}");
    let result = json(&out);
    for warning in [
        "1 posture took no part: sample 63",
        "2 postures that the nominal machine cannot reach were set aside at first and taken back: \
         sample 61, sample 62",
    ] {
        assert!(ran.stderr.contains(&format!("warning: {warning}\n")), "{}", ran.stderr);
        assert!(result["warnings"].as_array().unwrap().contains(&json!(warning)), "{}", result["warnings"]);
    }
    assert_eq!(result["set_aside"][0]["sample"], "sample 63");
    assert!(result["set_aside"][0]["reason"].as_str().unwrap().contains("do not meet"));
}
