//! Foreign drawings as they are published: points far out, chains through a common ancestor, axes that mean nothing.

mod support;

use std::fs;
use std::path::{Path, PathBuf};
use support::*;

fn case(name: &str) -> PathBuf {
    file("tests/data/cases/formats").join(name)
}

/// Axes of a UR arm that are parallel to within a milliradian: the table's frames lie up to 574 m away.
#[test]
fn far_points_of_a_table_are_slid_along_their_axes() {
    let folder = tempfile::tempdir().unwrap();
    let drawing = folder.path().join("ur.json");
    let line = "import dh {0} --convention standard --length m --angle rad --tolerance-length 0.001 \
                --tolerance-angle 0.001 -o {1}";
    let ran = gough(line, &[&case("05-ur-calibrated-dh.csv"), &drawing]);
    assert_eq!(ran.status, 0, "{ran:?}");
    for joint in ["j3", "j4"] {
        assert!(ran.stderr.contains(&format!("point of {joint} lay")), "{}", ran.stderr);
    }
    let mut problem = json(&drawing);
    let published = json(&case("05-ur-calibrated-dh-with-data.json"));
    for joint in problem["mechanism"]["limbs"][0]["joints"].as_array().unwrap() {
        assert!(numbers(&joint["point"]).iter().all(|v| v.abs() < 2.0), "{joint}");
    }
    // The same motion: predictions of both drawings agree.
    let readings = folder.path().join("readings.json");
    let samples = &published["data"]["holdout"]["samples"];
    fs::write(&readings, serde_json::json!({ "samples": samples }).to_string()).unwrap();
    let predicted = |model: &Path| {
        let out = folder.path().join("poses.json");
        done("predict {0} --actuators {1} -o {2}", &[model, &readings, &out]);
        poses(&json(&out), (1.0, 1.0))
    };
    let gap = errors(&predicted(&drawing), &predicted(&case("05-ur-calibrated-dh-with-data.json")));
    assert!(gap.position_max < 1e-9 && gap.rotation_max < 1e-9, "{gap:?}");
    // With a tolerance that acts near the machine the data identify it.
    problem["data"] = published["data"].clone();
    let problem = write(folder.path(), "p.json", &problem);
    let result = folder.path().join("r.json");
    done("identify {0} -o {1}", &[&problem, &result]);
    let after = json(&result)["holdout"]["after"].clone();
    let at = |key: &str| after[key].as_f64().unwrap();
    assert!(at("position_rms") < 0.0520e-3 && at("rotation_rms") < 0.098e-3, "{after}");
}

/// A drawing that already has such points: what a tolerance of angle means there is said, with the cure.
#[test]
fn far_points_of_a_problem_are_named() {
    let ran = gough("identify {0}", &[&case("05-ur-calibrated-dh-with-data.json")]);
    for part in ["arm.j3", "574", "tolerance", "slide"] {
        assert!(ran.stderr.contains(part), "{part}: {}", ran.stderr);
    }
    let ran = gough("identify {0}", &[&file("problems/serial-ur10.json")]);
    assert!(!ran.stderr.contains("slide"), "{}", ran.stderr);
}

/// From a camera on the head to the gripper: up to the torso and down the arm. Worked by hand: at these readings the
/// head has turned by a, the arm by b and c about parallel axes.
#[test]
fn a_chain_through_a_common_ancestor() {
    let folder = tempfile::tempdir().unwrap();
    let drawing = folder.path().join("p.json");
    let line = "import urdf {0} --base camera --tool gripper -o {1}";
    assert_eq!(gough(line, &[&case("11-head-camera-to-gripper.urdf"), &drawing]).status, 0);
    let readings = folder.path().join("readings.json");
    let (a, b, c) = (0.4_f64, -0.3_f64, 0.7_f64);
    fs::write(&readings, format!("{{\"samples\": [{{\"actuators\": [{a}, {b}, {c}]}}]}}")).unwrap();
    let out = folder.path().join("poses.json");
    done("predict {0} --actuators {1} -o {2}", &[&drawing, &readings, &out]);
    let found = poses(&json(&out), (1.0, 1.0))[0];
    // Gripper in the torso, then in the turned head, then in the camera.
    let in_torso = nalgebra::Vector3::new(0.3 * b.cos(), -0.2, 0.3 - 0.3 * b.sin());
    let head = nalgebra::Rotation3::from_axis_angle(&nalgebra::Vector3::z_axis(), a);
    let in_camera = head.inverse() * (in_torso - nalgebra::Vector3::new(0.0, 0.0, 0.5))
        - nalgebra::Vector3::new(0.1, 0.0, 0.1);
    let turned = head.inverse() * nalgebra::Rotation3::from_axis_angle(&nalgebra::Vector3::y_axis(), b + c);
    assert!((found.p - in_camera).norm() < 1e-12, "{} {in_camera}", found.p);
    assert!((found.r - turned.matrix()).norm() < 1e-12);
}

#[test]
fn a_base_beside_the_chain() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("p.json");
    let ran =
        gough("import urdf {0} --base base --tool tool0 -o {1}", &[&case("11-kr6-base-frame.urdf"), &out]);
    assert_eq!(ran.status, 0, "{ran:?}");
    let joints = json(&out)["mechanism"]["limbs"][0]["joints"].as_array().unwrap().len();
    assert_eq!(joints, 6);
}

#[test]
fn the_axis_of_a_fixed_joint_means_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("p.json");
    let ran = gough("import urdf {0} --base a --tool c -o {1}", &[&case("axis-zero-fixed.urdf"), &out]);
    assert_eq!(ran.status, 0, "{ran:?}");
}

#[test]
fn a_blank_first_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("blank.urdf");
    fs::write(&path, format!("\n{}", fs::read_to_string(case("11-kr6-base-frame.urdf")).unwrap())).unwrap();
    let out = folder.path().join("p.json");
    let ran = gough("import urdf {0} --base base --tool tool0 -o {1}", &[&path, &out]);
    assert!(ran.status == 2 && ran.stderr.contains("remove"), "{ran:?}");
    assert!(ran.stderr.contains("<?xml"), "{ran:?}");
}
