//! Bad input through the command: exit status 2, one message that names the place, nothing on standard output and
//! nothing written.

mod support;

use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use support::{Ran, command, file, gough, json, ran, write};

fn hexapod() -> Value {
    json(&file("problems/hexapod-6ups.json"))
}

/// The hexapod with the value at `pointer` replaced, or added where the key is new.
fn spoiled(pointer: &str, value: Value) -> Value {
    let mut problem = hexapod();
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    match problem.pointer_mut(parent).unwrap() {
        Value::Object(map) => drop(map.insert(key.into(), value)),
        Value::Array(list) => list[key.parse::<usize>().unwrap()] = value,
        _ => panic!("{pointer} leads nowhere"),
    }
    problem
}

#[track_caller]
fn assert_refused(ran: &Ran, parts: &[&str]) {
    assert!(ran.status == 2 && ran.stdout.is_empty(), "{ran:?}");
    let message = ran.stderr.strip_suffix('\n').unwrap();
    assert!(message.starts_with("error: ") && message.lines().count() == 1, "{message}");
    assert!(message.len() < 600, "{message}");
    for part in parts {
        assert!(message.contains(part), "{part:?} is not in {message:?}");
    }
}

fn listing(folder: &Path) -> Vec<(PathBuf, u64)> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap());
    let mut all: Vec<_> = entries.map(|e| (e.path(), e.metadata().unwrap().len())).collect();
    all.sort();
    all
}

/// Runs the lines with `{0}` for the problem and `{1}` for an output in the same folder.
#[track_caller]
fn refused_text(text: &[u8], lines: &[&str], parts: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let problem = folder.path().join("machine.json");
    std::fs::write(&problem, text).unwrap();
    let before = listing(folder.path());
    for line in lines {
        let ran = gough(line, &[&problem, &folder.path().join("out.json")]);
        assert_refused(&ran, parts);
        assert!(ran.stderr.contains("machine.json"), "{ran:?}");
        assert_eq!(listing(folder.path()), before, "{line}");
    }
}

const IDENTIFY: &str = "identify {0} -o {1}";
const ANALYZE: &str = "analyze {0}";
const PREDICT: &str = "predict {0} --actuators {0} -o {1}";
const SIMULATE: &str = "simulate {0} --poses 5 --seed 1 -o {1}";
const ALL: [&str; 4] = [IDENTIFY, ANALYZE, PREDICT, SIMULATE];

#[track_caller]
fn refused(problem: &Value, lines: &[&str], parts: &[&str]) {
    refused_text(problem.to_string().as_bytes(), lines, parts);
}

#[test]
fn files_that_are_no_problem() {
    refused_text(b"", &ALL, &["empty"]);
    refused_text(b"\n \n", &ALL, &["empty"]);
    refused_text(b"limb, joint\n1, 2\n", &ALL, &["not JSON"]);
    refused_text(b"{\"format\": \"gough-problem/1\",", &ALL, &["not JSON", "line 1"]);
    refused(&spoiled("/format", json!("gough-problem/9")), &ALL, &["format", "gough-problem/9"]);
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("none.json");
    assert_refused(&gough(IDENTIFY, &[&missing, &missing]), &["none.json", "cannot be read"]);
    assert_refused(&gough(ANALYZE, &[folder.path()]), &["cannot be read"]);
    assert_eq!(listing(folder.path()), []);
}

#[test]
fn a_hundred_megabytes_of_garbage() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("garbage.json");
    let mut state = 1_u64;
    let noise: Vec<u8> = (0..1 << 20)
        .map(|_| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 56) as u8
        })
        .collect();
    std::fs::write(&path, [b"{".to_vec(), noise.repeat(100)].concat()).unwrap();
    let out = folder.path().join("out.json");
    for line in [IDENTIFY, PREDICT] {
        let begin = Instant::now();
        assert_refused(&gough(line, &[&path, &out]), &["garbage.json", "not JSON"]);
        assert!(begin.elapsed() < Duration::from_secs(5), "{:?}", begin.elapsed());
    }
    assert!(!out.exists());
}

