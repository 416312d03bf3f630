//! Claims of docs/theory.md that no other test holds: numbers by quadrature and from the definitions, and the constants
//! that it names against the source.

mod random_machine;
mod support;

use faer::Mat;
use gough::calibration::Calibration;
use gough::files::problem::parse_model;
use gough::files::{DataPlaces, read_problem};
use gough::identify::counts::visibility;
use gough::identify::covariance::variance;
use gough::identify::identify;
use gough::lie::so3;
use gough::linalg::singular_values;
use gough::model::mobility;
use gough::model::passive::PassiveSplit;
use gough::problem::{Form, Problem};
use gough::simulate::draw_deviations;
use gough::solve::split::prior_weight;
use gough::solve::{Estimate, Failure, Outcome, Stop, registry};
use nalgebra::{DMatrix, Matrix3, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use random_machine::random_samples;
use serde_json::{Value, json};
use std::f64::consts::PI;
use std::path::Path;
use support::file;

fn normal(x: f64) -> f64 {
    (-0.5 * x * x).exp() / (2.0 * PI).sqrt()
}

/// The trapezoidal rule, which errs by less than rounding for what falls off like a normal density.
fn integral(limit: f64, count: usize, of: impl Fn(f64) -> f64) -> f64 {
    let step = 2.0 * limit / count as f64;
    (0..=count).map(|k| step * of(-limit + step * k as f64)).sum()
}

/// Section 13: the reference of one truth is above what estimates reach on the average, and (13.3) is below it.
#[test]
fn the_reference_at_one_truth_is_no_bound() {
    let reading = |z: f64| 8.0 * (5.0 * z).tanh();
    let information = |z: f64| (40.0 / (5.0 * z).cosh().powi(2)).powi(2);
    let at_truths = integral(9.0, 4000, |z| normal(z) / (information(z) + 1.0));
    let van_trees = 1.0 / (integral(9.0, 4000, |z| normal(z) * information(z)) + 1.0);
    let prior: Vec<(f64, f64, f64)> =
        (0..=1200).map(|k| -9.0 + 0.015 * f64::from(k)).map(|z| (z, reading(z), normal(z))).collect();
    let posterior = integral(14.0, 1200, |y| {
        let moments = prior.iter().fold([0.0; 3], |sum, (z, mean, density)| {
            let weight = 0.015 * density * normal(y - mean);
            [sum[0] + weight, sum[1] + weight * z, sum[2] + weight * z * z]
        });
        moments[2] - moments[1] * moments[1] / moments[0].max(f64::MIN_POSITIVE)
    });
    let found = [at_truths, posterior, van_trees];
    for (found, stated) in found.into_iter().zip([0.615, 0.269, 0.006]) {
        assert!((found - stated).abs() < 5e-4, "{found} {stated}");
    }
}

/// (3.2): orthonormal wrenches without power on the passive twists, oriented; passive motions of least squares.
#[test]
fn wrenches_and_passive_motions_are_those_of_the_definition() {
    let mut rng = ChaCha8Rng::seed_from_u64(31);
    for m in 0..=6 {
        for _ in 0..20 {
            let columns: Vec<[f64; 6]> =
                (0..m).map(|_| std::array::from_fn(|_| rng.random_range(-1.0..1.0))).collect();
            let twist: [f64; 6] = std::array::from_fn(|_| rng.random_range(-1.0..1.0));
            let mut split = PassiveSplit::rigid();
            split.factor(&columns);
            let passive = DMatrix::from_fn(6, m, |i, j| columns[j][i]);
            let wrenches = DMatrix::from_fn(6 - m, 6, |i, j| split.wrenches()[i][j]);
            let power = if m == 0 || m == 6 { 0.0 } else { (&wrenches * &passive).amax() };
            let unit = &wrenches * wrenches.transpose() - DMatrix::identity(6 - m, 6 - m);
            assert!(power < 1e-14 && unit.iter().all(|v| v.abs() < 1e-14), "{m}: {power:.1e}");
            let all = DMatrix::from_fn(6, 6, |i, j| if j < m { columns[j][i] } else { wrenches[(j - m, i)] });
            assert!(m == 6 || all.determinant() > 0.0, "{m}");
            // The motions that come closest leave a twist that is square to all passive ones.
            let motions = split.motions(&twist);
            for column in &columns {
                let left = |i: usize| twist[i] - (0..m).map(|j| columns[j][i] * motions[j]).sum::<f64>();
                let along: f64 = (0..6).map(|i| column[i] * left(i)).sum();
                let size = motions.iter().fold(1.0_f64, |most, v| most.max(v.abs()));
                assert!(along.abs() < 1e-13 * size, "{m}: {along:.1e}");
            }
            for (k, motion) in motions.iter().enumerate().take(m) {
                let by: f64 = split.motion_covector(k).iter().zip(&twist).map(|(c, t)| c * t).sum();
                assert!((by - motion).abs() < 1e-12 * motion.abs().max(1.0), "{m}: {by} {motion}");
            }
        }
    }
}

/// (6.4) and (10.1): the prior fades without a step, and a direction's variance is that of its two parts.
#[test]
fn weights_fade_and_variances_follow_them() {
    let ends = [prior_weight(0.0), prior_weight(1.0), prior_weight(10.0), prior_weight(1e3)];
    assert_eq!(ends, [1.0, 1.0, 0.0, 0.0]);
    for k in 0..=90 {
        let s = 1.0 + 0.1 * f64::from(k);
        assert!((prior_weight(s) - (1.0 / (s * s) - 0.01) / 0.99).abs() < 1e-15);
        let w = prior_weight(s);
        let split = variance(Estimate::Split { threshold: 1.0 }, s).unwrap();
        let scale = (s * s + w).powi(2);
        assert!((split.total - (s * s + w * w) / scale).abs() < 1e-15);
        assert!((split.prior - w * w / scale).abs() < 1e-15);
        let full = variance(Estimate::Ridge { weight: 1.0 }, s).unwrap();
        let none = variance(Estimate::LeastSquares, s).unwrap();
        assert!((full.total - 1.0 / (s * s + 1.0)).abs() < 1e-15);
        assert!((none.total - 1.0 / (s * s)).abs() < 1e-15 && none.prior == 0.0);
    }
    // At s = 10 a unit prior would shift an estimate by a tenth of its standard error, one tolerance off.
    let (shift, error) = (1.0 / 101.0, 0.1);
    assert!((shift / error - 0.1_f64).abs() < 1e-3);
}

/// Section 8: variances of rotations across a rotation vector of length `theta`.
#[test]
fn common_rotations_count_more_across_a_large_error() {
    for theta in [0.01_f64, 0.1, 0.5, 1.0, 2.0, 3.0] {
        let inverse = so3::left_jacobian_inverse(&Vector3::new(theta, 0.0, 0.0));
        let spread = inverse * inverse.transpose();
        let factor = (0.5 * theta / (0.5 * theta).sin()).powi(2);
        let wanted = Matrix3::from_diagonal(&Vector3::new(1.0, factor, factor));
        assert!((spread - wanted).amax() < 1e-14 * factor);
        assert!(theta > 0.5 || (factor - 1.0 - theta * theta / 12.0).abs() < theta.powi(4) / 200.0);
    }
}

/// Section 8: every rotation is within 63 degrees of one of the 24 of a cube.
#[test]
fn a_rotation_of_a_cube_is_near_enough_to_any() {
    let turns = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| so3::exp(&(axis * (0.5 * PI))));
    let mut cube = vec![Matrix3::identity()];
    let mut next = 0;
    while next < cube.len() {
        for turn in &turns {
            let new = turn * cube[next];
            if cube.iter().all(|known| (known - new).amax() > 0.5) {
                cube.push(new);
            }
        }
        next += 1;
    }
    assert_eq!(cube.len(), 24);
    let mut rng = ChaCha8Rng::seed_from_u64(33);
    let mut farthest: f64 = 0.0;
    for _ in 0..20_000 {
        let q: [f64; 4] = std::array::from_fn(|_| {
            let [a, b]: [f64; 2] = std::array::from_fn(|_| rng.random_range(f64::MIN_POSITIVE..1.0));
            (-2.0 * a.ln()).sqrt() * (2.0 * PI * b).cos()
        });
        let vector = Vector3::new(q[1], q[2], q[3]);
        let rotation = so3::exp(&(vector.normalize() * (2.0 * vector.norm().atan2(q[0]))));
        // trace R = 1 + 2 cos angle
        let trace = cube.iter().map(|of| of.dot(&rotation)).fold(-1.0, f64::max);
        farthest = farthest.max((0.5 * (trace - 1.0)).acos());
    }
    let degrees = farthest.to_degrees();
    assert!(degrees < 63.0 && degrees > 58.0, "{degrees}");
}

