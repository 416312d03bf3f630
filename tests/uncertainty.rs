//! Stated uncertainty against the spread over simulated runs; cross-validation by formula against refitting.

mod support;

use gough::calibration::Sample;
use gough::files::{DataPlaces, ProblemFile, read_problem};
use gough::identify::{Folds, Identification, cross_validate, identify, pose_covariances};
use gough::lie::{Se3, so3};
use gough::measure::Pose;
use gough::model::{Geometry, Mechanism, Posture};
use gough::simulate::{close, draw_deviations, draw_postures};
use gough::solve::{Identifier, Stop, registry};
use nalgebra::{Matrix6, Vector6};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use std::path::Path;
use std::sync::Arc;
use support::{GOLDEN, file, golden, problems};

/// Postures at which predictions are judged.
const JUDGED: usize = 10;

fn problem(path: &Path) -> ProblemFile {
    read_problem(path, &DataPlaces { data_dir: None, shared: "no such folder".into() }).unwrap()
}

fn identified(machine: &Mechanism, samples: &[Sample], solver: &dyn Identifier) -> Identification {
    identify(machine, samples, solver, &Stop::default()).unwrap()
}

/// Errors `[w; dp]` of predicted poses and the covariances stated of them, in one run with a machine and noise of its own.
/// `None` where the machine drawn does not close everywhere.
fn run(
    drawn: &Mechanism,
    covariance: &Matrix6<f64>,
    postures: &[Vec<f64>],
    solver: &str,
    seed: u64,
) -> Option<Vec<(Vector6<f64>, Matrix6<f64>)>> {
    let truth = drawn.deviated(&draw_deviations(drawn, seed, 1.0));
    let root = covariance.cholesky().unwrap().l();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(9);
    let tool = |geometry: &Geometry, q: &[f64]| close(drawn, geometry, q).ok().map(|p| p.tool());
    let mut samples = Vec::new();
    for (k, q) in postures[JUDGED..].iter().enumerate() {
        let g = tool(&truth, q)?;
        let e: Vector6<f64> = root * Vector6::from_fn(|_, _| StandardNormal.sample(&mut rng));
        let read =
            Se3 { r: so3::exp(&e.fixed_rows::<3>(0).into_owned()) * g.r, p: g.p + e.fixed_rows::<3>(3) };
        let measurement = Arc::new(Pose::new(read, [true; 6], covariance).unwrap());
        samples.push(Sample { name: format!("sample {k}"), actuators: q.clone(), measurement });
    }
    let found = identified(drawn, &samples, registry::find(solver).unwrap().as_ref());
    assert!(found.report.outcome.converged(), "{solver}, seed {seed}: {}", found.report.outcome);
    let machine = found.calibrated();
    let closed: Option<Vec<(Vec<f64>, Posture)>> = postures[..JUDGED]
        .iter()
        .map(|q| Some((q.clone(), close(drawn, &found.geometry, q).ok()?)))
        .collect();
    let closed = closed?;
    let stated = pose_covariances(&machine, &closed, &found.link_root().unwrap()).unwrap();
    closed
        .iter()
        .zip(stated)
        .map(|((q, posture), stated)| {
            let (g, at) = (tool(&truth, q)?, posture.tool());
            let w = so3::log(&(at.r * g.r.transpose()));
            let dp = at.p - g.p;
            Some((Vector6::new(w.x, w.y, w.z, dp.x, dp.y, dp.z), stated.total))
        })
        .collect()
}

