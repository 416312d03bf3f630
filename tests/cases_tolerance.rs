//! Tolerances that the deviations contradict; nonsense without stated noise; estimates that converge.

mod support;

use gough::calibration::representative::representative;
use gough::calibration::{Calibration, Coordinates, Sample};
use gough::files::{DataPlaces, ProblemFile, read_problem};
use gough::identify::counts::visibility;
use gough::identify::{Evidence, ToleranceVerdict, identify, pose_covariances};
use gough::lie::{Se3, so3};
use gough::linalg;
use gough::measure::Pose;
use gough::model::{Geometry, Mechanism, Posture, Prior, Tolerance};
use gough::problem::{Form, Problem};
use gough::simulate::{Plan, close, simulate};
use gough::solve::map::Map;
use gough::solve::minimal::Minimal;
use gough::solve::{Stop, registry};
use nalgebra::{DMatrix, DVector, Vector3};
use std::path::PathBuf;
use std::sync::Arc;
use support::{GOLDEN, Ran, done, file, golden, gough, json};

fn case(name: &str) -> PathBuf {
    file("tests/data/cases").join(name)
}

fn problem(path: &std::path::Path) -> ProblemFile {
    read_problem(path, &DataPlaces { data_dir: None, shared: "no such folder".into() }).unwrap()
}

/// Identifies a case whose truth is `factor` tolerances off.
fn factor_is_named(name: &str, factor: f64, written: &str) {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("result.json");
    let path = case(name);
    let Ran { status, stdout, stderr } = gough("identify {0} -o {1}", &[&path, &output]);
    assert_eq!(status, 0, "{stderr}");
    let result = json(&output);
    let named = &result["tolerance_factor"];
    let value = named["value"].as_f64().unwrap();
    assert!((0.8..1.25).contains(&(value / factor)), "{name}: {named}");
    assert!(named["probability"].as_f64().unwrap() < 1e-50, "{named}");
    assert_eq!(named["in_force"].as_f64().unwrap(), value);
    let (low, high) = (named["interval"][0].as_f64().unwrap(), named["interval"][1].as_f64().unwrap());
    assert!(low < factor && factor < high, "{named}");
    assert!(stdout.contains("what the stated tolerances make them"), "{stdout}");
    let told = stderr.contains("estimate, standard errors and predictions are those of tolerances");
    assert!(told && stderr.contains(written), "{stderr}");
    // The residual is explained then, and the tolerances of the drawing are not replaced in the result.
    assert!(result["chi_square"]["probability"].as_f64().unwrap() > 0.001, "{}", result["chi_square"]);
    let drawn = problem(&path);
    let again = gough::files::read_model(&output).unwrap();
    let links = |m: &Mechanism| m.limbs[0].links[1].tolerance;
    assert_eq!(links(&again.mechanism), links(&drawn.mechanism));
    // Stated intervals of predicted poses hold the true poses at the readings of the hold-out.
    let samples = &drawn.data.samples;
    let found = identify(&drawn.mechanism, samples, &Minimal::default(), &Stop::default()).unwrap();
    let truth = drawn.truth.as_ref().unwrap();
    let closed = |machine: &Mechanism, geometry: &Geometry| -> Vec<(Vec<f64>, Posture)> {
        let held_out = drawn.holdout.samples.iter().map(|sample| sample.actuators.clone());
        held_out.map(|q| (q.clone(), close(machine, geometry, &q).unwrap())).collect()
    };
    let postures = closed(&found.start, &found.geometry);
    let stated = pose_covariances(&found.calibrated(), &postures, &found.link_root().unwrap()).unwrap();
    let (mut held, mut count) = (0, 0);
    let pairs = postures.iter().zip(closed(truth, &truth.nominal()));
    for (((_, posture), (_, truth)), stated) in pairs.zip(stated) {
        let (at, truth) = (posture.tool(), truth.tool());
        let w = so3::log(&(at.r * truth.r.transpose()));
        let dp = at.p - truth.p;
        for (error, std) in w.iter().chain(dp.iter()).zip(stated.std()) {
            held += usize::from(error.abs() <= 1.96 * std);
            count += 1;
        }
    }
    assert!(10 * held > 8 * count, "{name}: {held} of {count}");
    // A report has the covariance of the result.
    let page = folder.path().join("page.html");
    done("report {0} --problem {1} -o {2}", &[&output, &path, &page]);
    let page = std::fs::read_to_string(&page).unwrap();
    assert!(page.contains("tolerances in force, times the stated ones"));
}

