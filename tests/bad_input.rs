//! Problem files that are wrong: one message that names the place, says what is wrong there and what to do.

mod spoiled;

use gough::files::problem::parse_problem;
use gough::files::{FileError, read_model};
use serde_json::{Value, json};
use spoiled::{assert_message, hexapod, places};
use std::path::Path;

fn parse(text: &[u8]) -> Result<(), FileError> {
    parse_problem(Path::new("m.json"), text, &places()).map(drop)
}

/// The message that follows from setting the value at `pointer` (removing it where `value` is null).
fn message(pointer: &str, value: Value) -> String {
    let mut problem = hexapod();
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    match problem.pointer_mut(parent).unwrap() {
        Value::Object(map) if value.is_null() => drop(map.remove(key)),
        Value::Object(map) => drop(map.insert(key.into(), value)),
        Value::Array(list) => list[key.parse::<usize>().unwrap()] = value,
        _ => panic!("{pointer} leads nowhere"),
    }
    parse(problem.to_string().as_bytes()).expect_err(pointer).to_string()
}

#[track_caller]
fn refused(pointer: &str, value: Value, parts: &[&str]) {
    let message = message(pointer, value);
    assert_message(&message, parts);
    assert!(message.starts_with("m.json"), "{message}");
}

#[test]
fn keys_and_types() {
    refused(
        "/mechanism/limbs/2/joints/0/axsi",
        json!(1),
        &["mechanism.limbs[2].joints[0].axsi (limb3.base)", "unknown field `axsi`"],
    );
    refused("/extra", json!(1), &["unknown field `extra`"]);
    refused("/data/samples/1/pose/rotatoin", json!([]), &["data.samples[1].pose.rotatoin (sample 2)"]);
    refused(
        "/mechanism/limbs/0/joints/1/point",
        json!("here"),
        &["limbs[0].joints[1].point (limb1.leg)", "string"],
    );
    refused("/mechanism/limbs/0/joints/1/point", json!([1, 2]), &["joints[1].point (limb1.leg)", "length 2"]);
    refused(
        "/mechanism/limbs/0/joints/1/point",
        Value::Null,
        &["limbs[0].joints[1] (limb1.leg)", "missing field `point`"],
    );
    refused(
        "/mechanism/limbs/0/joints/1/actuated",
        json!(1.5),
        &["joints[1].actuated (limb1.leg)", "expected a boolean"],
    );
    refused("/mechanism/limbs", Value::Null, &["mechanism: missing field `limbs`"]);
    refused("/units/length", json!("inch"), &["units.length", "unknown variant `inch`", "`m` or `mm`"]);
    refused("/units", Value::Null, &["missing field `units`"]);
    refused("/format", json!("gough-problem/2"), &["format", "gough-problem/2", "gough-problem/1"]);
    refused("/format", json!("gough-result/1"), &["gough-result/1", "expected"]);
    refused("/format", Value::Null, &["format", "not stated", "gough-problem/1"]);
    refused("/mechanism/tolerance", json!("loose"), &["mechanism.tolerance", "loose", "free"]);
    refused("/mechanism/tolerance", json!({"angle": 1}), &["mechanism.tolerance", "missing field `length`"]);
    refused(
        "/mechanism/tolerance",
        json!({"angle": true, "length": 1}),
        &["mechanism.tolerance.angle", "free"],
    );
}

#[test]
fn numbers() {
    refused(
        "/mechanism/limbs/3/joints/2/point/1",
        json!(1e9),
        &["limbs[3].joints[2].point[1] (limb4.ball)", "too large"],
    );
    refused(
        "/data/samples/0/actuators/5",
        json!(-1e300),
        &["data.samples[0].actuators[5] (sample 1)", "too large"],
    );
    refused("/data/samples/0/pose/rotation/0", json!(1e8), &["pose.rotation[0] (sample 1)", "too large"]);
    refused(
        "/mechanism/tolerance",
        json!({"angle": -1e-3, "length": 0}),
        &["mechanism.tolerance.angle", "negative"],
    );
    refused(
        "/mechanism/limbs/0/joints/0/tolerance",
        json!({"angle": 1e-3, "length": -1}),
        &["limbs[0].joints[0].tolerance.length (limb1.base)", "negative"],
    );
    refused("/mechanism/bounds", json!({"angle": -1}), &["mechanism.bounds.angle", "negative"]);
    for (number, word) in [("NaN", "not JSON"), ("1e999", "too large"), ("Infinity", "not JSON")] {
        let mut problem = hexapod();
        problem["data"]["noise"]["length"] = json!(12345.5);
        let text = problem.to_string().replace("12345.5", number);
        let error = parse(text.as_bytes()).unwrap_err().to_string();
        assert_message(&error, &[word, "data.noise.length", "line 1"]);
    }
}

