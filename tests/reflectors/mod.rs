//! Three reflectors on a hexapod, whose postures have a common error.

use crate::support::{file, json as read};
use gough::calibration::Sample;
use gough::files::problem::{DataPlaces, ProblemFile, parse_problem};
use gough::model::Mechanism;
use gough::simulate::{Plan, simulate_sets};
use serde_json::{Value, json};
use std::path::Path;

/// What is common to the readings of a posture, m.
pub const COMMON: f64 = 60e-6;

pub fn smr() -> std::path::PathBuf {
    file("tests/data/cases/postures/m_smr_common.json")
}

/// Three known reflectors on a hexapod whose ends stand as drawn, 15 um each and `common` (mm) for a posture.
pub fn three_reflectors(common: Option<f64>) -> Value {
    let mut value = read(&smr());
    for limb in value["mechanism"]["limbs"].as_array_mut().unwrap() {
        for part in limb["joints"].as_array_mut().unwrap() {
            part.as_object_mut().unwrap().retain(|key, value| key != "tolerance" || value != "free");
        }
        limb.as_object_mut().unwrap().retain(|key, value| key != "tool_tolerance" || value != "free");
    }
    let data = value["data"].as_object_mut().unwrap();
    data.remove("file");
    data.remove("columns");
    for target in data["instrument"]["targets"].as_object_mut().unwrap().values_mut() {
        target.as_object_mut().unwrap().remove("tolerance");
    }
    if let Some(common) = common {
        data.insert("posture_noise".into(), json!({ "length": common }));
    }
    value
}

pub fn parsed(value: &Value) -> ProblemFile {
    let places = DataPlaces { data_dir: None, shared: "none".into() };
    parse_problem(Path::new("p.json"), value.to_string().as_bytes(), &places).unwrap()
}

/// Machine and samples of `postures` postures, three each; what is common is drawn with its size (m).
pub fn drawn(postures: usize, common: f64, seed: u64, noise: f64) -> (Mechanism, Vec<Sample>) {
    let problem = parsed(&three_reflectors(Some(common * 1e3)));
    let blanks = vec![problem.data.blanks.iter().map(|blank| blank.measurement.clone()).collect()];
    let plan = Plan { poses: 0, holdout: 0, seed, noise, distance: 1.0 };
    let (_, sets) = simulate_sets(&problem.mechanism, &blanks, &[postures], &plan).unwrap();
    let samples = sets[0].samples.iter().enumerate();
    let samples = samples.map(|(k, (actuators, measurement))| Sample {
        name: format!("sample {}", k + 1),
        actuators: actuators.clone(),
        measurement: measurement.clone(),
    });
    (problem.mechanism, samples.collect())
}
