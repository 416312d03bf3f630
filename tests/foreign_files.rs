//! Foreign files that are wrong: status 2, one message that names what and where, nothing written.

mod support;

use std::fs;
use support::{file, gough};

/// Imports the file with `from` replaced by `to`; the message must hold all `parts`.
#[track_caller]
fn refused(line: &str, source: &str, (from, to): (&str, &str), parts: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let text = fs::read_to_string(file("tests/data/formats").join(source)).unwrap();
    assert!(text.contains(from), "{from}");
    let spoiled = folder.path().join(source);
    fs::write(&spoiled, text.replacen(from, to, 1)).unwrap();
    let out = folder.path().join("out.json");
    let ran = gough(&format!("import {line} -o {{1}}"), &[&spoiled, &out]);
    assert!(ran.status == 2 && ran.stdout.is_empty() && !out.exists(), "{ran:?}");
    assert!(ran.stderr.starts_with("error: ") && ran.stderr.trim_end().lines().count() == 1, "{ran:?}");
    for part in parts {
        assert!(ran.stderr.contains(part), "{part:?} is not in {}", ran.stderr);
    }
}

#[test]
fn urdf() {
    const LINE: &str = "urdf {0} --base world --tool tool";
    let refused = |edit, parts: &[&str]| refused(LINE, "skew-6r.urdf", edit, parts);
    let j5 = "<joint name=\"j5\" type=\"revolute\">";
    refused(
        (j5, "<joint name=\"j5\" type=\"floating\">"),
        &["line 74 (<joint> `j5`)", "is `floating`", "prismatic"],
    );
    refused((j5, "<joint name=\"j5\" type=\"planar\">"), &["`planar`"]);
    refused((j5, "<joint name=\"j5\" type=\"revolute\"><mimic joint=\"j2\"/>"), &["`j5` mimics `j2`"]);
    refused((j5, "<joint name=\"j4\" type=\"revolute\">"), &["called `j4`"]);
    refused(("<child link=\"l5\"/>", "<child link=\"l9\"/>"), &["no link `l9`", "`l6`"]);
    refused(
        ("<child link=\"l5\"/>", "<child link=\"l1\"/>"),
        &["link `l1` is the child of two joints, `j1` and `j5`"],
    );
    refused(
        (
            "<parent link=\"l4\"/>\n    <child link=\"l5\"/>",
            "<parent link=\"tool\"/>\n    <child link=\"l5\"/>",
        ),
        &[
            "no chain leads from link `world` to link `tool`; above `world` are none; above `tool` are `l6`, `l5`",
        ],
    );
    refused(("rpy=\"1.2 -1.1 0.6\"", "rpy=\"1.2 -1.1\""), &["`rpy` is `1.2 -1.1`; 3 numbers expected"]);
    refused(("rpy=\"1.2 -1.1 0.6\"", "rpy=\"1.2 nan 0.6\""), &["finite numbers"]);
    refused(("axis xyz=\"0.6 0 0.8\"", "axis xyz=\"0 0 0\""), &["`xyz` is zero"]);
    refused(("lower=\"-3\" upper=\"3\"", "lower=\"3\" upper=\"-3\""), &["`j6`", "begins at 3"]);
    refused(("</robot>", ""), &["not XML"]);
    refused(
        (
            "<robot name=\"skew-6r\">",
            "<robot name=\"skew-6r\" xmlns:xacro=\"http://ros.org/wiki/xacro\"><xacro:arg/>",
        ),
        &["xacro FILE"],
    );
    let missing = "urdf {0} --base world --tool hand";
    self::refused(missing, "skew-6r.urdf", ("", ""), &["no link `hand`", "`world`"]);
    self::refused("urdf {0} --base world --tool base", "skew-6r.urdf", ("", ""), &["no moving joint"]);
    self::refused(
        "urdf {0} --base world --tool right",
        "skew-6r.urdf",
        ("", ""),
        &["`finger_right` mimics `finger_left`"],
    );
    self::refused(LINE, "hexapod.xml", ("", ""), &["begins with <`mujoco`> where <robot>"]);
}

#[test]
fn tables() {
    let refused = |edit, parts: &[&str]| {
        refused("dh {0} --convention standard --length mm --angle deg", "table.csv", edit, parts);
    };
    let lift = "lift,R,3,-12,455,0,-120,60";
    refused((lift, "lift,R,3,-12,455"), &["line 4: 5 cells where the header has 8: the row is too short"]);
    refused((lift, "lift,R,3,-12,455,0,-120,60,1"), &["too long"]);
    refused((lift, "lift,Q,3,-12,455,0,-120,60"), &["line 4", "`Q` is no joint type"]);
    refused((lift, "lift,R,3,x,455,0,-120,60"), &["column `d`: `x` is not a number"]);
    refused((lift, "lift,R,3,,455,0,-120,60"), &["column `d`: an empty cell"]);
    refused((lift, "lift,R,3,inf,455,0,-120,60"), &["column `d`"]);
    refused((lift, "lift,R,3,1e9,455,0,-120,60"), &["too large"]);
    refused((lift, "lift,R,3,-12,455,0,-120,"), &["give both `min` and `max`"]);
    refused((lift, "lift,R,3,-12,455,0,60,-120"), &["begins at 60"]);
    refused((lift, "swivel,R,3,-12,455,0,-120,60"), &["called `swivel`"]);
    refused(("alpha", "twist"), &["line 1", "unknown column `twist`"]);
    refused(("theta,d,a,alpha,min", "theta,d,a,a,min"), &["called `a`"]);
}

