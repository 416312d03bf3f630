//! Machines that are drawn and identified without a file: what files are refused for, they are refused for.

use gough::calibration::Sample;
use gough::files::{DataPlaces, MechanismBuilder, read_problem};
use gough::identify::{IdentifyError, identify};
use gough::lie::Se3;
use gough::measure::Pose;
use gough::model::joint::frame_on_axis;
use gough::model::{Ends, Joint, Limb, Link, Mechanism, Motion, Tolerance};
use gough::solve::{Stop, registry};
use nalgebra::{Matrix6, Vector3};
use std::sync::Arc;

/// Begins an arm of one joint.
fn arm() -> MechanismBuilder {
    let tolerance = Tolerance::sigma(1e-3, 1e-3);
    Mechanism::builder().tolerance(tolerance).tool(Se3::translation(0.5, 0.0, 0.0)).limb("arm")
}

fn refused(builder: MechanismBuilder) -> String {
    builder.build().expect_err("refused").to_string()
}

#[test]
fn a_machine_in_code_is_the_machine_of_its_file() {
    let file = read_problem(
        "problems/tripod-3rps.json".as_ref(),
        &DataPlaces { data_dir: None, shared: "no such folder".into() },
    )
    .unwrap();
    let drawing = &file.drawing.mechanism;
    let mut builder = Mechanism::builder();
    let units = file.units;
    for limb in &drawing.limbs {
        builder = builder.limb(limb.name.as_ref().unwrap());
        for joint in &limb.joints {
            let point = joint.point.map(|x| units.to_metres(x));
            let name = joint.name.as_ref().unwrap();
            builder = match joint.kind.as_str() {
                "revolute" => builder.revolute(name, point, joint.axis.unwrap()),
                "prismatic" => builder.prismatic(name, point, joint.axis.unwrap()),
                "spherical" => builder.spherical(name, point),
                other => panic!("{other}"),
            };
            if joint.actuated.is_some() {
                builder = builder.actuated();
            }
        }
    }
    let first = &file.mechanism.limbs[0];
    let tool = file.mechanism.nominal().home_frames(0).pop().unwrap();
    let machine = builder.tool(tool).tolerance(first.links[0].tolerance).build().unwrap();
    assert_eq!(machine.actuator_count(), file.mechanism.actuator_count());
    for (made, read) in machine.limbs.iter().zip(&file.mechanism.limbs) {
        for (made, read) in made.joints.iter().zip(&read.joints) {
            assert_eq!((made.motion, made.actuated), (read.motion, read.actuated));
            let off = made.frame.inverse() * read.frame;
            // Axes of a ball may be drawn otherwise.
            assert!(off.p.amax() < 1e-12, "{}", made.name);
        }
        let (made, read) = (made.links.last().unwrap(), read.links.last().unwrap());
        assert_eq!(made.tolerance, read.tolerance);
    }
}

#[test]
fn what_a_file_is_refused_for_is_refused_in_code_by_name() {
    let z = [0.0, 0.0, 1.0];
    let cases = [
        (Mechanism::builder(), "no limb"),
        (Mechanism::builder().revolute("a", [0.0; 3], z), "\"a\" comes before the first limb"),
        (arm().actuated(), "\"actuated\" comes before the first joint"),
        (arm(), "no joints"),
        (arm().revolute("a", [0.0; 3], [0.0; 3]).actuated(), "arm.a"),
        (arm().revolute("a", [f64::NAN, 0.0, 0.0], z).actuated(), "arm.a"),
        (arm().revolute("a", [0.0; 3], z), "no joint is actuated"),
        (arm().revolute("a", [0.0; 3], z).actuated().revolute("a", [0.1, 0.0, 0.0], z).actuated(), "arm.a"),
        (arm().helical("a", [0.0; 3], z, 0.0).actuated(), "pitch"),
        (arm().revolute("a", [0.0; 3], z).actuated().range(1.0, -1.0), "range"),
        (
            arm().revolute("a", [0.0; 3], z).actuated().joint_tolerance(Tolerance::sigma(-1.0, 1e-3)),
            "tolerance",
        ),
        (
            arm().revolute("a", [0.0; 3], z).actuated().joint_tolerance(Tolerance::sigma(f64::NAN, 1e-3)),
            "tolerance",
        ),
        (arm().revolute("a", [0.0; 3], z).revolute("b", [0.1, 0.0, 0.0], z).actuated(), "under-actuated"),
        (
            Mechanism::builder().limb("arm").revolute("a", [0.0; 3], z).actuated().tool(Se3::identity()),
            "tolerance",
        ),
        (arm().tool(Se3 { r: 2.0 * nalgebra::Matrix3::identity(), p: Vector3::zeros() }), "rotation matrix"),
    ];
    for (builder, word) in cases {
        let message = refused(builder);
        assert!(message.contains(word) && message.starts_with("machine drawn in code"), "{word}: {message}");
    }
}