#[test]
fn drawings() {
    let at = |rest: &str| format!("/mechanism/limbs/2{rest}");
    let unknown = spoiled(&at("/joints/0/colour"), json!("red"));
    refused(&unknown, &ALL, &["mechanism.limbs[2].joints[0].colour (limb3.base)", "unknown field"]);
    let zero = spoiled(&at("/joints/1/axis"), json!([0, 0, 0]));
    refused(&zero, &ALL, &["mechanism.limbs[2].joints[1].axis (limb3.leg)", "zero"]);
    for huge in [json!(1e300), json!(-1e12)] {
        let huge = spoiled(&at("/joints/2/point/0"), huge);
        refused(&huge, &ALL, &["joints[2].point[0] (limb3.ball)", "too large"]);
    }
    let quaternion = |q: Value| spoiled("/mechanism/tool", json!({"position": [0, 0, 1], "quaternion": q}));
    refused(&quaternion(json!([0, 0, 0, 0])), &ALL, &["mechanism.tool.quaternion", "zero"]);
    refused(&quaternion(json!([1, 1, 0, 0])), &ALL, &["mechanism.tool.quaternion", "length 1.4"]);
    refused(&spoiled("/mechanism/limbs", json!([])), &ALL, &["mechanism.limbs", "no limb"]);
    refused(&spoiled(&at("/joints"), json!([])), &ALL, &["mechanism.limbs[2].joints (limb3)", "no joints"]);
    let negative = spoiled("/mechanism/tolerance/length", json!(-1e-3));
    refused(&negative, &ALL, &["mechanism.tolerance.length", "negative"]);
    let mut passive = hexapod();
    for limb in passive["mechanism"]["limbs"].as_array_mut().unwrap() {
        limb["joints"][1]["actuated"] = json!(false);
    }
    refused(&passive, &ALL, &["no joint is actuated", "\"actuated\": true"]);
    for number in ["NaN", "Infinity", "-1e999"] {
        let text = spoiled(&at("/joints/1/point/2"), json!(12345.5)).to_string().replace("12345.5", number);
        refused_text(text.as_bytes(), &ALL, &["limbs[2].joints[1].point[2]"]);
    }
}

#[test]
fn data() {
    let data = [IDENTIFY, ANALYZE, SIMULATE];
    let short = spoiled("/data/samples/7/actuators", json!([0.1, 0.2]));
    refused(&short, &data, &["samples[7].actuators (sample 8)", "2 readings for 6 actuators"]);
    let zero = spoiled("/data/noise/angle", json!(0.0));
    refused(&zero, &data, &["data.noise.angle", "positive"]);
    let negative = spoiled("/data/noise/length", json!(-1e-5));
    refused(&negative, &data, &["data.noise.length", "positive"]);
    let quaternion = json!({"position": [0, 0, 1], "quaternion": [2, 0, 0, 0]});
    let long = spoiled("/data/samples/3/pose", quaternion);
    refused(&long, &data, &["samples[3].pose.quaternion (sample 4)", "length 2"]);
    let none = spoiled("/data/samples", json!([]));
    refused(&none, &[IDENTIFY], &["data", "samples"]);
    let without = spoiled("/mechanism/tolerance", Value::Null);
    refused(&without, &data, &["tolerance"]);
    let held = spoiled("/mechanism/tolerance", json!({"angle": 0, "length": 0}));
    refused(&held, &[IDENTIFY], &["every link is held"]);
}