#[test]
fn mjcf() {
    let line = "mjcf {0} --tool probe";
    let refused = |edit, parts: &[&str]| refused(line, "hexapod.xml", edit, parts);
    let spare = "body1=\"rod6\" body2=\"plate\" anchor=\"0 0 0\" active=\"false\"";
    refused(
        (spare, "body1=\"rod6\" body2=\"plate\" anchor=\"0 0 0\""),
        &["does not reduce to limbs", "chains meet at body `rod6`"],
    );
    refused(
        (spare, "body1=\"plate\" body2=\"rod6_end\" anchor=\"0 0 0\""),
        &["over-constrained: connect `spare`"],
    );
    refused(
        ("<weld name=\"grip6\"", "<weld body1=\"plate\"/><weld name=\"grip6\""),
        &["does not move against the base"],
    );
    // A hinge less in a leg: seven wrenches.
    refused(("<joint name=\"leg2_x\" axis=\"1 0 0\"/>", ""), &["over-constrained", "7 wrenches", "leg2 2"]);
    refused(("<position joint=\"leg1_s\"/>", ""), &["under-actuated"]);
    refused(
        ("<joint name=\"leg6_u\" type=\"hinge\" axis=\"1 0 0\"/>", "<joint name=\"leg6_w\" type=\"ball\"/>"),
        &["can spin", "ball6"],
    );
    refused(("body2=\"rod2\"", "body2=\"rood\""), &["no body `rood`", "line 61 (<connect> `ball2`)"]);
    refused(("class=\"strut\"/><geom", "class=\"strutt\"/><geom"), &["no default class `strutt`"]);
    refused(
        ("<joint name=\"leg1_s\" ref=\"0.01\"/>", "<joint name=\"leg1_s\" type=\"screw\"/>"),
        &["`type` is `screw`"],
    );
    refused(
        ("<equality>", "<equality><joint joint1=\"leg1_s\" joint2=\"leg2_s\"/>"),
        &["`leg1_s` is coupled"],
    );
    refused(("<worldbody>", "<worldbody><replicate count=\"2\"/>"), &["<replicate> is a macro"]);
    refused(("<worldbody>", "<include file=\"x.xml\"/><worldbody>"), &["included file"]);
    self::refused("mjcf {0} --tool nose", "hexapod.xml", ("", ""), &["no body or site `nose`"]);
    self::refused(
        "mjcf {0} --tool probe --actuated leg1_s,leg9_s",
        "hexapod.xml",
        ("", ""),
        &["no joint `leg9_s`"],
    );
    self::refused("mjcf {0} --tool pendulum", "hexapod.xml", ("", ""), &["7 chains meet at body `plate`"]);
}

#[test]
fn measurements() {
    let folder = tempfile::tempdir().unwrap();
    let table = folder.path().join("log.csv");
    fs::write(&table, "J1,J2,J3,J4,J5,J6,X,Y,Z\n0,0,0,0,0,0,452.1,-150.05,1159.85\n").unwrap();
    let map = "q1=J1,q2=J2,q3=J3,q4=J4,q5=J5,q6=J6,x=X,y=Y,z=Z";
    let problem = file("problems/serial-puma560.json");
    let run = |map: &str| {
        gough(&format!("import csv {{0}} --problem {{1}} --length mm --map {map}"), &[&table, &problem])
    };
    let message = |map: &str| {
        let ran = run(map);
        assert!(ran.status == 2 && ran.stdout.is_empty() && ran.stderr.lines().count() == 1, "{ran:?}");
        ran.stderr
    };
    assert!(message("q1=J1,x=X").contains("no column for `arm.shoulder`"));
    let semicolons = folder.path().join("semicolons.csv");
    fs::write(&semicolons, "J1;J2;J3\n0;0;0\n").unwrap();
    let ran = gough("import csv {0} --problem {1} --map q1=J1", &[&semicolons, &problem]);
    assert!(
        ran.status == 2 && ran.stderr.contains("semicolons.csv: line 1") && ran.stderr.contains("';'"),
        "{ran:?}"
    );
    assert!(message(&map.replace(",y=Y", "")).contains("no column for `y`: map it with --map y=NAME"));
    assert!(message(&map.replace("y=Y", "y=YY")).contains("--map y=YY: `YY` is not a column of"));
    assert!(message(&map.replace("y=Y", "y=YY")).contains("which are J1, J2, J3, J4, J5, J6, X, Y, Z"));
    assert!(message(&map.replace("y=Y", "height=Y")).contains("`height` is none of our columns"));
    assert!(message(&map.replace("y=Y", "y=Y,y=Z")).contains("y is given twice"));
    assert!(message(&map.replace("y=Y", "y")).contains("write it as NAME=NAME"));
    let ran = run(map);
    assert_eq!(ran.status, 0, "{ran:?}");
    let written: serde_json::Value = serde_json::from_str(&ran.stdout).unwrap();
    let data = &written["data"];
    assert_eq!(data["kind"], "position");
    assert_eq!(data["noise"]["length"], 0.00005);
    assert_eq!(data["holdout"]["samples"].as_array().unwrap().len(), 40);
    let position = support::numbers(&data["samples"][0]["pose"]["position"]);
    for (found, wanted) in position.iter().zip([0.4521, -0.15005, 1.15985]) {
        assert!((found - wanted).abs() < 1e-15);
    }
}
