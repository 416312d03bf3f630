//! What data mean once they are read, and results as files.

mod spoiled;

use gough::files::UncertaintyDrawing;
use gough::files::elsewhere::ElsewhereEntry;
use gough::files::noise::{NoiseDrawing, PostureNoiseEntry, assumed_noise};
use gough::files::problem::{PROBLEM_FORMAT, ProblemDrawing, parse_model, parse_problem};
use gough::files::result::RESULT_FORMAT;
use gough::files::summary::{
    BeforeAfter, CauseEntry, ChiSquare, Counts, Deviation, EstimateEntry, GroupEntry, LinkResult,
    MountResult, PoseErrors, SourceEntry, ToleranceFactor, TraceEntry,
};
use gough::files::{DataDrawing, ProblemFile, ResultFile, SampleDrawing, Units, json, read_problem, redraw};
use gough::lie::{Se3, so3};
use gough::measure::{Evaluation, View};
use nalgebra::Vector3;
use serde_json::{Value, json};
use spoiled::{assert_message, hexapod, places};
use std::collections::BTreeMap;
use std::path::Path;

fn problem(value: &Value) -> ProblemFile {
    parse_problem(Path::new("m.json"), value.to_string().as_bytes(), &places()).unwrap()
}

/// Whitened residuals of sample `i` at a tool pose.
fn residuals(problem: &ProblemFile, i: usize, tool: &Se3) -> Vec<f64> {
    let measurement = &problem.data.samples[i].measurement;
    let mut out = Evaluation::default();
    measurement.evaluate(&View::of_tool(tool), &mut out);
    assert_eq!(out.rows.len(), measurement.rows());
    out.rows.iter().map(|row| row.r).collect()
}

fn assert_near(found: &[f64], wanted: &[f64]) {
    assert_eq!(found.len(), wanted.len());
    for (a, b) in found.iter().zip(wanted) {
        assert!((a - b).abs() <= 1e-9 * b.abs().max(1.0), "{found:?} {wanted:?}");
    }
}

#[test]
fn noise_is_that_of_the_sample_then_of_the_data_in_units_of_the_file() {
    let mut value = hexapod();
    value["units"] = json!({"length": "mm", "angle": "deg"});
    value["data"]["noise"] = json!({"angle": 0.1, "length": 2});
    let mut covariance = vec![vec![0.0; 6]; 6];
    for (i, row) in covariance.iter_mut().enumerate() {
        row[i] = if i < 3 { 0.04 } else { 9.0 };
    }
    (covariance[0][3], covariance[3][0]) = (0.3, 0.3);
    value["data"]["samples"][1]["covariance"] = json!(covariance);
    let read = problem(&value);
    assert!(read.data.has_noise());
    let tool = Se3 {
        r: so3::exp(&Vector3::new(0.2_f64.to_radians(), 0.0, 0.0)),
        p: Vector3::new(0.0, 0.006, 0.9e-3),
    };
    assert_near(&residuals(&read, 0, &tool), &[2.0, 0.0, 0.0, 0.0, 3.0, 0.0]);
    // Correlation 0.5: the fourth residual is that of the position given the rotation, (0 - 0.5) / sqrt(0.75).
    assert_near(&residuals(&read, 1, &tool), &[1.0, 0.0, 0.0, -0.5 / 0.75_f64.sqrt(), 2.0, 0.0]);
}

#[test]
fn data_without_noise_are_weighted_by_the_size_of_the_machine() {
    let mut value = hexapod();
    value["data"].as_object_mut().unwrap().remove("noise");
    let read = problem(&value);
    assert!(read.data.noise.is_none() && !read.data.has_noise());
    let tool = Se3 { p: Vector3::new(1e-3, 0.0, 0.9), ..Se3::identity() };
    let length = assumed_noise(&read.mechanism)[(3, 3)].sqrt();
    assert_near(&residuals(&read, 0, &tool), &[0.0, 0.0, 0.0, 1e-3 / length, 0.0, 0.0]);
    let again = read.data.weighted(&(assumed_noise(&read.mechanism) * 4.0)).unwrap();
    let mut out = Evaluation::default();
    again[0].measurement.evaluate(&View::of_tool(&tool), &mut out);
    assert_near(&[out.rows[3].r], &[0.5e-3 / length]);
}

