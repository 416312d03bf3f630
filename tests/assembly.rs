//! Postures that do not close, or close otherwise: set aside, named, and taken back when the machine reaches them.

mod support;

use gough::calibration::Sample;
use gough::files::{DataPlaces, ProblemFile, SampleDrawing, read_problem};
use gough::identify::{identify, score};
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
use std::sync::Arc;
use support::{file, gough, json, write};

pub fn problem(name: &str) -> ProblemFile {
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
pub fn out_of_reach(problem: &ProblemFile, widen: f64, beyond: usize) -> Vec<Sample> {
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

#[test]
fn postures_out_of_the_drawings_reach_are_set_aside_and_taken_back() {
    for (name, widen) in [("tripod-3rps", 3.0), ("hexapod-squat", 2.5), ("tripod-3upu", 2.0)] {
        let problem = problem(name);
        let samples = out_of_reach(&problem, widen, 3);
        let found = identify(&problem.mechanism, &samples, &Minimal::default(), &Stop::default()).unwrap();
        let first: Vec<&str> = found.set_aside_at_start.iter().map(|s| s.name.as_str()).collect();
        let fit = score::score(&found.start, &found.geometry, &problem.holdout.samples).unwrap();
        let noise = problem.data.noise.unwrap();
        let (rotation, position) = (
            fit.rotation.unwrap().rms / noise[(0, 0)].sqrt(),
            fit.position.unwrap().rms / noise[(3, 3)].sqrt(),
        );
        eprintln!(
            "{name}: at first without {:?}, at last without {:?}; {rotation:.2} and {position:.2} of the noise",
            found.set_aside_at_start, found.set_aside
        );
        assert_eq!(first, ["sample 61", "sample 62", "sample 63"], "{name}");
        assert!(found.set_aside.is_empty(), "{name}: {:?}", found.set_aside);
        assert!(found.report.outcome.converged(), "{name}: {}", found.report.outcome);
        assert!(rotation <= 2.0 && position <= 2.0, "{name}: {rotation} {position}");
    }
}
