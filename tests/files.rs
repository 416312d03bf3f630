//! Files: what is written is what is read, in whatever units.

use gough::files::json;
use gough::files::problem::{parse_model, parse_problem};
use gough::files::{
    DataPlaces, FileError, Model, PosesFormat, ProblemFile, Units, poses_text, read_actuators, read_model,
    read_problem, redraw,
};
use gough::lie::{Se3, so3};
use gough::model::inverse::close_from_home;
use gough::model::mechanism::pose_difference;
use gough::model::{Geometry, Mechanism, Posture};
use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

const GOLDEN: [&str; 4] = ["hexapod-6ups", "hexapod-6pus", "serial-6r", "tripod-3rps"];

fn golden(case: &str, file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/golden").join(case).join(file)
}

fn places() -> DataPlaces {
    DataPlaces { data_dir: None, shared: "no such folder".into() }
}

fn problem(value: &Value) -> Result<ProblemFile, FileError> {
    parse_problem(Path::new("machine.json"), value.to_string().as_bytes(), &places())
}

fn model(value: &Value) -> Model {
    parse_model(Path::new("machine.json"), value.to_string().as_bytes()).unwrap()
}

/// Pose of the machine with the given links at joint variables `actuators`, followed from home.
fn predict(mechanism: &Mechanism, geometry: &Geometry, actuators: &[f64]) -> Se3 {
    let passive: usize = mechanism.limbs.iter().map(|limb| limb.passive_count()).sum();
    let mut posture = Posture::new(mechanism);
    posture.set_joints(mechanism, &vec![0.0; actuators.len()], &vec![0.0; passive]);
    posture.close(mechanism, geometry).unwrap();
    close_from_home(mechanism, geometry, &mut posture, actuators).unwrap();
    posture.tool()
}

fn assert_near(a: &Se3, b: &Se3, limit: f64, what: &str) {
    let (w, v) = pose_difference(a, b);
    assert!(w.norm() <= limit && v.norm() <= limit, "{what}: {:.1e} rad, {:.1e} m", w.norm(), v.norm());
}

#[test]
fn truth_of_golden_cases_predicts_their_hold_out() {
    for case in GOLDEN {
        let model = read_model(&golden(case, "truth.json")).unwrap();
        let rows = read_actuators(&golden(case, "holdout.json"), &model).unwrap();
        // The same file, as data of a problem.
        let text = std::fs::read_to_string(golden(case, "holdout.json")).unwrap();
        let mut value: Value =
            serde_json::from_str(&std::fs::read_to_string(golden(case, "truth.json")).unwrap()).unwrap();
        value["data"] = serde_json::from_str(&text).unwrap();
        let measured = problem(&value).unwrap().data;
        assert_eq!(rows.len(), 30);
        for (i, (row, measured)) in rows.iter().zip(&measured.measured).enumerate() {
            let pose = predict(&model.mechanism, &model.mechanism.nominal(), &row.variables);
            assert_near(&pose, &measured.pose, 1e-9, &format!("{case} {}", row.name));
            assert_eq!(measured_name(i), row.name);
        }
    }
}

fn measured_name(i: usize) -> String {
    format!("sample {}", i + 1)
}

#[test]
fn golden_problems_are_read() {
    for case in GOLDEN {
        let problem = read_problem(&golden(case, "problem.json"), &places()).unwrap();
        assert_eq!(problem.name, case);
        assert_eq!(problem.data.samples.len(), problem.data.measured.len());
        assert!(problem.data.samples.len() >= 40 && problem.data.has_noise());
        assert!(problem.holdout.is_empty() && problem.truth.is_none());
        problem.require_tolerances().unwrap();
        problem.require_samples().unwrap();
        let truth = read_problem(&golden(case, "truth.json"), &places()).unwrap();
        let error = truth.require_tolerances().unwrap_err().to_string();
        assert!(error.contains("mechanism.limbs[0].joints[0] (limb1.q1): no tolerance"), "{error}");
        assert!(truth.require_samples().is_err());
    }
    let hexapod = read_problem(&golden("hexapod-6ups", "problem.json"), &places()).unwrap().mechanism;
    let names: Vec<&str> = hexapod.limbs[2].links.iter().map(|link| link.name.as_str()).collect();
    assert_eq!(names, ["j1.1", "j1.2", "j2", "j3.1", "j3.2", "j3.3", "tool"]);
    assert_eq!(hexapod.actuator_names()[2], "limb3.j2");
}