#[test]
fn delta_six_tolerances_off() {
    factor_is_named("tolerance/delta-3ruu-tol6.json", 6.0, "\"angle\": 0.0060");
}

#[test]
fn arm_five_tolerances_off() {
    factor_is_named("tolerance/tolerance5-ur10.json", 5.0, "\"length\": 0.005");
}

#[test]
fn hexapod_ten_tolerances_off() {
    factor_is_named("tolerance/stewart-6-3-10-1.json", 10.0, "\"angle\": 0.010");
}

#[test]
fn tolerances_that_are_right_raise_no_alarm() {
    for case in GOLDEN {
        let path = golden(case, "problem.json");
        let ran = done("identify {0}", &[&path]);
        assert!(ran.stdout.contains("the stated tolerances explain the deviations"), "{}", ran.stdout);
    }
}

#[test]
fn nonsense_without_noise_is_not_converged() {
    let path = case("setup/silent-nonsense-ur10-j3-reversed-no-noise.json");
    for line in ["identify {0} --holdout 0.2", "identify {0}", "identify {0} --solver map"] {
        let ran = gough(line, &[&path]);
        assert_eq!(ran.status, 1, "{ran:?}");
        let told =
            ran.stderr.contains("nothing was identified: no direction is known better than its tolerance");
        assert!(told && ran.stderr.contains("gough check"), "{}", ran.stderr);
    }
}

/// Sound data without stated noise end well.
#[test]
fn sense_without_noise_is() {
    let folder = tempfile::tempdir().unwrap();
    for case in GOLDEN {
        let mut value = json(&golden(case, "problem.json"));
        value["data"].as_object_mut().unwrap().remove("noise");
        let path = support::write(folder.path(), "problem.json", &value);
        let ran = gough("identify {0} --holdout 0.2", &[&path]);
        assert_eq!(ran.status, 0, "{ran:?}");
    }
}

/// `log det(I + F^2 J J') + r'(...)^-1 r` written out, with free components as ones of an immense tolerance.
#[test]
fn evidence_is_the_marginal_likelihood() {
    let all = Tolerance { angle: Prior::Free, length: Prior::Free };
    for free in ["nothing", "a link", "the placement"] {
        let mut drawn = problem(&golden("serial-6r", "problem.json"));
        match free {
            "a link" => drawn.mechanism.limbs[0].links[0].tolerance = all,
            "the placement" => drawn.mechanism.ends.placement = Some(all),
            _ => {}
        }
        let samples = &drawn.data.samples[..12];
        let mechanism = &drawn.mechanism;
        let at = vec![0.0; mechanism.component_count()];
        let problem = Calibration::new(mechanism, samples, Form::Minimal, &at);
        let seen = visibility(mechanism, samples, &at).unwrap();
        let x = vec![0.0; problem.params().len()];
        let evidence = Evidence::at(mechanism, &problem, &x, &seen).unwrap();
        let complete = Calibration::new(mechanism, samples, Form::Complete, &at);
        let zeros = vec![0.0; complete.params().len()];
        let dense = complete.linearize(&zeros).unwrap();
        let (m, n) = (dense.jac.nrows(), dense.jac.ncols());
        let jac = DMatrix::from_fn(m, n, |i, j| dense.jac[(i, j)]);
        let r = DVector::from_column_slice(&dense.r);
        // The motion's six columns stand behind those of the links.
        let (stated, unknown) = match free {
            "a link" => (jac.columns(6, n - 6), jac.columns(0, 6)),
            "the placement" => (jac.columns(0, n - 6), jac.columns(n - 6, 6)),
            _ => (jac.columns(0, n), jac.columns(0, 0)),
        };
        let written = |factor: f64| {
            let covariance = DMatrix::identity(m, m)
                + stated * stated.transpose() * (factor * factor)
                + unknown * unknown.transpose() * 1e2;
            let factored = covariance.cholesky().unwrap();
            let determinant: f64 = factored.l().diagonal().iter().map(|v| 2.0 * v.ln()).sum();
            -0.5 * (determinant + r.dot(&factored.solve(&r)))
        };
        for factor in [0.3, 2.0, 10.0] {
            let ours = evidence.likelihood(factor, 1.0) - evidence.likelihood(1.0, 1.0);
            let theirs = written(factor) - written(1.0);
            // Directions fainter than 0.3 are left out of ours.
            assert!((ours - theirs).abs() < 0.02 * theirs.abs() + 0.1, "{free} {factor}: {ours} {theirs}");
        }
    }
}

