//! Data of further kinds of measurement that are not right: every one is named.

mod support;

use gough::files::DataPlaces;
use gough::files::problem::parse_problem;
use serde_json::{Value, json};
use std::path::Path;
use support::{done, file, gough, json, numbers, write};

#[test]
fn what_is_wrong_is_named() {
    let arm = |data: Value| {
        let mut value = json(&file("problems/serial-puma560.json"));
        value.as_object_mut().unwrap().remove("truth");
        value["data"] = data;
        let places = DataPlaces { data_dir: None, shared: "no such folder".into() };
        let read = parse_problem(Path::new("m.json"), value.to_string().as_bytes(), &places);
        read.map(|_| ()).unwrap_err().to_string()
    };
    let base = |kind: &str| json!({"kind": kind, "noise": {"length": 1e-5}});
    let with = |kind: &str, key: &str, value: Value| {
        let mut data = base(kind);
        data[key] = value;
        data
    };
    let sample = json!({"actuators": [0, 0, 0, 0, 0, 0], "distance": 0.5});
    let cases = [
        (base("sound"), "unknown kind of measurement `sound`; known kinds: pose, position, distance"),
        (base("passive-joint"), "no passive joints"),
        (base("distance"), "no point; draw one in data.instrument"),
        (base("plane"), "no plane; draw one"),
        (
            with("plane", "instrument", json!({"planes": {"bed": {"normal": [0, 0, 0], "offset": 0}}})),
            "data.instrument.planes.bed.normal: the normal is zero",
        ),
        (
            with("distance", "instrument", json!({"points": {"a": {"tolerance": 1e-3}}})),
            "data.instrument.points.a: no position",
        ),
        (
            json!({"kind": "distance", "noise": {"length": 1e-5}, "samples": [sample],
                "instrument": {"points": {"a": {"position": [0, 0, 0]}, "b": {"position": [1, 0, 0]}}}}),
            "data.samples[0] (sample 1): which point? name one with \"point\": a, b",
        ),
        (
            json!({"kind": "distance", "noise": {"length": 1e-5}, "samples": [sample], "target": "ball",
                "instrument": {"points": {"a": {"position": [0, 0, 0]}}}}),
            "unknown target `ball`; data.instrument has: none",
        ),
        (
            json!({"kind": "separation", "noise": {"length": 1e-5}, "samples": [sample]}),
            "no second; a measured separation needs it",
        ),
        (
            json!({"kind": "separation", "noise": {"angle": 1e-5}}),
            "noise of a measured separation needs \"length\"",
        ),
        (json!({"sets": [], "noise": {"length": 1}}), "data.sets: there is no set"),
        (json!({"sets": [{"kind": "pose"}], "file": "x.csv"}), "data.file: file is stated beside \"sets\""),
        (
            json!({"sets": [{"kind": "pose", "instrument": {}}]}),
            "data.sets[0].instrument: \"instrument\" belongs to data as a whole",
        ),
    ];
    for (data, wanted) in cases {
        let found = arm(data);
        assert!(found.starts_with("m.json: ") && found.contains(wanted), "{found}\n{wanted}");
    }
}

#[test]
fn columns_of_a_table_are_mapped_or_named() {
    let folder = tempfile::tempdir().unwrap();
    let table = "q1,q2,q3,q4,q5,q6,distance,point\n0,0,0,0,0,0,0.5,a\n0.1,0,0,0,0,0,0.6,b\n";
    std::fs::write(folder.path().join("d.csv"), table).unwrap();
    let mut value = json(&file("problems/serial-puma560.json"));
    value.as_object_mut().unwrap().remove("truth");
    value["data"] = json!({"kind": "distance", "noise": {"length": 1e-5}, "file": "d.csv",
        "instrument": {"points": {"a": {"position": [1, 0, 0]}, "b": {"position": [0, 1, 0], "tolerance": 0.001}}}});
    let path = write(folder.path(), "p.json", &value);
    let read = gough::files::read_problem(&path, &DataPlaces::from_environment(None)).unwrap();
    assert_eq!(read.data.samples[1].measurement.readings(), [0.6]);
    value["data"]["columns"] =
        json!({"actuators": ["q1", "q2", "q3", "q4", "q5", "q6"], "distance": "reading"});
    let path = write(folder.path(), "p.json", &value);
    let found = gough("identify {0}", &[&path]);
    assert_eq!(found.status, 2, "{found:?}");
    assert!(found.stderr.contains("d.csv: line 1: no column `reading`"), "{found:?}");
}

#[test]
fn a_simulated_ball_bar_is_identified_and_reported() {
    let folder = tempfile::tempdir().unwrap();
    let mut value = json(&file("problems/serial-puma560.json"));
    value.as_object_mut().unwrap().remove("truth");
    value["data"] = json!({"kind": "distance", "noise": {"length": 1e-5}, "instrument": {
        "points": {"bar": {"position": [0.3, 0.2, -0.1], "tolerance": 0.001}}}});
    let problem = write(folder.path(), "p.json", &value);
    let (data, result) = (folder.path().join("d.json"), folder.path().join("r.json"));
    done("simulate {0} --poses 100 --seed 2 -o {1}", &[&problem, &data]);
    let ran = gough("identify {0} -o {1}", &[&data, &result]);
    assert_eq!(ran.status, 0, "{ran:?}");
    assert!(
        ran.stdout.contains("point bar x") && ran.stdout.contains("distance      hold-out  rms "),
        "{ran:?}"
    );
    let (data, result) = (json(&data), json(&result));
    for (k, axis) in ["x", "y", "z"].into_iter().enumerate() {
        let truth = data["truth_instrument"][format!("point bar {axis}")].as_f64().unwrap();
        let found = &result["instrument"][k];
        let (value, std) = (found["value"].as_f64().unwrap(), found["std"].as_f64().unwrap());
        assert_eq!(found["name"], format!("point bar {axis}"));
        assert!((value - truth).abs() <= 4.0 * std && std < 1.1e-3, "{found} {truth}");
    }
    let rms = |when: &str| result["holdout"][when]["distance_rms"].as_f64().unwrap();
    assert!(rms("after") < 2e-5 && rms("before") > 20.0 * rms("after"));
    assert!(
        numbers(&result["singular_values"]).len()
            == result["counts"]["structural"].as_u64().unwrap() as usize
    );
}