/// (10.12): readings that follow each other with correlation rho tell as little of what all share as is said.
#[test]
fn correlated_readings_inflate_as_said() {
    for rho in [0.3_f64, 0.6, 0.9] {
        let count = 20_000;
        let sum: f64 = (1..count).map(|lag| 2.0 * f64::from(count - lag) * rho.powi(lag)).sum();
        let inflation = (1.0 + sum / f64::from(count)).sqrt();
        assert!((inflation / ((1.0 + rho) / (1.0 - rho)).sqrt() - 1.0).abs() < 1e-3, "{rho}: {inflation}");
    }
}

/// (9.3): the derivative of the coordinates of the equivalent description, and that it vanishes along the redundancy.
#[test]
fn the_equivalent_description_has_the_stated_derivative() {
    let places = DataPlaces { data_dir: None, shared: "no such folder".into() };
    for name in ["serial-puma560", "tripod-3rps", "serial-scara-screw"] {
        let read = read_problem(&file(&format!("problems/{name}.json")), &places).unwrap();
        let samples = read.data.samples[..3].to_vec();
        let at = draw_deviations(&read.mechanism, 5, 20.0);
        let problem = Calibration::new(&read.mechanism, &samples, Form::Complete, &at);
        let x = problem.coordinates().nearest(&at);
        let here = problem.representative(&x).unwrap();
        let step = 1e-3;
        let moved = |i: usize, by: f64| {
            let mut moved = x.clone();
            moved[i] += by;
            problem.representative(&moved).unwrap().z
        };
        let largest = here.jac.norm_max();
        for i in 0..x.len() {
            let (ahead, behind) = (moved(i, step), moved(i, -step));
            for (k, (a, b)) in ahead.iter().zip(&behind).enumerate() {
                let difference = (a - b) / (2.0 * step);
                let apart = (here.jac[(k, i)] - difference).abs();
                assert!(apart < 1e-7 * largest, "{name} {k} {i}: {apart:.1e}");
            }
        }
        let along = &here.jac * problem.redundant(&x);
        assert!(along.norm_max() < 1e-10 * largest, "{name}: {:.1e}", along.norm_max());
    }
}