#[test]
fn tables() {
    let folder = tempfile::tempdir().unwrap();
    let mut problem = hexapod();
    problem["data"] = json!({"file": "d.csv", "noise": {"angle": 2e-5, "length": 1e-5}});
    let (problem, out) = (write(folder.path(), "machine.json", &problem), folder.path().join("out.json"));
    let table = folder.path().join("d.csv");
    let head = "q1,q2,q3,q4,q5,q6,x,y,z,rx,ry,rz\n0,0,0,0,0,0,0,0,0.9,0,0,0\n";
    for (row, parts) in [
        ("0,0,0,0,0,0,0,0,0.9,0,0", &["line 3", "11"][..]),
        ("0,0,zero,0,0,0,0,0,0.9,0,0,0", &["line 3", "q3", "`zero`"]),
        ("0,0,NaN,0,0,0,0,0,0.9,0,0,0", &["line 3", "q3"]),
        ("0,0,,0,0,0,0,0,0.9,0,0,0", &["line 3", "q3"]),
    ] {
        std::fs::write(&table, format!("{head}{row}\n")).unwrap();
        for line in [IDENTIFY, "predict {0} --actuators {2} -o {1}"] {
            let ran = gough(line, &[&problem, &out, &table]);
            assert_refused(&ran, parts);
            assert!(ran.stderr.contains("d.csv"), "{ran:?}");
        }
    }
    std::fs::write(&table, "").unwrap();
    assert_refused(&gough(IDENTIFY, &[&problem, &out]), &["d.csv", "empty"]);
    std::fs::remove_file(&table).unwrap();
    assert_refused(&gough(IDENTIFY, &[&problem, &out]), &["machine.json: data.file", "d.csv", "--data-dir"]);
    assert!(!out.exists());
}

fn revolute(point: [f64; 3], actuated: bool) -> Value {
    json!({"type": "revolute", "point": point, "axis": [0, 0, 1], "actuated": actuated})
}

#[test]
fn machines_that_the_model_does_not_describe() {
    // In space, the plane of a five-bar linkage is a constraint too many, three times.
    let mut five_bar = hexapod();
    five_bar["mechanism"]["limbs"] = json!([
        {"name": "left", "joints": [revolute([0.0, 0.0, 0.0], true), revolute([-0.1, 0.3, 0.0], false)]},
        {"name": "right", "joints": [revolute([0.2, 0.0, 0.0], true), revolute([0.3, 0.3, 0.0], false),
                                     revolute([0.1, 0.5, 0.0], false)]}]);
    five_bar["data"]["samples"] = json!([{"actuators": [0, 0],
        "pose": {"position": [0, 0, 0.9], "rotation": [0, 0, 0]}}]);
    five_bar["data"].as_object_mut().unwrap().remove("holdout");
    five_bar.as_object_mut().unwrap().remove("truth");
    let parts = ["mechanism: over-constrained", "9 wrenches", "left 5, right 4", "more passive joints"];
    refused(&five_bar, &ALL, &parts);

    let mut idle = hexapod();
    idle["mechanism"]["limbs"][3]["joints"][1]["actuated"] = json!(false);
    for set in ["/data", "/data/holdout"] {
        for sample in idle.pointer_mut(set).unwrap()["samples"].as_array_mut().unwrap() {
            sample["actuators"].as_array_mut().unwrap().remove(3);
        }
    }
    idle.as_object_mut().unwrap().remove("truth");
    refused(&idle, &ALL, &["mechanism: under-actuated", "5 wrenches", "limb4 0"]);

    let mut spins = hexapod();
    let foot = &mut spins["mechanism"]["limbs"][4]["joints"][0];
    *foot = json!({"name": "foot", "type": "spherical", "point": foot["point"],
                   "axes": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]});
    let parts = ["limb5 can spin", "foot", "ball", "universal joint in place of a spherical one"];
    refused(&spins, &ALL, &parts);
}

#[test]
fn postures_that_cannot_close() {
    let folder = tempfile::tempdir().unwrap();
    let sample = |q: f64| json!({"actuators": [0.0, q, 0.0, 0.0, 0.0, 0.0]});
    let readings = json!({"samples": [sample(0.0), sample(0.01), sample(30.0)]});
    let readings = write(folder.path(), "readings.json", &readings);
    let (problem, out) = (file("problems/hexapod-6ups.json"), folder.path().join("out.json"));
    let ran = gough("predict {0} --actuators {1} -o {2}", &[&problem, &readings, &out]);
    assert_refused(
        &ran,
        &["readings.json", "1 posture of 3", "sample 3", "do not meet", "--skip-unreachable"],
    );
    assert!(!out.exists());
    let ran = gough("predict {0} --actuators {1} -o {2} --skip-unreachable", &[&problem, &readings, &out]);
    assert!(ran.status == 0 && ran.stderr.contains("warning: left out: "), "{ran:?}");
    assert!(ran.stderr.contains("outside the stated range of limb2.leg"), "{ran:?}");
    assert_eq!(json(&out)["samples"].as_array().unwrap().len(), 2);
    // While identifying it takes no part; on request that is refused.
    let mut far = hexapod();
    far["data"]["samples"][4]["actuators"][1] = json!(30.0);
    refused(&far, &["identify {0} --require-all -o {1}"], &["sample 5", "do not meet", "--require-all"]);
}

