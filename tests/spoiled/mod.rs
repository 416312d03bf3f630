//! A machine to spoil, and what a message must be.

use gough::files::DataPlaces;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// Folders that do not exist.
pub fn places() -> DataPlaces {
    DataPlaces { data_dir: Some("elsewhere".into()), shared: "shared".into() }
}

fn read(path: &str) -> Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// A hexapod with two samples; its limbs' joints are base, leg and ball.
pub fn hexapod() -> Value {
    let mut value = read("problems/hexapod-6ups.json");
    let sample = json!({"actuators": [0, 0, 0, 0, 0, 0],
                        "pose": {"position": [0, 0, 0.9], "rotation": [0, 0, 0]}});
    value["data"] = json!({"noise": {"angle": 2e-5, "length": 1e-5}, "samples": [sample, sample]});
    value
}

/// One line, not too long, that holds all parts.
#[track_caller]
pub fn assert_message(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "{part:?} is not in {message:?}");
    }
    assert!(message.lines().count() == 1 && message.len() < 600, "{message:?}");
}