/// Rank of the complete Jacobian of a machine of two limbs, the first of which has these joints (small letters: passive),
/// and its structural count.
fn seen_and_counted(first: &str, rng: &mut ChaCha8Rng) -> (usize, usize) {
    let vector = |rng: &mut ChaCha8Rng, size: f64| -> [f64; 3] {
        std::array::from_fn(|_| rng.random_range(-size..size))
    };
    let mechanism = loop {
        let limb = |joints: &str, rng: &mut ChaCha8Rng| -> Value {
            let joints: Vec<Value> = joints
                .chars()
                .map(|joint| {
                    let kind = if joint.eq_ignore_ascii_case(&'p') { "prismatic" } else { "revolute" };
                    json!({"type": kind, "point": vector(rng, 0.5), "axis": vector(rng, 2.0),
                           "actuated": joint.is_ascii_uppercase()})
                })
                .collect();
            json!({ "joints": joints })
        };
        let limbs = [limb(first, rng), limb("rRrRrrR", rng)];
        let file = json!({"format": "gough-problem/1", "units": {"length": "m", "angle": "rad"},
            "mechanism": {"tool": {"position": vector(rng, 0.5), "rotation": vector(rng, 2.0)},
                          "tolerance": {"angle": 1e-3, "length": 5e-4}, "limbs": limbs}});
        let Ok(model) = parse_model(Path::new("random.json"), file.to_string().as_bytes()) else { continue };
        let Ok(home) = mobility::check(&model.mechanism, &model.mechanism.nominal()) else { continue };
        let s = home.wrench_singular_values();
        if s[5] > 0.05 * s[0] && home.splits.iter().all(|split| split.smallest_pivot() > 0.15) {
            break model.mechanism;
        }
    };
    let samples = random_samples(&mechanism, 40, 0.4, false, rng);
    let at = draw_deviations(&mechanism, 27, 10.0);
    let problem = Calibration::new(&mechanism, &samples, Form::Complete, &at);
    let x = problem.coordinates().nearest(&at);
    let jac: Mat<f64> = problem.linearize(&x).unwrap().jac;
    let s = singular_values(jac.as_ref()).unwrap();
    let seen = s.iter().filter(|v| **v > 1e-10 * s[0]).count();
    (seen, problem.coordinates().slice_count())
}