/// The test under its own hypothesis, drawn from it: alarms as often as stated, intervals that hold the factor.
#[test]
fn test_is_as_sharp_as_it_says() {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    let strengths: Vec<f64> = (0..40).map(|k| 1000.0 * 0.75f64.powi(k)).collect();
    let mut test = |factor: f64| {
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let readings = strengths.iter().map(|s| (1.0 + (factor * s).powi(2)).sqrt() * normal()).collect();
        Evidence { strengths: strengths.clone(), readings }.test(1.0, 1.0).unwrap()
    };
    let count = 4000;
    let (mut below, mut alarms, mut held) = (0, 0, 0);
    for _ in 0..count {
        let test = test(1.0);
        below += usize::from(test.probability < 0.05);
        alarms += usize::from(test.verdict == ToleranceVerdict::TooSmall);
        held += usize::from(test.interval.0 <= 1.0 && 1.0 <= test.interval.1);
    }
    let share = |of: usize| of as f64 / f64::from(count);
    assert!((0.035..0.065).contains(&share(below)), "{}", share(below));
    assert!(share(alarms) < 0.004, "{}", share(alarms));
    assert!((0.93..0.97).contains(&share(held)), "{}", share(held));
    let named = (0..200).filter(|_| (0.8..1.25).contains(&(test(3.0).factor / 3.0))).count();
    assert!(named > 160, "{named}");
}

/// Noisy poses of a true machine that deviates by `distance` tolerances and stands elsewhere by `placed`.
fn simulated(drawn: &ProblemFile, distance: f64, seed: u64, placed: Se3) -> (Geometry, Vec<Sample>) {
    let noise = drawn.data.noise.unwrap();
    let plan = Plan { poses: 40, holdout: 0, seed, noise: 1.0, distance };
    let simulated = simulate(&drawn.mechanism, &noise, &plan).unwrap();
    let sample = |(actuators, pose): &(Vec<f64>, Se3)| Sample {
        name: "sample".into(),
        actuators: actuators.clone(),
        measurement: Arc::new(Pose::new(placed * *pose, [true; 6], &noise).unwrap()),
    };
    (simulated.truth, simulated.samples.iter().map(sample).collect())
}

fn factors_are_named(drawn: &ProblemFile, machine: &Mechanism, placed: Se3) {
    for (distance, alarm) in [(1.0, false), (3.0, true), (6.0, true)] {
        for seed in 1..=4 {
            let (_, samples) = simulated(drawn, distance, seed, placed);
            let found = identify(machine, &samples, &Minimal::default(), &Stop::default()).unwrap();
            let test = found.tolerance_test.unwrap();
            assert_eq!(test.verdict == ToleranceVerdict::TooSmall, alarm, "{distance} {seed}: {test:?}");
            assert!((0.65..1.6).contains(&(test.factor / distance)), "{distance} {seed}: {test:?}");
            assert_eq!(test.in_force, if alarm { test.factor } else { 1.0 });
        }
    }
}

/// A part of `examples/tolerances.rs`.
#[test]
fn factors_of_an_arm_are_named() {
    let drawn = problem(&golden("serial-6r", "problem.json"));
    factors_are_named(&drawn, &drawn.mechanism, Se3::identity());
}

