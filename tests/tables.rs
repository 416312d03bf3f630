//! Tables of readings and poses: columns, rows, and what is wrong with them.

mod spoiled;

use gough::files::problem::parse_model;
use gough::files::{ProblemFile, read_actuators, read_problem};
use serde_json::{Value, json};
use spoiled::{assert_message, hexapod, places};
use std::fs;
use std::path::{Path, PathBuf};

const HEADER: &str = "q1,q2,q3,q4,q5,q6,x,y,z,rx,ry,rz\n";
const ROW: &str = "0,0,0,0,0,0,0,0,0.9,0,0,0\n";

/// What a table of six readings and a pose says that follows from these lines.
fn table(text: &str, change: impl Fn(&mut Value)) -> Result<ProblemFile, String> {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("d.csv"), text).unwrap();
    let mut problem = hexapod();
    problem["data"] = json!({"noise": {"angle": 2e-5, "length": 1e-5}, "file": "d.csv"});
    change(&mut problem);
    let path: PathBuf = folder.path().join("m.json");
    fs::write(&path, problem.to_string()).unwrap();
    read_problem(&path, &places()).map_err(|error| error.to_string())
}

#[test]
fn tables() {
    let good = |text: String| table(&text, |_| {}).unwrap();
    assert_eq!(good(format!("\u{feff}{HEADER}{ROW}\n{ROW}")).data.samples[1].name, "d.csv line 4");
    let partial = good(format!("{HEADER}0,0,0,0,0,0,0,,0.9,,,\r\n0,0,0,0,0,0,,,,0,0,0\r\n")).data;
    assert_eq!(partial.samples.iter().map(|s| s.measurement.rows()).collect::<Vec<_>>(), [2, 3]);
    assert!(!partial.measured[0].rotation && partial.measured[0].position == [true, false, true]);
    let bad = |text: String, parts: &[&str]| assert_message(&table(&text, |_| {}).unwrap_err(), parts);
    bad(format!("{HEADER}{ROW}0,0,0\n"), &["d.csv: line 3", "3 cells where the header has 12"]);
    bad(format!("{HEADER}{ROW}0,0,0,0,0,0,0,0,0.9,0,0,0,7\n"), &["d.csv: line 3", "13 cells"]);
    bad(
        format!("{HEADER}0,0,zero,0,0,0,0,0,0.9,0,0,0\n"),
        &["d.csv: line 2, column `q3`", "`zero` is not a number"],
    );
    bad(format!("{HEADER}0,0,NaN,0,0,0,0,0,0.9,0,0,0\n"), &["line 2, column `q3`", "not a finite number"]);
    bad(format!("{HEADER}0,0,0,0,0,0,0,0,inf,0,0,0\n"), &["line 2, column `z`", "not a finite number"]);
    bad(format!("{HEADER}0,0,,0,0,0,0,0,0.9,0,0,0\n"), &["line 2, column `q3`", "reading is missing"]);
    bad(format!("{HEADER}0,0,0,0,0,0,0,0,0.9,0,,0\n"), &["line 2, rotation", "wholly or not at all"]);
    bad(format!("{HEADER}0,0,0,0,0,0,,,,,,\n"), &["d.csv: line 2", "nothing was measured"]);
    bad(format!("{HEADER}0,0,0,0,0,1e12,0,0,0.9,0,0,0\n"), &["d.csv: line 2", "too large"]);
    bad(HEADER.into(), &["d.csv", "no rows"]);
    bad(String::new(), &["d.csv", "empty"]);
    bad(format!("q1,q2,q3,q4,q5,x,y,z,rx,ry,rz\n{ROW}"), &["line 1", "`limb6.leg` (or `q6`)"]);
    bad(format!("q1,q2,q3,q4,q5,q6,x,y,rx,ry,rz\n{ROW}"), &["line 1", "no column `z`"]);
    bad(format!("q1,q2,q3,q4,q5,q6,x,y,z\n{ROW}"), &["line 1", "no rotation", "position"]);
    bad(format!("{}time\n", HEADER.replace('\n', ",")), &["line 1", "unknown column `time`", "data.columns"]);
    bad(HEADER.replace("q2", "q1"), &["line 1", "two columns are called `q1`"]);
    bad(HEADER.replace("rx", "qw,qx,qy,qz,rx"), &["line 1", "both rotation and quaternion"]);
    bad("\0\0\u{1}\n".repeat(1000), &["d.csv", "not a CSV table"]);
    bad("x".repeat(3 << 20), &["d.csv", "not a CSV table"]);
}