#[test]
fn drawings() {
    refused(
        "/mechanism/limbs/2/joints/1/axis",
        json!([0, 0, 0]),
        &["mechanism.limbs[2].joints[1].axis (limb3.leg)", "the axis is zero"],
    );
    refused(
        "/mechanism/limbs/2/joints/0/axes/1",
        json!([0, 0, 0]),
        &["joints[0].axes[1] (limb3.base)", "zero"],
    );
    refused("/mechanism/limbs/2/joints/0/axes", json!([[1, 0, 0]]), &["(limb3.base)", "2 axes, 1 given"]);
    refused(
        "/mechanism/limbs/2/joints/0/axis",
        json!([1, 0, 0]),
        &["(limb3.base)", "several axes", "\"axes\""],
    );
    refused("/mechanism/limbs/2/joints/0/axes", Value::Null, &["(limb3.base)", "give \"axes\""]);
    refused("/mechanism/limbs/2/joints/1/axes", json!([[1, 0, 0]]), &["(limb3.leg)", "one axis", "\"axis\""]);
    refused("/mechanism/limbs/2/joints/1/axis", Value::Null, &["joints[1] (limb3.leg)", "give \"axis\""]);
    refused("/mechanism/limbs/2/joints/1/pitch", json!(5), &["joints[1].pitch (limb3.leg)", "no pitch"]);
    refused(
        "/mechanism/limbs/2/joints/1/type",
        json!("helical"),
        &["joints[1] (limb3.leg)", "needs \"pitch\""],
    );
    refused("/mechanism/limbs/2/joints/1/type", json!("ball"), &["joints[1].type", "`ball`", "spherical"]);
    refused(
        "/mechanism/limbs/2/joints/2/actuated",
        json!([true]),
        &["actuated (limb3.ball)", "1 value for the 3 axes"],
    );
    refused("/mechanism/limbs/2/joints/2/home", json!(0.1), &["home (limb3.ball)", "1 value for the 3 axes"]);
    refused("/mechanism/limbs/2/joints/1/range", json!([2, 1]), &["range (limb3.leg)", "begins at 2"]);
    refused("/mechanism/limbs/2/joints/1/range", json!([[0, 1], 2]), &["range (limb3.leg)", "a range is"]);
    refused("/mechanism/limbs/2/joints/1/range", json!(["a"]), &["range[0]", "(limb3.leg)", "a range is"]);
    refused(
        "/mechanism/limbs/2/joints/1/name",
        json!("ball"),
        &["limbs[2].joints[2].name (limb3.ball)", "`ball`", "twice"],
    );
    refused("/mechanism/limbs/2/joints/1/name", json!("ball.2"), &["(limb3.ball)", "`ball.2`", "twice"]);
    refused("/mechanism/limbs/2/joints/1/name", json!(" "), &["limbs[2].joints[1].name", "empty"]);
    refused("/mechanism/limbs/2/name", json!("limb1"), &["mechanism.limbs[2].name (limb1)", "twice"]);
    refused("/mechanism/limbs", json!([]), &["mechanism.limbs", "no limb"]);
    refused("/mechanism/limbs/4/joints", json!([]), &["mechanism.limbs[4].joints (limb5)", "no joints"]);
    refused("/mechanism/tool", Value::Null, &["mechanism.limbs[0] (limb1)", "no tool pose"]);
    refused(
        "/mechanism/tool",
        json!({"position": [0, null, 1], "rotation": [0, 0, 0]}),
        &["mechanism.tool", "missing"],
    );
    refused("/mechanism/tool", json!({"position": [0, 0, 1]}), &["mechanism.tool", "no rotation"]);
    refused(
        "/mechanism/tool/quaternion",
        json!([1, 0, 0, 0]),
        &["mechanism.tool", "both rotation and quaternion"],
    );
    let quaternion = |q: Value| json!({"position": [0, 0, 1], "quaternion": q});
    refused("/mechanism/tool", quaternion(json!([0, 0, 0, 0])), &["mechanism.tool.quaternion", "is zero"]);
    refused(
        "/mechanism/tool",
        quaternion(json!([1, 0, 0, 0.1])),
        &["mechanism.tool.quaternion", "length 1.00"],
    );
    refused("/mechanism/tool", quaternion(json!([1, 0, 0])), &["mechanism.tool.quaternion", "length 3"]);
    let mut passive = hexapod();
    for limb in passive["mechanism"]["limbs"].as_array_mut().unwrap() {
        limb["joints"][1].as_object_mut().unwrap().remove("actuated");
    }
    assert_message(
        &parse(passive.to_string().as_bytes()).unwrap_err().to_string(),
        &["mechanism", "no joint is actuated"],
    );
}