/// A chain of `passive` joints and one that is driven, with the first `links` of its links.
fn by_hand(passive: usize, links: usize) -> Mechanism {
    let tolerance = Tolerance::sigma(1e-3, 1e-3);
    let joint = |k: usize| Joint {
        name: format!("j{k}"),
        motion: Motion::Revolute,
        frame: frame_on_axis(
            Vector3::new(0.1 * k as f64, 0.02 * (k * k) as f64, 0.0),
            &Vector3::new(0.3 * k as f64, 1.0, (k % 2) as f64),
        ),
        actuated: k >= passive,
        sensed: false,
        home: 0.0,
        range: None,
    };
    let joints: Vec<Joint> = (0..passive + 1).map(joint).collect();
    let mut at = Se3::identity();
    let mut all = Vec::new();
    for joint in &joints {
        let nominal = at.inverse() * joint.frame;
        all.push(Link { name: joint.name.clone(), nominal, tolerance, bounds: None });
        at = joint.frame;
    }
    all.push(Link { name: "tool".into(), nominal: Se3::identity(), tolerance, bounds: None });
    all.truncate(links);
    let limb = Limb { name: "arm".into(), joints, links: all };
    Mechanism { limbs: vec![limb], instrument: Vec::new(), ends: Ends::default() }
}

fn identified(machine: &Mechanism, readings: usize) -> Result<bool, IdentifyError> {
    let sample = |k: usize| Sample {
        name: format!("sample {k}"),
        actuators: vec![0.1 * k as f64; readings],
        measurement: Arc::new(Pose::new(Se3::identity(), [true; 6], &Matrix6::identity()).unwrap()),
    };
    let samples: Vec<Sample> = (0..5).map(sample).collect();
    let minimal = registry::find("minimal").unwrap();
    identify(machine, &samples, minimal.as_ref(), &Stop::default())
        .map(|found| found.report.outcome.converged())
}

/// cases/library/invalid.rs.
#[test]
fn machines_that_are_none_are_refused_by_name() {
    let empty = Mechanism { limbs: Vec::new(), instrument: Vec::new(), ends: Ends::default() };
    let mut endless = by_hand(0, 99);
    endless.limbs[0].links[0].nominal.p.x = f64::INFINITY;
    let mut untold = by_hand(0, 99);
    untold.limbs[0].links[0].tolerance = Tolerance::sigma(f64::NAN, 1e-3);
    for (machine, readings, word) in [
        (empty, 0, "no limb"),
        (by_hand(7, 99), 1, "can spin"),
        (by_hand(0, 1), 1, "arm is no limb"),
        (by_hand(0, 0), 1, "arm is no limb"),
        (by_hand(0, 99), 0, "sample 0: 0 readings"),
        (by_hand(1, 99), 1, "under-actuated"),
        (endless, 1, "not finite"),
        (untold, 1, "tolerance"),
    ] {
        let message = identified(&machine, readings).expect_err(word).to_string();
        assert!(message.contains(word), "{word}: {message}");
    }
    assert_eq!(identified(&by_hand(0, 99), 1), Ok(true));
}
