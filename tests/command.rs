//! Commanded readings and predicted poses are each other's inverse.

mod support;

use gough::design::candidates::Candidates;
use gough::files::{DataPlaces, read_problem};
use gough::lie::{Se3, so3};
use gough::model::Mechanism;
use gough::model::command::{command, outside_range};
use gough::model::mechanism::pose_difference;
use gough::simulate::close;
use nalgebra::{DMatrix, DVector, Vector3};
use support::{apart, done, errors, file, gough, json, name, poses, problems, units, write};

/// The true machine of a problem, which no axis of meets or is square.
fn machine(name: &str) -> Mechanism {
    let path = file(&format!("problems/{name}.json"));
    let problem = read_problem(&path, &DataPlaces::from_environment(None)).unwrap();
    problem.truth.unwrap_or(problem.mechanism)
}

/// Both ways on every machine: the pose of the commanded readings is the wanted one, and near the readings that a pose
/// was predicted from the command finds them again.
#[test]
fn predict_and_command_are_inverse_on_every_problem() {
    for path in problems() {
        let name = name(&path);
        let machine = machine(&name);
        let geometry = machine.nominal();
        let home = vec![0.0; machine.actuator_count()];
        let length = machine.characteristic_length();
        let (mut forth, mut back) = (0.0_f64, 0.0_f64);
        for candidate in Candidates::random(&machine, 12, 9, 5e-2).fit {
            let pose = candidate.pose;
            let found = command(&machine, &geometry, &home, &pose, [true; 6])
                .unwrap_or_else(|why| panic!("{name}: {:?}: {why}", candidate.actuators));
            let reached = close(&machine, &geometry, &found.actuators).unwrap().tool();
            let (w, dp) = pose_difference(&pose, &reached);
            forth = forth.max(w.norm()).max(dp.norm() / length);
            // From nearby, so that of several solutions it is the same one.
            let near: Vec<f64> = candidate.actuators.iter().map(|a| a + 1e-3).collect();
            let again = command(&machine, &geometry, &near, &pose, [true; 6]).unwrap();
            if name != "serial-kuka-lbr" {
                let off = again.actuators.iter().zip(&candidate.actuators).map(|(a, b)| (a - b).abs());
                back = off.fold(back, f64::max);
            }
        }
        println!("{name}: pose {forth:.1e}, readings {back:.1e}");
        assert!(forth < 1e-10, "{name}: {forth}");
        assert!(back < 1e-10, "{name}: {back}");
    }
}

/// A tripod follows height and two tilts; what it does with the others is stated.
#[test]
fn a_tripod_follows_what_it_can() {
    let machine = machine("tripod-3rps");
    let geometry = machine.nominal();
    let home = close(&machine, &geometry, &[0.0; 3]).unwrap().tool();
    let turn = so3::exp(&Vector3::new(0.05, -0.03, 0.02));
    let wanted = Se3 { r: turn * home.r, p: home.p + Vector3::new(0.01, -0.02, 0.015) };
    assert!(command(&machine, &geometry, &[0.0; 3], &wanted, [true; 6]).is_err());
    let followed = [true, true, false, false, false, true];
    let found = command(&machine, &geometry, &[0.0; 3], &wanted, followed).unwrap();
    let reached = close(&machine, &geometry, &found.actuators).unwrap().tool();
    let (w, dp) = pose_difference(&wanted, &reached);
    for (i, (value, stated)) in w.iter().chain(dp.iter()).zip(found.residual.iter()).enumerate() {
        assert!((value - stated).abs() < 1e-14);
        assert!(if followed[i] { value.abs() < 1e-10 } else { value.abs() > 1e-4 }, "{i}: {value}");
    }
}

/// The first-order motion of a redundant arm is the least-norm solution for the Jacobian by finite differences.
#[test]
fn a_redundant_arm_moves_least() {
    let machine = machine("serial-kuka-lbr");
    let geometry = machine.nominal();
    let start = [0.3, 0.5, -0.4, 0.9, 0.2, -0.7, 0.1];
    let at = |q: &[f64]| close(&machine, &geometry, q).unwrap().tool();
    let from = at(&start);
    let length = machine.characteristic_length();
    let column =
        |(w, dp): (Vector3<f64>, Vector3<f64>)| [w.x, w.y, w.z, dp.x / length, dp.y / length, dp.z / length];
    let mut jac = DMatrix::zeros(6, 7);
    for j in 0..7 {
        let moved =
            |h: f64| at(&std::array::from_fn::<f64, 7, _>(|i| start[i] + if i == j { h } else { 0.0 }));
        let difference = column(pose_difference(&moved(1e-6), &moved(-1e-6)));
        (0..6).for_each(|i| jac[(i, j)] = difference[i] / 2e-6);
    }
    let size = 1e-5;
    let wanted = Se3 {
        r: so3::exp(&Vector3::new(0.0, size, -size)) * from.r,
        p: from.p + Vector3::new(size, 0.0, size),
    };
    let error = DVector::from_row_slice(&column(pose_difference(&wanted, &from)));
    let least = jac.clone().svd(true, true).solve(&error, 1e-9).unwrap();
    let found = command(&machine, &geometry, &start, &wanted, [true; 6]).unwrap();
    for ((found, start), least) in found.actuators.iter().zip(start).zip(least.iter()) {
        assert!((found - start - least).abs() < 1e-3 * least.abs().max(size), "{found} {start} {least}");
    }
}