/// A machine with every joint type, every place of a tolerance, readings that are not zero at home.
fn everything() -> Value {
    json!({
        "format": "gough-problem/1", "name": "everything", "units": {"length": "m", "angle": "rad"},
        "mechanism": {
            "tool": {"position": [0.3, 0.1, 1.2], "rotation": [0.1, -0.2, 3.0]},
            "tolerance": {"angle": 0.001, "length": 0.0005},
            "tool_tolerance": "free", "tool_bounds": {"angle": 0.5},
            "limbs": [{"name": "arm", "bounds": {"angle": 0.01, "length": 0.002}, "joints": [
                {"name": "turn", "type": "cylindrical", "point": [0.1, 0.2, 0.0], "axis": [0, 0.1, 2],
                 "actuated": true, "home": [0.3, -0.2], "range": [[-1.0, 1.5], null],
                 "tolerance": {"angle": "free", "length": 0.01}, "inner_tolerance": {"angle": 0, "length": 0}},
                {"type": "helical", "point": [0.1, 0.2, 0.5], "axis": [1, 0, 0], "pitch": 0.02,
                 "actuated": true, "home": 0.7, "range": [-9, 9], "bounds": {"length": 0.001}},
                {"type": "universal", "point": [0.2, 0.0, 0.7], "axes": [[1, 1, 0], [0, 3, 1]],
                 "actuated": [true, true]},
                {"type": "spherical", "point": [0.25, 0.05, 0.9], "axes": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
                 "actuated": true, "inner_bounds": {"angle": 0.003}},
                {"type": "planar", "point": [0.3, 0.1, 1.0], "axes": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
                 "actuated": true, "home": [0.1, 0.2, 0.3]},
                {"type": "prismatic", "point": [0.3, 0.1, 1.0], "axis": [0, -1, 5], "actuated": true},
                {"type": "revolute", "point": [0.3, 0.1, 1.1], "axis": [0, 1, 0], "actuated": true}]}]}})
}

/// The same file in mm and degrees: lengths and angles are told apart by where they stand.
fn in_millimetres_and_degrees(value: &Value) -> Value {
    fn scale(value: &Value, factor: f64) -> Value {
        match value {
            Value::Number(n) => json!(n.as_f64().unwrap() * factor),
            Value::Array(list) => list.iter().map(|v| scale(v, factor)).collect(),
            other => other.clone(),
        }
    }
    fn walk(value: &Value, kinds: &[bool]) -> Value {
        let degrees = 180.0 / std::f64::consts::PI;
        let factor = |angular: bool| if angular { degrees } else { 1000.0 };
        match value {
            Value::Object(map) => {
                let angular: Vec<bool> = match map.get("type").and_then(Value::as_str) {
                    Some("prismatic") => vec![false],
                    Some("cylindrical") => vec![true, false],
                    Some("planar") => vec![false, false, true],
                    Some(_) => vec![true; 3],
                    None => kinds.to_vec(),
                };
                let entries = map.iter().map(|(key, v)| {
                    let v = match (key.as_str(), v) {
                        ("position" | "point" | "length" | "pitch", v) => scale(v, 1000.0),
                        ("rotation" | "angle", v) => scale(v, degrees),
                        ("home" | "range" | "actuators", Value::Array(list))
                            if !(key == "range" && list[0].is_number()) =>
                        {
                            list.iter().zip(&angular).map(|(v, a)| scale(v, factor(*a))).collect()
                        }
                        ("home" | "range", v) => scale(v, factor(angular[0])),
                        ("units", _) => json!({"length": "mm", "angle": "deg"}),
                        _ => walk(v, &angular),
                    };
                    (key.clone(), v)
                });
                Value::Object(entries.collect())
            }
            Value::Array(list) => list.iter().map(|v| walk(v, kinds)).collect(),
            other => other.clone(),
        }
    }
    walk(value, &[])
}