#[test]
fn usage() {
    let problem = file("problems/serial-scara.json");
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.json");
    let paths: &[&Path] = &[&problem, &out];
    let known = ["unknown solver 'newton'", "minimal", "textbook", "map", "argmin"];
    assert_refused(&gough("identify {0} --solver newton -o {1}", paths), &known);
    let setting = ["minimal", "'colour'", "threshold"];
    assert_refused(&gough("identify {0} --set colour=red -o {1}", paths), &setting);
    assert_refused(&gough("identify {0} --set threshold -o {1}", paths), &["threshold", "KEY=VALUE"]);
    assert_refused(&gough("identify {0} --set threshold=-1 -o {1}", paths), &["threshold", "-1"]);
    assert_refused(&gough("identify {0} --holdout 1 -o {1}", paths), &["--holdout"]);
    assert_refused(&gough("simulate {0} --poses 1 --seed 1 --noise=-1 -o {1}", paths), &["--noise"]);
    let no_poses = "simulate {0} --poses 0 --seed 1 -o {1}";
    for line in ["identify", "identify {0} --sovler map", "calibrate {0}", no_poses, ""] {
        let ran = gough(line, paths);
        assert!(ran.status == 2 && ran.stdout.is_empty() && !ran.stderr.is_empty(), "{line}: {ran:?}");
    }
    assert!(!out.exists());
}

#[test]
fn outputs_that_cannot_be_written() {
    let folder = tempfile::tempdir().unwrap();
    let problem = file("problems/serial-scara.json");
    let nowhere = folder.path().join("no/such/out.json");
    for line in ALL.iter().filter(|line| line.contains("{1}")) {
        assert_refused(&gough(line, &[&problem, &nowhere]), &["no/such/out.json", "cannot be written"]);
        assert_refused(&gough(line, &[&problem, folder.path()]), &["cannot be written", "folder"]);
    }
    assert_eq!(listing(folder.path()), []);
}

/// Not an error: what the poses do not determine stays at nominal, and the result says so.
#[test]
fn too_few_poses_are_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let mut few = hexapod();
    few["data"]["samples"].as_array_mut().unwrap().truncate(5);
    let (problem, out) = (write(folder.path(), "few.json", &few), folder.path().join("out.json"));
    let ran = gough(IDENTIFY, &[&problem, &out]);
    assert!(ran.status == 0, "{ran:?}");
    let warning = "30 readings for 138 parameters: what they do not determine stays at nominal";
    assert!(ran.stderr.contains(&format!("warning: {warning}")), "{}", ran.stderr);
    assert!(json(&out)["warnings"][0].as_str().unwrap().contains(warning));
}

#[test]
fn not_converging_is_status_1_and_the_result_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.json");
    let problem = file("problems/hexapod-6ups.json");
    let ran = ran(command().arg("identify").arg(problem).args(["--solver", "textbook", "-o"]).arg(&out));
    assert_eq!(ran.status, 1, "{ran:?}");
    let result = json(&out);
    assert_eq!(result["converged"], false);
    let reason = result["reason"].as_str().unwrap();
    assert!(reason.contains("diverged") || reason.contains("left the region"), "{reason}");
    assert!(ran.stderr.contains(&format!("warning: not converged: {reason}")), "{}", ran.stderr);
    assert!(result["warnings"][0].as_str().unwrap().contains("not converged"), "{}", result["warnings"]);
}
