//! Machines whose base and tool nobody measured.

mod support;

use serde_json::json;
use support::{file, gough, json, write};

/// All rotations of a SCARA share one axis: both ends are placed all the same, and the errors are those of the noise.
#[test]
fn both_ends_of_a_scara_are_placed() {
    let folder = tempfile::tempdir().unwrap();
    let mut problem = json(&file("problems/serial-scara.json"));
    problem["mechanism"]["tool_tolerance"] = json!("free");
    problem["mechanism"]["limbs"][0]["joints"][0]["tolerance"] = json!("free");
    // The drawing's tool is far from the one that was measured, and turned about another direction.
    problem["mechanism"]["tool"] = json!({"position": [650.0, 40.0, 300.0], "rotation": [90.0, 0.0, 0.0]});
    let (problem, out) = (write(folder.path(), "free.json", &problem), folder.path().join("result.json"));
    let ran = gough("identify {0} -o {1}", &[&problem, &out]);
    assert!(ran.status == 0, "{ran:?}");
    let holdout = json(&out)["holdout"]["after"]["weighted_rms"].as_f64().unwrap();
    assert!(holdout < 1.0, "{holdout}");
}