#[test]
fn units_do_not_change_the_machine() {
    let near = |a: f64, b: f64, what: &str| {
        assert!((a - b).abs() <= 1e-15 * a.abs().max(1.0), "{what}: {a} {b}");
    };
    let value = everything();
    let (si, mm) = (model(&value).mechanism, model(&in_millimetres_and_degrees(&value)).mechanism);
    for (a, b) in si.limbs[0].links.iter().zip(&mm.limbs[0].links) {
        let pairs = a.nominal.r.iter().chain(&a.nominal.p).zip(b.nominal.r.iter().chain(&b.nominal.p));
        pairs.for_each(|(x, y)| near(*x, *y, &a.name));
        let numbers = |link: &gough::model::Link| {
            let sigma = |prior| match prior {
                gough::model::Prior::Held => 0.0,
                gough::model::Prior::Sigma(sigma) => sigma,
                gough::model::Prior::Free => -1.0,
            };
            let (angle, length) = link.bounds.unwrap_or((9.0, 9.0));
            [sigma(link.tolerance.angle), sigma(link.tolerance.length), angle.min(8.0), length.min(8.0)]
        };
        numbers(a).iter().zip(numbers(b)).for_each(|(x, y)| near(*x, y, &a.name));
    }
    for (a, b) in si.limbs[0].joints.iter().zip(&mm.limbs[0].joints) {
        near(a.home, b.home, &a.name);
        let ((a0, a1), (b0, b1)) = (a.range.unwrap_or_default(), b.range.unwrap_or_default());
        near(a0, b0, &a.name);
        near(a1 / 9.0, b1 / 9.0, &a.name);
    }
}

#[test]
fn tolerances_and_bounds_govern_the_links_that_the_contract_says() {
    use gough::model::Prior::{Free, Held, Sigma};
    let mechanism = model(&everything()).mechanism;
    let links = &mechanism.limbs[0].links;
    let of = |name: &str| links.iter().find(|link| link.name == name).unwrap();
    let priors = |name: &str| (of(name).tolerance.angle, of(name).tolerance.length);
    let infinity = f64::INFINITY;
    assert_eq!(priors("turn.1"), (Free, Sigma(0.01)));
    assert_eq!(priors("turn.2"), (Held, Held));
    assert_eq!(priors("j3.2"), (Sigma(0.001), Sigma(0.0005)));
    assert_eq!(priors("tool"), (Free, Free));
    assert_eq!(of("turn.2").bounds, Some((0.01, 0.002)));
    assert_eq!(of("j2").bounds, Some((infinity, 0.001)));
    assert_eq!(of("j4.1").bounds, Some((0.01, 0.002)));
    assert_eq!(of("j4.3").bounds, Some((0.003, infinity)));
    assert_eq!(of("tool").bounds, Some((0.5, infinity)));
    let joints = &mechanism.limbs[0].joints;
    assert_eq!((joints[0].range, joints[1].range), (Some((-1.0, 1.5)), None));
    assert_eq!((joints[0].home, joints[1].home, joints[2].home), (0.3, -0.2, 0.7));
}