#[test]
fn positions_alone_need_no_rotation_and_no_noise_of_it() {
    let mut value = hexapod();
    value["data"] = json!({"kind": "position", "noise": {"length": 1e-5}, "samples": [
        {"actuators": [0, 0, 0, 0, 0, 0], "pose": {"position": [0, 0, 0.9]}},
        {"actuators": [0, 0, 0, 0, 0, 0], "pose": {"position": [null, 0, 0.9]}}]});
    let read = problem(&value);
    let rows: Vec<usize> = read.data.samples.iter().map(|sample| sample.measurement.rows()).collect();
    assert_eq!(rows, [3, 2]);
    assert!(read.data.samples.iter().all(|sample| sample.measurement.pose().is_none()));
}

#[test]
fn every_problem_of_the_collection_is_read() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("problems");
    let mut count = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "json") {
            let read = read_problem(&path, &places()).unwrap();
            read.require_tolerances().unwrap();
            assert_eq!(Some(read.name.as_str()), path.file_stem().and_then(|stem| stem.to_str()));
            count += 1;
        }
    }
    assert!(count >= 20);
}

/// A problem as a simulation writes it: data inline, hold-out and truth, in the units of the problem.
#[test]
fn a_problem_can_be_written_with_data_and_truth() {
    for path in ["problems/hexapod-640.json", "problems/serial-scara-screw.json"] {
        let read = read_problem(&Path::new(env!("CARGO_MANIFEST_DIR")).join(path), &places()).unwrap();
        let variables: Vec<f64> = (0..read.mechanism.actuator_count()).map(|i| 0.01 * i as f64).collect();
        let pose = Se3 { r: so3::exp(&Vector3::new(3.0, 0.2, 0.1)), p: Vector3::new(0.1, -0.2, 0.3) };
        let sample = SampleDrawing::of(&read.mechanism, read.units, &variables, &pose);
        let holdout = DataDrawing { samples: Some(vec![sample.clone()]), ..DataDrawing::default() };
        let d = vec![1e-3; read.mechanism.component_count()];
        let drawing = ProblemDrawing {
            data: Some(DataDrawing {
                samples: Some(vec![sample; 2]),
                holdout: Some(Box::new(holdout)),
                origin: Some("test".into()),
                ..read.drawing.data.clone().unwrap()
            }),
            truth: Some(redraw(&read.mechanism, &read.mechanism.deviated(&d), read.units).without_priors()),
            ..read.drawing.clone()
        };
        let again = parse_problem(Path::new("s.json"), &json::text(&drawing).unwrap(), &places()).unwrap();
        assert_eq!((again.data.samples.len(), again.holdout.samples.len()), (2, 1));
        assert_eq!(again.data.origin.as_deref(), Some("test"));
        assert_eq!(again.holdout.noise, read.data.noise);
        assert_near(&again.holdout.samples[0].actuators, &variables);
        assert!((again.data.measured[1].pose.p - pose.p).norm() < 1e-15);
        assert!((again.data.measured[1].pose.r - pose.r).norm() < 1e-14);
        let (a, b) = (again.truth.unwrap(), read.mechanism.deviated(&d));
        let tool = |links: Vec<Se3>| links.into_iter().fold(Se3::identity(), |g, link| g * link);
        let (a, b) = (tool(a.nominal().limbs[0].clone()), tool(b.limbs[0].clone()));
        assert!((a.p - b.p).norm() < 1e-12 && (a.r - b.r).norm() < 1e-12);
    }
}