/// Spread of the errors over the runs by what is stated: of each component, and of all six jointly.
fn ratios(drawn: &ProblemFile, solver: &str, runs: u64) -> ([f64; 6], f64) {
    let (machine, nominal) = (&drawn.mechanism, drawn.mechanism.nominal());
    let covariance = drawn.data.noise.unwrap();
    let postures = draw_postures(machine, &[&nominal], JUDGED + 40, 1).unwrap();
    let all: Vec<_> =
        (0..runs).into_par_iter().map(|s| run(machine, &covariance, &postures, solver, s)).collect();
    let all: Vec<_> = all.into_iter().flatten().collect();
    assert!(all.len() as u64 > runs / 2, "{}: {} of {runs} machines close", drawn.name, all.len());
    let (mut square, mut variance, mut joint) = ([0.0; 6], [0.0; 6], 0.0);
    let count = (all.len() * JUDGED) as f64;
    for (error, stated) in all.iter().flatten() {
        for i in 0..6 {
            square[i] += error[i] * error[i];
            variance[i] += stated[(i, i)];
        }
        // A platform of fewer freedoms errs in all six components, but may do so in step: compare in the noise's units.
        let scale = Matrix6::from_fn(|i, j| if i == j { covariance[(i, i)].sqrt().recip() } else { 0.0 });
        let scaled = scale * stated * scale + Matrix6::identity() * 1e-6;
        let e = scale * error;
        joint += e.dot(&(scaled.try_inverse().unwrap() * e)) / 6.0;
    }
    (std::array::from_fn(|i| (square[i] / variance[i]).sqrt()), (joint / count).sqrt())
}

fn shown(name: &str, solver: &str, (each, joint): &([f64; 6], f64)) {
    let each: Vec<String> = each.iter().map(|v| format!("{v:.3}")).collect();
    eprintln!("{name:24} {solver:9} {}  {joint:.3}", each.join(" "));
}

#[test]
fn predicted_poses_spread_as_stated() {
    let cases = [
        (golden("hexapod-6ups", "problem.json"), "minimal", 60),
        (golden("tripod-3rps", "problem.json"), "minimal", 100),
        (golden("serial-6r", "problem.json"), "minimal", 100),
        (file("problems/tripod-3prs.json"), "map", 100),
        (golden("hexapod-6pus", "problem.json"), "limbwise", 60),
    ];
    for (path, solver, runs) in cases {
        let drawn = problem(&path);
        let found = ratios(&drawn, solver, runs);
        shown(&drawn.name, solver, &found);
        assert!(found.0.iter().all(|ratio| (ratio - 1.0).abs() < 0.15), "{}: {found:?}", drawn.name);
        assert!((found.1 - 1.0).abs() < 0.15, "{}: {found:?}", drawn.name);
    }
}

/// The table of docs/identifiability.md: `cargo test --release --test uncertainty -- --ignored --nocapture`.
#[test]
#[ignore = "minutes: 200 runs of every machine"]
fn predicted_poses_of_every_machine_spread_as_stated() {
    let golden = GOLDEN.iter().map(|case| golden(case, "problem.json"));
    let mut worst = 0.0_f64;
    for path in problems().into_iter().chain(golden) {
        let drawn = problem(&path);
        let found = ratios(&drawn, "minimal", 200);
        shown(&drawn.name, "minimal", &found);
        worst = found.0.iter().fold(worst, |m, ratio| m.max((ratio - 1.0).abs()));
    }
    assert!(worst < 0.15, "{worst:.3}");
}