/// What all limbs share and nothing states says nothing of tolerances, and does not hide them.
#[test]
fn factors_beside_a_free_placement_are_named() {
    let drawn = problem(&golden("serial-6r", "problem.json"));
    let mut machine = drawn.mechanism.clone();
    machine.ends.placement = Some(Tolerance { angle: Prior::Free, length: Prior::Free });
    let placed = Se3 { r: so3::exp(&Vector3::new(0.3, -0.2, 0.9)), p: Vector3::new(0.5, -1.2, 0.3) };
    factors_are_named(&drawn, &machine, placed);
}

/// At six tolerances the curvature of the residual all but cancels the prior along some directions of this hexapod: steps
/// that do not see it contract by 0.99. What is found is where the gradient vanishes, and its intervals hold the truth.
#[test]
fn flat_valleys_are_followed_to_their_end() {
    let drawn = problem(&case("tolerance/stewart-6-3-10-1.json"));
    let (truth, samples) = simulated(&drawn, 6.0, 28, Se3::identity());
    let found = identify(&drawn.mechanism, &samples, &Map::default(), &Stop::default()).unwrap();
    let test = found.tolerance_test.unwrap();
    assert!(found.report.outcome.converged() && (4.8..7.5).contains(&test.in_force), "{test:?}");
    let at = found.geometry.deviations_from(&found.supported.nominal());
    let problem = Calibration::new(&found.supported, &samples, Form::Minimal, &at);
    let x = problem.coordinates().nearest(&at);
    let (_, of_cost) = problem.gradient(&x).unwrap();
    let left: Vec<f64> = of_cost.iter().zip(&x).map(|(g, x)| g + x).collect();
    // Gradient over curvature: how far the point is off along each direction, in tolerances.
    let seen = found.visibility.as_ref().unwrap();
    let along = linalg::mul_transpose(seen.directions.as_ref(), &left);
    let off = along.iter().zip(&seen.singular_values).map(|(g, s)| g / (1.0 + (s * test.in_force).powi(2)));
    let farthest = off.fold(0.0f64, |a, off| a.max(off.abs()));
    assert!(farthest < 1e-3, "{farthest}");
    let errors = found.standard_errors().unwrap();
    let truth =
        Coordinates::new(&found.start, Form::Minimal).deviations(&representative(&found.start, &truth));
    let told: Vec<usize> = (0..errors.len()).filter(|&i| errors[i] > 1e-9).collect();
    let held = told.iter().filter(|&&i| (truth[i] - found.deviations[i]).abs() <= 1.96 * errors[i]).count();
    assert!(held as f64 > 0.9 * told.len() as f64, "{held} of {}", told.len());
}

#[test]
fn limits_and_robust_losses_are_not_tested() {
    let drawn = problem(&golden("serial-6r", "problem.json"));
    for name in ["conic-huber", "conic-bounded", "textbook"] {
        let solver = registry::find(name).unwrap();
        let found =
            identify(&drawn.mechanism, &drawn.data.samples, solver.as_ref(), &Stop::default()).unwrap();
        assert!(found.tolerance_test.is_none_or(|test| test.in_force == 1.0), "{name}");
    }
}

/// The default ends where `map` does, on problems whose weak directions lead along curved valleys.
fn converges(name: &str, noise: f64) {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("result.json");
    let ran = gough("identify {0} -o {1}", &[&case(name), &output]);
    assert_eq!(ran.status, 0, "{ran:?}");
    let result = json(&output);
    let holdout = result["holdout"]["after"]["weighted_rms"].as_f64().unwrap();
    assert!(holdout < noise, "{name}: {holdout}");
    assert!(
        result["chi_square"]["probability"].as_f64().unwrap() > 0.001,
        "{name}: {}",
        result["chi_square"]
    );
    assert!(!ran.stderr.contains("stand out") && !ran.stderr.contains("stands out"), "{}", ran.stderr);
}

#[test]
fn wrist_from_separations_converges() {
    converges("statistics/bad-upu-wrist-separation-tol-115.json", 1.2);
}

#[test]
fn delta_from_mixed_readings_converges() {
    converges("statistics/bad-delta-3ruu-mixed-free-106.json", 0.8);
}