fn result(read: &ProblemFile) -> ResultFile {
    let errors = PoseErrors { position_rms: Some(1e-3), position_max: Some(2e-3), ..PoseErrors::default() };
    let fit = BeforeAfter { before: errors.in_units(read.units), after: errors };
    let d = [0.1, 0.2, 0.3, 1.0 / 3.0, -1e-17, 5e-324];
    let geometry = read.mechanism.deviated(&vec![1e-3; read.mechanism.component_count()]);
    ResultFile {
        format: RESULT_FORMAT.into(),
        problem: read.name.clone(),
        source: Some(SourceEntry { problem_file: "p.json".into(), holdout: Some(0.25), seed: Some(7) }),
        solver: "minimal".into(),
        settings: BTreeMap::new(),
        converged: false,
        reason: "diverged".into(),
        iterations: 1,
        units: read.units,
        postures: Some(3),
        samples: Some(4),
        counts: Counts { structural: 138, first_order: 66, practical: 66 },
        fit: Some(fit),
        holdout: None,
        cross_validation: None,
        chi_square: Some(ChiSquare {
            value: 12.5,
            degrees_of_freedom: 6.0,
            probability: Some(0.05),
            verdict: Some("the stated noise explains the residual".into()),
            birge_ratio: Some(1.5),
            groups: vec![GroupEntry { name: "the angles".into(), value: 6.5, degrees_of_freedom: 3.0 }],
            causes: vec![CauseEntry { kind: "noise".into(), text: "two times".into() }],
            holdout: Some(GroupEntry { name: "hold-out".into(), value: 5.5, degrees_of_freedom: 6.0 }),
        }),
        tolerance_factor: Some(ToleranceFactor {
            value: 3.0,
            interval: [2.5, 3.6],
            probability: 1e-9,
            directions: 40,
            in_force: 3.0,
            verdict: "larger".into(),
        }),
        posture_noise_estimate: Some(PostureNoiseEntry {
            angle: None,
            length: Some(0.06),
            probability: 1e-9,
        }),
        noise_estimate: Some(NoiseDrawing { angle: Some(1e-5), length: Some(1e-6), covariance: None }),
        warnings: vec!["one".into()],
        holdout_set_aside: Vec::new(),
        set_aside: Vec::new(),
        unused: Vec::new(),
        measured_elsewhere: Some(ElsewhereEntry { samples: 1, of: 3 }),
        active_bounds: Vec::new(),
        kkt: None,
        estimate: Some(EstimateEntry::Split(1.0)),
        weights: Vec::new(),
        singular_values: vec![2.0, 1.0],
        trace: vec![TraceEntry { cost: f64::INFINITY, step: 3.0, kept: Some(2) }],
        instrument: Vec::new(),
        placement: Some(MountResult {
            position: [1.0 / 3.0, 2.0, -1e-17],
            rotation: [0.1, 0.2, 0.3],
            std: Some(Deviation::of(&d, Units::SI)),
        }),
        tool_mounting: Some(MountResult { position: [0.0; 3], rotation: [0.0; 3], std: None }),
        links: vec![LinkResult {
            limb: "limb1".into(),
            link: "ball.2".into(),
            deviation: Deviation::of(&d, Units::SI),
            beside: Some(Deviation::of(&d, Units::SI)),
            beside_std: None,
            std: None,
            scaled_std: Some(Deviation { rotation: [1e-3, 2e-3, 4e-3], translation: [0.5, 0.25, 0.125] }),
            prior_share: Some(Deviation { rotation: [0.0, 0.5, 1.0], translation: [0.25, 1e-3, 0.125] }),
        }],
        mechanism: redraw(&read.mechanism, &geometry, read.units),
        uncertainty: Some(UncertaintyDrawing {
            prior_share: vec![0.5],
            root: vec![vec![0.25; read.mechanism.component_count()]],
        }),
        versions: [("gough".to_owned(), "0.1.0".to_owned())].into(),
    }
}

#[test]
fn results_are_models_and_keep_every_digit() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("problems/hexapod-640.json");
    let read = read_problem(&path, &places()).unwrap();
    let written = result(&read);
    let text = json::text(&written).unwrap();
    let value: Value = serde_json::from_slice(&text).unwrap();
    assert_eq!((&value["holdout"], &value["trace"][0]["cost"]), (&Value::Null, &Value::Null));
    assert_eq!(value["fit"]["before"]["position_rms"], json!(1.0));
    let again: ResultFile = json::parse("r.json", &text).unwrap();
    assert!(again.trace[0].cost.is_nan());
    assert_eq!(again.links, written.links);
    assert_eq!((again.source, again.estimate), (written.source, written.estimate));
    assert_eq!(again.mechanism, written.mechanism);
    let model = parse_model(Path::new("r.json"), &text).unwrap();
    let stated = model.uncertainty.clone().unwrap();
    assert_eq!((stated.prior_share[0], stated.root[0][3]), (0.5, 2.5e-4));
    assert!((stated.root[0][0] - 0.25f64.to_radians()).abs() < 1e-15);
    assert_eq!(model.mechanism.actuator_names(), read.mechanism.actuator_names());
    assert_eq!((model.name, model.units), (read.name, read.units));
    let as_problem = parse_problem(Path::new("r.json"), &text, &places()).unwrap_err().to_string();
    assert_message(&as_problem, &["r.json: format", "gough-result/1", PROBLEM_FORMAT]);
}
