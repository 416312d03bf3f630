//! Wanted poses that readings within the ranges make are followed within the ranges; plans hold postures that real machines
//! reach.

mod support;

use gough::design::{Candidates, RealMachines};
use gough::files::{DataPlaces, read_model, read_problem};
use gough::model::command::{command, outside_range};
use gough::model::mechanism::pose_difference;
use gough::model::{Geometry, Mechanism};
use gough::simulate::{actuator_ranges, close, draw_deviations};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::path::{Path, PathBuf};
use support::{done, errors, file, gough, json, poses, units, write};

fn case(name: &str) -> PathBuf {
    file(&format!("tests/data/cases/command/{name}"))
}

/// The pose of a file is followed, and predictions from the readings lead to it.
fn followed(machine: &Path, wanted: &Path) {
    let folder = tempfile::tempdir().unwrap();
    let (commands, predicted) = (folder.path().join("commands.json"), folder.path().join("predicted.json"));
    let ran = done("command {0} --poses {1} -o {2}", &[machine, wanted, &commands]);
    assert!(ran.stderr.is_empty(), "{ran:?}");
    done("predict {0} --actuators {1} -o {2}", &[machine, &commands, &predicted]);
    let units = units(&json(machine));
    let off = errors(&poses(&json(wanted), units), &poses(&json(&predicted), units));
    assert!(off.position_max < 1e-9 && off.rotation_max < 1e-9, "{off:?}");
}

#[test]
fn an_arm_of_seven_joints_finds_readings_within_its_ranges() {
    followed(&case("command-7r-result.json"), &case("command-7r-pose.json"));
}

/// Twelve drives, six of them in the wrist: readings within the ranges are known.
#[test]
fn redundant_drives_find_readings_within_their_ranges() {
    let machine = case("command-hybrid-wrist-result.json");
    followed(&machine, &case("command-hybrid-wrist-pose.json"));
    let folder = tempfile::tempdir().unwrap();
    let predicted = folder.path().join("predicted.json");
    done(
        "predict {0} --actuators {1} -o {2}",
        &[&machine, &case("command-hybrid-wrist-readings.json"), &predicted],
    );
    followed(&machine, &predicted);
}

/// Where no readings within the ranges make the pose, the nearest are named with what they lack.
#[test]
fn what_comes_nearest_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let sample = serde_json::json!({"pose": {"position": [0.0, 0.0, 0.75], "rotation": [0.0, 0.0, 0.2]}});
    let wanted = write(folder.path(), "high.json", &serde_json::json!({"samples": [sample]}));
    let ran = gough("command {0} --poses {1}", &[&case("command-hybrid-wrist-result.json"), &wanted]);
    assert!(ran.status == 2 && ran.stdout.is_empty(), "{ran:?}");
    for word in ["sample 1 (limb1.leg 0.01", "m above", "none within it were found, these come nearest"] {
        assert!(ran.stderr.contains(word), "{word}: {ran:?}");
    }
}

/// Positions alone are commanded where the rotation is given up; where it is not, that is what the message says.
#[test]
fn positions_alone_are_commanded_where_rotations_are_given_up() {
    let folder = tempfile::tempdir().unwrap();
    let arm = file("problems/serial-puma560.json");
    let (table, sample) =
        (folder.path().join("wanted.csv"), serde_json::json!({"pose": {"position": [0.3, 0.1, 0.9]}}));
    std::fs::write(&table, "x,y,z\n0.3,0.1,0.9\n").unwrap();
    let list = write(folder.path(), "wanted.json", &serde_json::json!({"samples": [sample]}));
    for wanted in [table, list] {
        let out = folder.path().join("readings.json");
        let refused = gough("command {0} --poses {1} -o {2}", &[&arm, &wanted, &out]);
        assert!(refused.status == 2 && refused.stderr.contains("--free rx,ry,rz"), "{refused:?}");
        let some = gough("command {0} --poses {1} --free rz -o {2}", &[&arm, &wanted, &out]);
        assert!(some.status == 2 && some.stderr.contains("--free rx,ry,rz"), "{some:?}");
        let ran = gough("command {0} --poses {1} --free rx,ry,rz -o {2}", &[&arm, &wanted, &out]);
        assert_eq!(ran.status, 0, "{ran:?}");
        let predicted = folder.path().join("predicted.json");
        done("predict {0} --actuators {1} -o {2}", &[&arm, &out, &predicted]);
        let position = &json(&predicted)["samples"][0]["pose"]["position"];
        for (i, wanted) in [0.3, 0.1, 0.9].into_iter().enumerate() {
            assert!((position[i].as_f64().unwrap() - wanted).abs() < 1e-9, "{position}");
        }
    }
    // A part of a position is none.
    let part = folder.path().join("part.csv");
    std::fs::write(&part, "x,y,z\n0.3,,0.9\n").unwrap();
    let refused = gough("command {0} --poses {1} --free rx,ry,rz", &[&arm, &part]);
    assert!(refused.status == 2 && refused.stderr.contains("component is missing"), "{refused:?}");
}