/// Section 4: (25) is an upper limit where passive slides of a limb follow each other.
#[test]
fn passive_slides_that_follow_each_other_are_counted_twice() {
    let mut rng = ChaCha8Rng::seed_from_u64(34);
    for (limb, too_many) in [("RppRRR", 2), ("RpPpRR", 3), ("RpRpRR", 0), ("RprRRR", 0), ("RpPrRR", 0)] {
        let (seen, counted) = seen_and_counted(limb, &mut rng);
        assert_eq!(counted - seen, too_many, "{limb}: {seen} of {counted}");
    }
}

/// Section 5: the counts of the 6-UPS, at nominal and at the true machine; what full steps without safeguards do to it.
#[test]
fn counts_of_a_hexapod_and_full_steps_on_it() {
    let places = DataPlaces { data_dir: None, shared: "no such folder".into() };
    let read = read_problem(&file("problems/hexapod-6ups.json"), &places).unwrap();
    let (machine, samples) = (&read.mechanism, &read.data.samples);
    let truth = read.truth.as_ref().unwrap().nominal().deviations_from(&machine.nominal());
    for (at, wanted) in [(vec![0.0; truth.len()], (138, 66, 57)), (truth, (138, 138, 57))] {
        let counts = visibility(machine, samples, &at).unwrap().counts;
        assert_eq!((counts.structural, counts.first_order, counts.practical), wanted);
    }
    let textbook = registry::find("textbook").unwrap();
    let found = identify(machine, samples, textbook.as_ref(), &Stop::default()).unwrap();
    assert!(
        matches!(found.report.outcome, Outcome::Failed(Failure::Evaluation(_))),
        "{}",
        found.report.outcome
    );
    assert_eq!(found.report.trace.len(), 1);
}

/// Section 14: `| value | file | constant | ...`.
#[test]
fn constants_are_those_of_the_source() {
    let text = std::fs::read_to_string(file("docs/theory.md")).unwrap();
    let section = text.split("\n## ").find(|part| part.starts_with("14 ")).unwrap();
    let rows: Vec<Vec<&str>> = section
        .lines()
        .filter(|line| line.starts_with("| ") && line.contains(".rs`"))
        .map(|line| line.split('|').map(|cell| cell.trim().trim_matches('`')).collect())
        .collect();
    assert!(rows.len() > 60, "{}", rows.len());
    for row in rows {
        let (stated, path, name) = (row[1], row[2], row[3]);
        let source = std::fs::read_to_string(file("src").join(path)).unwrap();
        let number = |text: &str| text.replace('_', "").trim_end_matches(".0").parse::<f64>();
        let found = source.lines().find_map(|line| {
            let (head, value) = line.trim().split_once(" = ")?;
            head.contains(&format!("const {name}:")).then(|| value.trim_end_matches(';').to_owned())
        });
        let found = found.unwrap_or_else(|| panic!("{path} has no {name}"));
        // Pairs and quotients are compared as they are written.
        let same = match (number(&found), number(stated)) {
            (Ok(found), Ok(stated)) => found == stated,
            _ => found == stated,
        };
        assert!(same, "{path} {name}: {found}, not {stated}");
        assert!(row[4].len() > 3 && row[5].len() > 3, "{path} {name} has no reason");
    }
}
