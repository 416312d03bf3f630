//! {S} turned, and with it every frame whose x axis is chosen by rule: the same machine, the same predictions, for every
//! identifier of the registry that says so.

mod support;

use gough::calibration::Sample;
use gough::files::{DataPlaces, read_problem};
use gough::identify::identify;
use gough::lie::{Se3, so3};
use gough::measure::Pose;
use gough::model::Mechanism;
use gough::simulate::close;
use gough::solve::{Identifier, Stop, registry};
use nalgebra::Vector3;
use std::sync::Arc;
use support::{apart, file, golden};

const LATE: Stop = Stop { iterations: 400, step: 1e-13, gradient: 1e-12, cost: 1e-16 };

/// Poses at the readings of the samples, by the machine as identified; `None` where the identifier does not get there.
fn predicted(mechanism: &Mechanism, samples: &[Sample], identifier: &dyn Identifier) -> Option<Vec<Se3>> {
    let found = identify(mechanism, samples, identifier, &LATE).unwrap();
    found.report.outcome.converged().then(|| {
        let tool = |s: &Sample| close(&found.start, &found.geometry, &s.actuators).unwrap().tool();
        samples.iter().map(tool).collect()
    })
}

fn turned_about_their_axes(mut mechanism: Mechanism) -> Mechanism {
    for limb in &mut mechanism.limbs {
        for (j, joint) in limb.joints.iter_mut().enumerate() {
            let z = Vector3::new(0.0, 0.0, 1.0 + j as f64);
            let turn = Se3 { r: so3::exp(&z), p: Vector3::zeros() };
            joint.frame = joint.frame * turn;
            limb.links[j].nominal = limb.links[j].nominal * turn;
            limb.links[j + 1].nominal = turn.inverse() * limb.links[j + 1].nominal;
        }
    }
    mechanism
}

fn check(path: &std::path::Path, identifiers: Vec<(Box<dyn Identifier>, String)>) {
    let places = DataPlaces { data_dir: None, shared: "no such folder".into() };
    let problem = read_problem(path, &places).unwrap();
    let (mechanism, samples, noise) = (problem.mechanism, problem.data.samples, problem.data.noise.unwrap());
    let turn = Se3 { r: so3::exp(&Vector3::new(0.4, -1.1, 0.7)), p: Vector3::zeros() };
    let turned = turned_about_their_axes(mechanism.relocated(&turn, &Se3::identity()));
    // The same noise as it is seen from there; here it is alike in all directions.
    let there: Vec<Sample> = samples
        .iter()
        .map(|s| {
            let pose = Pose::new(turn * *s.measurement.pose().unwrap(), [true; 6], &noise).unwrap();
            Sample { measurement: Arc::new(pose), ..s.clone() }
        })
        .collect();
    let support = |g: &Se3| support::Pose { r: g.r, p: g.p };
    let most = |a: &[Se3], b: &[Se3]| {
        let pairs = a.iter().zip(b).map(|(a, b)| apart(&support(a), &support(b)));
        pairs.fold((0.0f64, 0.0f64), |m, (w, v)| (m.0.max(w), m.1.max(v)))
    };
    let nominal: Vec<Se3> = samples
        .iter()
        .map(|s| close(&mechanism, &mechanism.nominal(), &s.actuators).unwrap().tool())
        .collect();
    for (identifier, what) in identifiers {
        let here = predicted(&mechanism, &samples, identifier.as_ref());
        let again = predicted(&turned, &there, identifier.as_ref());
        let (Some(here), Some(again)) = (here, again) else {
            println!("{} {what}: does not get there", path.display());
            continue;
        };
        let back: Vec<Se3> = again.into_iter().map(|pose| turn.inverse() * pose).collect();
        let (deviation, difference) = (most(&here, &nominal), most(&here, &back));
        let parts = (difference.0 / deviation.0, difference.1 / deviation.1);
        let claims = identifier.frame_free();
        println!("{} {what}: {:.1e} and {:.1e}, claims {claims}", path.display(), parts.0, parts.1);
        assert!(!claims || (parts.0 <= 1e-7 && parts.1 <= 1e-7), "{what}: {parts:?}");
    }
}

fn all() -> Vec<(Box<dyn Identifier>, String)> {
    let mut all: Vec<(Box<dyn Identifier>, String)> = registry::all()
        .into_iter()
        .map(|it| (registry::find(it.name()).unwrap(), it.name().into()))
        .collect();
    all.extend(with_settings());
    all
}

fn with_settings() -> Vec<(Box<dyn Identifier>, String)> {
    let mut all: Vec<(Box<dyn Identifier>, String)> = Vec::new();
    for (name, settings) in [
        ("conic-bounded", &[("cone", "1.5")][..]),
        ("conic-bounded", &[("bounds", "1.2")]),
        ("conic-huber", &[("delta", "0.7")]),
        ("conic-group-lasso", &[("weight", "30")]),
    ] {
        let mut identifier = registry::find(name).unwrap();
        settings.iter().for_each(|(key, value)| identifier.set(key, value).unwrap());
        all.push((identifier, format!("{name} {settings:?}")));
    }
    all
}

#[test]
fn of_an_arm() {
    check(&golden("serial-6r", "problem.json"), all());
}

#[test]
fn of_an_arm_with_gross_errors() {
    check(&file("problems/stress/serial-puma560-outliers.json"), all());
}

#[test]
fn of_a_closed_loop() {
    let mut all = all();
    all.truncate(registry::all().len());
    check(&golden("tripod-3rps", "problem.json"), all);
}

#[test]
#[ignore = "a minute: a closed loop within limits"]
fn of_a_closed_loop_within_limits() {
    check(&golden("tripod-3rps", "problem.json"), with_settings());
}

#[test]
#[ignore = "half a minute: a hexapod under every identifier"]
fn of_a_hexapod() {
    check(&file("problems/hexapod-6ups.json"), all());
}