/// A true machine of a problem, or of a result.
fn machine(path: &Path) -> Mechanism {
    let model = read_model(path).unwrap();
    let truth =
        read_problem(path, &DataPlaces::from_environment(None)).ok().and_then(|problem| problem.truth);
    truth.unwrap_or(model.mechanism)
}

/// Ranges of the driven revolute joints set to `half` on either side.
fn turning(mut machine: Mechanism, half: f64) -> Mechanism {
    for joint in machine.limbs.iter_mut().flat_map(|limb| &mut limb.joints).filter(|joint| joint.actuated) {
        if joint.motion.is_angular() {
            joint.range = Some((joint.home - half, joint.home + half));
        }
    }
    machine
}

/// Poses made from random readings within the ranges are commanded from home: how many there are, and how many are not
/// followed within the ranges.
fn campaign(machine: &Mechanism, count: usize, seed: u64) -> (usize, usize) {
    let (geometry, ranges) = (machine.nominal(), actuator_ranges(machine));
    let home = vec![0.0; machine.actuator_count()];
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (mut made, mut refused) = (0, 0);
    for _ in 0..20 * count {
        if made == count {
            break;
        }
        let readings: Vec<f64> =
            ranges.iter().map(|(low, high)| low + rng.random::<f64>() * (high - low)).collect();
        let Ok(posture) = close(machine, &geometry, &readings) else { continue };
        if posture.regularity() < 1e-3 && !machine.is_open_chain() {
            continue;
        }
        let pose = posture.tool();
        made += 1;
        match command(machine, &geometry, &home, &pose, [true; 6]) {
            Ok(found) if outside_range(machine, &found.actuators).is_empty() => {
                let (w, dp) =
                    pose_difference(&pose, &close(machine, &geometry, &found.actuators).unwrap().tool());
                assert!(w.norm() < 1e-9 && dp.norm() < 1e-9, "{readings:?}: {w} {dp}");
            }
            other => {
                println!("{readings:?}: {other:?}");
                refused += 1;
            }
        }
    }
    (made, refused)
}

#[test]
fn poses_made_from_readings_in_range_are_followed_in_range() {
    for (name, count) in [("command-7r-result.json", 8), ("command-hybrid-wrist-result.json", 6)] {
        assert_eq!(campaign(&machine(&case(name)), count, 5), (count, 0), "{name}");
    }
    for name in ["serial-kuka-lbr", "serial-ur10", "tripod-3rrs", "hexapod-ballscrew"] {
        let machine = machine(&file(&format!("problems/{name}.json")));
        assert_eq!(campaign(&machine, 6, 5), (6, 0), "{name}");
    }
    // Cranks that turn by half a turn to either side.
    let machine = turning(machine(&file("problems/hexapod-6rus.json")), 3.1);
    assert_eq!(campaign(&machine, 6, 5), (6, 0));
}

#[test]
#[ignore = "270 poses and more on twelve machines: a minute"]
fn poses_of_twelve_machines_are_followed_in_range() {
    let mut all = vec![
        ("arm of seven joints", machine(&case("command-7r-result.json"))),
        ("hybrid wrist", machine(&case("command-hybrid-wrist-result.json"))),
    ];
    for name in [
        "serial-kuka-lbr",
        "real/franka-fr3",
        "real/wam",
        "serial-puma560",
        "hexapod-6pus",
        "tricept",
        "tripod-3prs",
    ] {
        all.push((name, machine(&file(&format!("problems/{name}.json")))));
    }
    for (name, half) in [("hexapod-6rus", 5.5), ("tripod-3rrs", 5.5), ("hexapod-ballscrew", 5.5)] {
        all.push((name, turning(machine(&file(&format!("problems/{name}.json"))), half)));
    }
    for (name, machine) in all {
        let (made, refused) = campaign(&machine, 30, 11);
        println!("{name}: {refused} of {made} not followed");
        assert_eq!(refused, 0, "{name}");
    }
}

