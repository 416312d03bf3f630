//! Poses of every drawing against tests/data/independent, which tests/generate/poses.py computed with NumPy.

mod support;

use support::{done, errors, file, json, name, poses, problems, units};

#[test]
fn every_machine_predicts_the_independent_poses() {
    // The five files delta-v400 draw one machine.
    let real = ["franka-fr3", "hexapod-nategh-agheli", "ur5", "wam", "delta-v400-491e4ed6"]
        .map(|name| file(&format!("problems/real/{name}.json")));
    let mut worst = (0.0, 0.0);
    for problem in problems().iter().chain(&real) {
        let independent = file("tests/data/independent").join(format!("{}.json", name(problem)));
        let ran = done("predict {0} --actuators {1}", &[problem, &independent]);
        let units = units(&json(problem));
        let predicted = poses(&serde_json::from_str(&ran.stdout).unwrap(), units);
        // Rotations are compared as matrices: at 180 degrees two rotation vectors mean the same.
        let found = errors(&predicted, &poses(&json(&independent), units));
        assert!(
            predicted.len() == 10 && found.rotation_max <= 1e-9 && found.position_max <= 1e-9,
            "{}: {found:?}",
            problem.display()
        );
        worst = (f64::max(worst.0, found.rotation_max), f64::max(worst.1, found.position_max));
    }
    eprintln!("worst of all: {:.1e} rad, {:.1e} m", worst.0, worst.1);
}