#[test]
fn redrawn_machines_predict_the_same_poses() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut machines = vec![("everything", model(&everything()).mechanism, 1.0)];
    for case in GOLDEN {
        machines.push((case, read_model(&golden(case, "problem.json")).unwrap().mechanism, 0.05));
    }
    for units in ["m rad", "mm deg"] {
        let units = if units == "m rad" { Units::SI } else { millimetres() };
        for (name, mechanism, reach) in &machines {
            let sizes = 0.002;
            let d: Vec<f64> =
                (0..mechanism.component_count()).map(|_| rng.random_range(-sizes..sizes)).collect();
            let geometry = mechanism.deviated(&d);
            let file = json!({"format": "gough-problem/1", "units": units,
                              "mechanism": redraw(mechanism, &geometry, units)});
            let again = model(&file).mechanism;
            assert_eq!(again.actuator_names(), mechanism.actuator_names());
            for (a, b) in again.limbs.iter().zip(&mechanism.limbs) {
                for (a, b) in a.links.iter().zip(&b.links) {
                    assert_eq!(a.name, b.name);
                    assert_eq!(
                        format!("{:.9?} {:.9?}", a.tolerance, a.bounds),
                        format!("{:.9?} {:.9?}", b.tolerance, b.bounds)
                    );
                }
                for (a, b) in a.joints.iter().zip(&b.joints) {
                    assert_eq!(
                        format!("{:.9?} {:.9?}", a.range, a.home),
                        format!("{:.9?} {:.9?}", b.range, b.home)
                    );
                }
            }
            for _ in 0..5 {
                let actuators: Vec<f64> =
                    (0..mechanism.actuator_count()).map(|_| rng.random_range(-reach..*reach)).collect();
                let (before, after) = (
                    predict(mechanism, &geometry, &actuators),
                    predict(&again, &again.nominal(), &actuators),
                );
                assert_near(&before, &after, 1e-12, name);
            }
        }
    }
}

fn millimetres() -> Units {
    serde_json::from_value(json!({"length": "mm", "angle": "deg"})).unwrap()
}

#[test]
fn quaternions_and_rotation_vectors_mean_the_same() {
    let w: Vector3<f64> = Vector3::new(0.4, -1.1, 0.3);
    let half: Vector3<f64> = w * (0.5_f64 * w.norm()).sin() / w.norm();
    let mut value = everything();
    value["mechanism"]["tool"] = json!({"position": [0.3, 0.1, 1.2],
        "quaternion": [(0.5 * w.norm()).cos(), half.x, half.y, half.z]});
    let tool: Se3 =
        model(&value).mechanism.limbs[0].links.iter().fold(Se3::identity(), |g, link| g * link.nominal);
    assert_near(&tool, &Se3 { r: so3::exp(&w), p: Vector3::new(0.3, 0.1, 1.2) }, 1e-14, "tool");
}

#[test]
fn problems_are_written_as_they_are_read() {
    for case in GOLDEN {
        let problem = read_problem(&golden(case, "problem.json"), &places()).unwrap();
        let text = json::text(&problem.drawing).unwrap();
        let again = parse_problem(Path::new("again.json"), &text, &places()).unwrap();
        assert_eq!(again.drawing, problem.drawing);
    }
    let value = everything();
    let read = problem(&value).unwrap();
    assert_eq!(json::text(&read.drawing).unwrap(), json::text(&problem(&value).unwrap().drawing).unwrap());
}

#[test]
fn predicted_poses_are_read_again_as_json_and_csv() {
    let folder = tempfile::tempdir().unwrap();
    let model = model(&in_millimetres_and_degrees(&everything()));
    let names = model.mechanism.actuator_names();
    let readings: Vec<f64> = (0..names.len()).map(|i| 0.1 + i as f64 / 3.0).collect();
    let pose = Se3 { r: so3::exp(&Vector3::new(0.0, 0.0, 3.1)), p: Vector3::new(1.0 / 3.0, 0.0, -2e-9) };
    for (format, file) in [(PosesFormat::Json, "poses.json"), (PosesFormat::Csv, "poses.csv")] {
        let path = folder.path().join(file);
        assert_eq!(PosesFormat::of(&path), format);
        let text = poses_text(format, &names, &[(readings.clone(), pose)], model.units).unwrap();
        std::fs::write(&path, text).unwrap();
        let rows = read_actuators(&path, &model).unwrap();
        assert_eq!(rows[0].readings, readings);
        // Readings become variables by subtracting home.
        assert!((rows[0].variables[0] - (0.1_f64.to_radians() - 0.3)).abs() < 1e-15);
    }
}