#[test]
fn data() {
    refused(
        "/data/samples/1/actuators",
        json!([1, 2, 3]),
        &["data.samples[1].actuators (sample 2)", "3 readings for 6 actuators", "limb1.leg"],
    );
    refused(
        "/data/samples/1/pose/rotation",
        json!([0, null, 0]),
        &["pose.rotation (sample 2)", "wholly or not at all"],
    );
    refused(
        "/data/samples/1/pose/rotation",
        Value::Null,
        &["data.samples[1].pose (sample 2)", "\"kind\": \"position\""],
    );
    refused(
        "/data/samples/1/pose/position",
        Value::Null,
        &["data.samples[1].pose (sample 2)", "no position"],
    );
    let nothing = json!({"position": [null, null, null], "rotation": [null, null, null]});
    refused("/data/samples/1/pose", nothing, &["data.samples[1].pose (sample 2)", "nothing was measured"]);
    refused("/data/kind", json!("angle"), &["data.kind", "`angle`", "pose, position, distance"]);
    refused("/data/noise/angle", json!(0), &["data.noise.angle", "positive"]);
    refused("/data/noise/length", json!(-1), &["data.noise.length", "positive"]);
    refused("/data/noise/length", Value::Null, &["data.noise", "\"length\""]);
    refused(
        "/data/samples/0/noise",
        json!({"angle": 0, "length": 1}),
        &["samples[0].noise.angle (sample 1)"],
    );
    let mut covariance = vec![vec![0.0; 6]; 6];
    (0..6).for_each(|i| covariance[i][i] = 1e-9);
    refused("/data/covariance", json!(covariance), &["data.covariance", "both noise and covariance"]);
    covariance[1][2] = 1e-10;
    refused(
        "/data/noise",
        json!({"covariance": covariance}),
        &["data.noise.covariance", "not symmetric", "[2][1]"],
    );
    covariance[1][2] = 0.0;
    covariance[4][4] = -1e-9;
    refused(
        "/data/noise",
        json!({"covariance": covariance}),
        &["data.noise.covariance", "not positive definite"],
    );
    refused("/data/noise", json!({"covariance": [[1]]}), &["data.noise.covariance[0]", "length 1"]);
    refused("/data/file", json!("d.csv"), &["data.file", "both samples and file"]);
    refused("/data/where", json!({"split": "train"}), &["data.where", "data file"]);
    refused("/data/holdout", json!({"holdout": {}}), &["data.holdout.holdout"]);
    refused(
        "/data/holdout",
        json!({"samples": [{"actuators": [], "pose": {}}]}),
        &["data.holdout.samples[0].actuators (sample 1)"],
    );
    refused(
        "/data",
        json!({"file": "d.csv"}),
        &["data.file", "d.csv", "elsewhere/d.csv", "shared/data/d.csv", "--data-dir"],
    );
    let mut other = hexapod()["mechanism"].clone();
    other["limbs"][0]["joints"][0]["actuated"] = json!([true, false]);
    refused("/truth", other, &["m.json: truth: ", "other actuators", "limb1.base.1"]);
}

#[test]
fn not_json() {
    let message = |text: &[u8]| parse(text).unwrap_err().to_string();
    assert_message(&message(b""), &["m.json", "empty"]);
    assert_message(&message(b" \n\t"), &["m.json", "empty"]);
    assert_message(&message(b"hello"), &["m.json", "not JSON", "hello"]);
    assert_message(&message(b"[1]"), &["m.json", "not JSON"]);
    assert_message(&message(b"{\"format\": "), &["m.json", "not JSON", "line 1"]);
    assert_message(&message(b"{}{}"), &["m.json", "not JSON", "trailing"]);
    let nested = ["{\"a\":".repeat(100_000), "1".into(), "}".repeat(100_000)].concat();
    assert_message(&message(nested.as_bytes()), &["m.json", "format"]);
    let nested = format!("{{\"format\": {}1{}}}", "[".repeat(100_000), "]".repeat(100_000));
    assert_message(&message(nested.as_bytes()), &["m.json: format", "recursion"]);
    let missing = read_model(Path::new("no/such.json")).unwrap_err().to_string();
    assert_message(&missing, &["no/such.json", "cannot be read"]);
    assert_message(&read_model(Path::new("src")).unwrap_err().to_string(), &["src", "cannot be read"]);
}