/// Share of the postures of a plan that machines drawn from the tolerances reach: other machines than those by which the
/// plan was judged.
fn share_reached(machine: &Mechanism, plan: &[Vec<f64>], machines: u64) -> f64 {
    let (mut reached, mut all) = (0, 0);
    for seed in 1..=machines {
        let geometry: Geometry = machine.deviated(&draw_deviations(machine, seed, 1.0));
        all += plan.len();
        reached += plan.iter().filter(|actuators| close(machine, &geometry, actuators).is_ok()).count();
    }
    reached as f64 / all as f64
}

/// Readings of the plan of 20 that `gough plan` makes, as variables of the actuators, and what it says.
fn planned(path: &Path, machine: &Mechanism) -> (Vec<Vec<f64>>, String) {
    let folder = tempfile::tempdir().unwrap();
    let plan = folder.path().join("plan.csv");
    // Few random postures of such a machine close, which is a warning.
    let ran = gough("plan {0} --poses 20 --random 600 -o {1}", &[path, &plan]);
    assert_eq!(ran.status, 0, "{ran:?}");
    let rows = gough::files::read_actuators(&plan, &read_model(path).unwrap()).unwrap();
    assert_eq!(rows[0].variables.len(), machine.actuator_count());
    (rows.into_iter().map(|row| row.variables).collect(), ran.stdout)
}

/// A wrist of three U-P-U limbs near its singular postures: plans for the drawing were reached by 76 to 83 % of its real
/// machines.
#[test]
fn a_plan_holds_postures_that_real_machines_reach() {
    let path = case("upu-wrist.json");
    let machine = read_model(&path).unwrap().mechanism;
    let (plan, said) = planned(&path, &machine);
    let share = share_reached(&machine, &plan, 60);
    assert!(share >= 0.98, "{share}");
    assert!(
        ["99.", "100.0 %"].iter().any(|share| {
            said.contains(&format!(
                "of 200 machines drawn from the tolerances, none of which chose the postures, {share}"
            ))
        }),
        "{said}"
    );
    // The plan that was made for the drawing alone, tried on one of its real machines.
    let true_machine = case("plan-upu-wrist-a-true-machine.json");
    let real = read_model(&true_machine).unwrap();
    let postures = gough::files::read_actuators(&case("plan-upu-wrist.csv"), &real).unwrap();
    let candidates = postures.into_iter().map(|row| (row.name, row.variables)).collect();
    let drawn = Candidates::admit(&machine, candidates, 0.01);
    assert_eq!(drawn.fit.len(), 20);
    let judged = RealMachines::drawn(&machine).reaching(&machine, drawn, 1);
    assert!(judged.fit.len() < 20, "{}", judged.fit.len());
    // Candidates that nobody judged are reached less often.
    let drawn = Candidates::random(&machine, 200, 3, 0.01).fit;
    let judged =
        RealMachines::drawn(&machine).reaching(&machine, Candidates { fit: drawn.clone(), unfit: vec![] }, 1);
    assert!(judged.fit.len() < drawn.len() && judged.unfit.len() == drawn.len() - judged.fit.len());
    // An arm reaches every posture: nothing is said.
    let arm = file("problems/serial-ur10.json");
    let folder = tempfile::tempdir().unwrap();
    let ran = done("plan {0} --poses 10 --random 100 -o {1}", &[&arm, &folder.path().join("plan.csv")]);
    assert!(!ran.stdout.contains("machines drawn"), "{ran:?}");
}

#[test]
#[ignore = "plans of ten machines: a minute"]
fn plans_of_ten_machines_are_reached() {
    let names = "delta-3puu hexapod-6pus hexapod-6rus hexapod-6ucu hexapod-6ups hexapod-ballscrew hexapod-squat tricept \
                 tripod-3prs tripod-3rps tripod-3rrs tripod-3upu";
    let mut paths: Vec<PathBuf> =
        names.split_whitespace().map(|name| file(&format!("problems/{name}.json"))).collect();
    paths.push(case("upu-wrist.json"));
    for path in paths {
        let machine = read_model(&path).unwrap().mechanism;
        let (plan, _) = planned(&path, &machine);
        let share = share_reached(&machine, &plan, 200);
        println!("{}: {share}", path.display());
        assert!(share >= 0.98, "{}: {share}", path.display());
    }
}