#[test]
fn commands_go_from_file_to_file() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    // mm and degrees, and readings that are not zero at home.
    let problem = file("problems/hexapod-640.json");
    let units = units(&json(&problem));
    let mut readings = json(&problem)["data"]["holdout"].clone();
    if readings.is_null() {
        readings = json(&problem)["data"].clone();
    }
    let samples = serde_json::json!({"samples": readings["samples"]});
    let wanted = write(folder.path(), "wanted.json", &samples);
    done("predict {0} --actuators {1} -o {2}", &[&problem, &wanted, &at("predicted.csv")]);
    let ran = done("command {0} --poses {1} -o {2}", &[&problem, &at("predicted.csv"), &at("commands.json")]);
    assert!(ran.stdout.is_empty());
    done("predict {0} --actuators {1} -o {2}", &[&problem, &wanted, &at("predicted.json")]);
    done("predict {0} --actuators {1} -o {2}", &[&problem, &at("commands.json"), &at("again.json")]);
    let (a, b) = (json(&at("predicted.json")), json(&at("again.json")));
    let off = errors(&poses(&a, units), &poses(&b, units));
    assert!(off.position_max < 1e-10 && off.rotation_max < 1e-10, "{off:?}");
    // The measured poses: each within the noise of the readings they were measured at; poses without readings.
    let text = std::fs::read_to_string(at("predicted.csv")).unwrap();
    let bare: Vec<String> =
        text.lines().map(|line| line.split(',').skip(6).collect::<Vec<_>>().join(",")).collect();
    std::fs::write(at("bare.csv"), bare.join("\n")).unwrap();
    let ran = done("command {0} --poses {1}", &[&problem, &at("bare.csv")]);
    std::fs::write(at("commands.csv"), &ran.stdout).unwrap();
    done("predict {0} --actuators {1} -o {2}", &[&problem, &at("commands.csv"), &at("again.json")]);
    for (a, b) in poses(&a, units).iter().zip(&poses(&json(&at("again.json")), units)) {
        let (rotation, position) = apart(a, b);
        assert!(rotation < 1e-10 && position < 1e-10);
    }
}

#[test]
fn what_cannot_be_commanded_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let hexapod = file("problems/hexapod-6ups.json");
    let tripod = file("problems/tripod-3rps.json");
    let pose = |name: &str, p: [f64; 3], w: [f64; 3]| {
        let sample = serde_json::json!({"pose": {"position": p, "rotation": w}});
        write(folder.path(), name, &serde_json::json!({"samples": [sample]}))
    };
    let refused = |line: &str, paths: &[&std::path::Path], words: &[&str]| {
        let ran = gough(line, paths);
        assert!(ran.status == 2 && ran.stdout.is_empty(), "{line}: {ran:?}");
        assert_eq!(ran.stderr.trim_end().lines().count(), 1, "{ran:?}");
        for word in words {
            assert!(ran.stderr.contains(word), "{word}: {ran:?}");
        }
    };
    let high = pose("high.json", [0.0, 0.0, 1.1], [0.0; 3]);
    refused(
        "command {0} --poses {1}",
        &[&hexapod, &high],
        &["sample 1", "leave the drawn range", "limb1.leg"],
    );
    let ran = gough("command {0} --poses {1} --beyond-range", &[&hexapod, &high]);
    assert!(ran.status == 0 && ran.stderr.starts_with("warning: readings leave"), "{ran:?}");
    let aside = pose("aside.json", [0.1, 0.0, 0.6], [0.0, 0.0, 0.3]);
    refused("command {0} --poses {1}", &[&tripod, &aside], &["sample 1", "out of reach", "--free"]);
    let ran = gough(
        "command {0} --poses {1} --free tx,ty,rz",
        &[&tripod, &pose("up.json", [0.1, 0.0, 0.62], [0.02, 0.0, 0.3])],
    );
    assert!(ran.status == 0 && ran.stderr.contains("sample 1: rz"), "{ran:?}");
    refused("command {0} --poses {1} --free tx,up", &[&tripod, &aside], &["`up`", "tx, ty, tz, rx, ry, rz"]);
    refused("command {0} --poses {1} --free tx,ty,tz,rx,ry,rz", &[&tripod, &aside], &["leave one"]);
    let arm = file("problems/serial-puma560.json");
    let far = pose("far.json", [5.0, 0.0, 0.0], [0.0; 3]);
    refused("command {0} --poses {1}", &[&arm, &far], &["sample 1", "out of reach"]);
    assert_eq!(outside_range(&machine("hexapod-6ups"), &[0.0, 0.5, 0.0, -0.5, 0.0, 0.0]), [1, 3]);
}