#[test]
fn foreign_columns() {
    let text = "time,a,b,c,d,e,f,X,Y,Z,w,i,j,k,split\n\
                1,0,0,0,0,0,0,0,0,0.9,1,0,0,0,train\n2,0,0,0,0,0,0,0,0,0.9,0.9999,0,0,0,test\n";
    let columns = json!({"actuators": ["a", "b", "c", "d", "e", "f"], "position": ["X", "Y", "Z"],
                         "quaternion": ["w", "i", "j", "k"]});
    let with = |key: &'static str, value: Value| {
        let columns = columns.clone();
        table(text, move |problem| {
            problem["data"]["columns"] = columns.clone();
            problem["data"]["where"] = json!({"split": "train"});
            problem["data"]["holdout"] = json!({"where": {"split": "test"}});
            problem["data"][key] = value.clone();
        })
    };
    let good = with("kind", json!("pose")).unwrap();
    assert_eq!((good.data.samples.len(), good.holdout.samples.len()), (1, 1));
    assert!(good.holdout.has_noise() && good.holdout.samples[0].name == "d.csv line 3");
    assert_eq!(with("kind", json!("position")).unwrap().data.samples[0].measurement.rows(), 3);
    let bad = |key, value, parts: &[&str]| assert_message(&with(key, value).unwrap_err(), parts);
    bad("where", json!({"split": "trian"}), &["d.csv", "no rows with split = trian; split holds `"]);
    bad("where", json!({"sort": "train"}), &["d.csv: line 1", "no column `sort`", "`split`"]);
    bad("columns", json!({"actuators": ["a"]}), &["d.csv: line 1", "1 reading for 6 actuators"]);
    bad("columns", json!({"acts": []}), &["data.columns.acts", "unknown field"]);
}

#[test]
fn actuator_files() {
    let folder = tempfile::tempdir().unwrap();
    let model = parse_model(Path::new("m.json"), hexapod().to_string().as_bytes()).unwrap();
    let message = |file: &str, text: &str| {
        let path = folder.path().join(file);
        fs::write(&path, text).unwrap();
        read_actuators(&path, &model).unwrap_err().to_string()
    };
    assert_message(
        &message("a.json", r#"{"samples": [{"actuators": [1]}]}"#),
        &["samples[0].actuators (sample 1)", "1 reading for 6"],
    );
    assert_message(&message("a.json", r#"{"samples": []}"#), &["samples", "no rows"]);
    assert_message(&message("a.json", r#"{"sampels": []}"#), &["unknown field `sampels`"]);
    assert_message(
        &message("a.json", r#"{"samples": [{"actuators": ["x"]}]}"#),
        &["samples[0].actuators[0] (sample 1)"],
    );
    assert_message(&message("a.json", "q1,q2"), &["a.json", "not JSON"]);
    assert_message(&message("a.csv", "q1,q2,q3,q4,q5,q6\n1,2,3,4,5\n"), &["a.csv: line 2", "5 cells"]);
    assert_message(
        &message("a.csv", "a;b;c;d\n1;2;3;4\n"),
        &["a.csv: line 1", "columns are divided by ';'", "write commas"],
    );
    assert_message(
        &message("a.csv", "a,b,c,d\n1,2,3,4\n"),
        &["a.csv: line 1", "no column `limb1.leg` (or `q1`)", "`a`, `b`, `c`, `d`"],
    );
    assert_message(&message("a.csv", ""), &["a.csv", "empty"]);
    let text = "limb2.leg,limb1.leg,limb3.leg,limb4.leg,limb5.leg,limb6.leg\n2,1,3,4,5,6\n";
    fs::write(folder.path().join("b.csv"), text).unwrap();
    let rows = read_actuators(&folder.path().join("b.csv"), &model).unwrap();
    assert_eq!(rows[0].readings, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
}