#[test]
fn cross_validation_by_formula_is_what_refitting_gives() {
    let parts = |count| Folds::Parts { count, seed: 3 };
    let cases = [
        (golden("hexapod-6ups", "problem.json"), "minimal", parts(10)),
        (golden("hexapod-6pus", "problem.json"), "map", parts(6)),
        (golden("tripod-3rps", "problem.json"), "minimal", Folds::LeaveOneOut),
        (golden("serial-6r", "problem.json"), "minimal", Folds::LeaveOneOut),
        (file("problems/tripod-3rrs.json"), "minimal", parts(5)),
        (file("problems/positioner-321.json"), "map", Folds::LeaveOneOut),
    ];
    for (path, solver, folds) in cases {
        let drawn = problem(&path);
        let identifier = registry::find(solver).unwrap();
        let samples = &drawn.data.samples;
        let found = identified(&drawn.mechanism, samples, identifier.as_ref());
        let stop = Stop::default();
        let by_formula = cross_validate(&found, samples, folds, identifier.as_ref(), &stop).unwrap().unwrap();
        assert!(by_formula.refitted * 4 <= by_formula.folds, "{}: {by_formula:?}", drawn.name);
        // The same identification, but one that linear theory is told not to describe: every fold is refitted.
        let mut other = found.clone();
        other.report.estimate = gough::solve::Estimate::Other;
        let by_refit = cross_validate(&other, samples, folds, identifier.as_ref(), &stop).unwrap().unwrap();
        assert_eq!(by_refit.refitted, by_refit.folds);
        let pairs = [
            (by_formula.fit.weighted_rms, by_refit.fit.weighted_rms),
            (by_formula.fit.position.unwrap().rms, by_refit.fit.position.unwrap().rms),
            (by_formula.fit.rotation.unwrap().rms, by_refit.fit.rotation.unwrap().rms),
        ];
        let worst = pairs.iter().map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max);
        eprintln!(
            "{}: {:.4} and {:.4}, {worst:.1e} apart; {} of {} folds refitted",
            drawn.name, pairs[0].0, pairs[0].1, by_formula.refitted, by_formula.folds
        );
        assert!(worst < 0.05, "{}: {pairs:?}", drawn.name);
        // Left out postures are predicted worse than those that were fitted, but hardly.
        let fitted = found.fit.1.unwrap().weighted_rms;
        assert!(pairs[0].0 > fitted && pairs[0].0 < 2.0 * fitted, "{}: {pairs:?} {fitted}", drawn.name);
    }
}

/// What the tests of the residual say where the truth is known.
#[test]
fn verdicts_on_known_troubles() {
    use gough::identify::verdict::{Cause, Size};
    use gough::identify::{Judged, Judgement, judge};
    use gough::measure::Weights;
    let drawn = problem(&golden("tripod-3rps", "problem.json"));
    let minimal = registry::find("minimal").unwrap();
    let stop = Stop::default();
    let judged = |samples: &[Sample]| -> Judgement {
        let found = identified(&drawn.mechanism, samples, minimal.as_ref());
        judge(&Judged {
            found: &found,
            samples,
            sets: &[],
            holdout: &[],
            stated: true,
            identifier: minimal.as_ref(),
            stop: &stop,
        })
    };
    let samples = drawn.data.samples.clone();
    let clean = judged(&samples);
    assert!(clean.is_clean() && clean.total.unwrap().size() == Size::Explained, "{clean:?}");
    assert!((0.001..0.999).contains(&clean.total.unwrap().probability), "{clean:?}");
    // Stated as half, and as twice, of what it is (2e-5 rad, 1e-5 m).
    let stated = |scale: f64| -> Vec<Sample> {
        let weights = Weights::Isotropic { angle: 2e-5 * scale, length: 1e-5 * scale };
        let again = |s: &Sample| Sample { measurement: s.measurement.reweighted(weights), ..s.clone() };
        samples.iter().map(again).collect()
    };
    for (scale, word) in [(0.5, "understated"), (2.0, "overstated")] {
        let found = judged(&stated(scale));
        let [Cause::Noise(noise)] = found.causes.as_slice() else { panic!("{found:?}") };
        assert!(noise.sentence().contains(word), "{noise:?}");
        assert!((found.total.unwrap().ratio() * scale - 1.0).abs() < 0.1, "{found:?}");
    }
    // One reading of an actuator is wrong by a millimetre.
    let mut wrong = samples.clone();
    wrong[7].actuators[0] += 1e-3;
    let found = judged(&wrong);
    assert!(matches!(found.causes.as_slice(), [Cause::Outliers(_)]), "{found:?}");
    assert_eq!(found.outliers.len(), 1);
    assert_eq!(found.outliers[0].outlier.name, samples[7].name);
    // The first actuator errs by a wave of its reading, which no link explains.
    let mut bent = samples.clone();
    for sample in &mut bent {
        sample.actuators[0] += 1.5e-4 * (40.0 * sample.actuators[0]).sin();
    }
    let found = judged(&bent);
    eprintln!("{}", found.sentence().unwrap());
    assert!(matches!(found.causes.first(), Some(Cause::Model(_))), "{found:?}");
}
