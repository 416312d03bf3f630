//! Constrained, sparse and robust results, checked against what they minimise: written out here once more, and
//! compared with other machines nearby.

mod support;

use gough::calibration::representative::representative;
use gough::calibration::{Calibration, Coordinates, Sample};
use gough::compare::objective::judged;
use gough::compare::offset::relative_offset;
use gough::files::{DataPlaces, ProblemFile, read_problem};
use gough::identify::{Identification, identify};
use gough::problem::{Form, Problem};
use gough::solve::{Identifier, Stop, registry};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

fn problem(path: &str) -> ProblemFile {
    let places = DataPlaces { data_dir: None, shared: "no such folder".into() };
    read_problem(path.as_ref(), &places).unwrap()
}

fn puma() -> ProblemFile {
    problem("problems/serial-puma560.json")
}

fn found(problem: &ProblemFile, name: &str, settings: &[(&str, &str)]) -> Identification {
    let mut identifier = registry::find(name).unwrap();
    settings.iter().for_each(|(key, value)| identifier.set(key, value).unwrap());
    stopped(problem, identifier.as_ref(), &Stop::default())
}

fn stopped(problem: &ProblemFile, identifier: &dyn Identifier, stop: &Stop) -> Identification {
    let name = identifier.name();
    let found = identify(&problem.mechanism, &problem.data.samples, identifier, stop).unwrap();
    assert!(found.report.outcome.converged(), "{name}: {}", found.report.outcome);
    found
}

/// Deviations in tolerances.
fn point(of: &Identification) -> Vec<f64> {
    let at = of.geometry.deviations_from(&of.start.nominal());
    Coordinates::new(&of.start, Form::Complete).nearest(&at)
}

/// The same result with other deviations.
fn moved(of: &Identification, x: &[f64]) -> Identification {
    let d = Coordinates::new(&of.start, Form::Complete).deviations(x);
    Identification { geometry: of.start.deviated(&d), ..of.clone() }
}

fn residual(of: &Identification, samples: &[Sample], x: &[f64]) -> Vec<f64> {
    let at = of.geometry.deviations_from(&of.start.nominal());
    Calibration::new(&of.start, samples, Form::Complete, &at).residual(x).unwrap()
}

#[test]
fn sparse_objectives_are_what_they_say_and_least_at_the_result() {
    for (name, group, weight, path) in [
        ("conic-lasso", 1, 1.0, "problems/serial-puma560.json"),
        ("conic-group-lasso", 6, 300.0, "problems/stress/serial-kuka-lbr-sparse.json"),
    ] {
        let problem = problem(path);
        let samples = &problem.data.samples;
        let result = found(&problem, name, &[("weight", &weight.to_string())]);
        let value = |x: &[f64]| {
            let squares: f64 = residual(&result, samples, x).iter().map(|r| r * r).sum();
            let lengths = x.chunks(group).map(|part| part.iter().map(|v| v * v).sum::<f64>().sqrt());
            0.5 * squares + weight * lengths.sum::<f64>()
        };
        let x = point(&result);
        let zeros = x.iter().filter(|v| v.abs() < 1e-9).count();
        assert!(zeros >= 6, "{name}: {zeros}");
        let here = judged(&result, samples, &result.start.nominal()).unwrap();
        assert!((here.value / value(&x) - 1.0).abs() < 1e-12);
        assert!((here.reference.unwrap() / value(&vec![0.0; x.len()]) - 1.0).abs() < 1e-12);
        assert!(here.offset.unwrap() < 1e-4, "{name}: {here:?}");
        // No machine nearby costs less, wherever one steps.
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        for size in [1e-3, 1e-1] {
            for _ in 0..40 {
                let there: Vec<f64> = x.iter().map(|x| x + size * rng.random_range(-1.0..1.0)).collect();
                assert!(value(&there) > here.value, "{name}");
            }
        }
    }
}

#[test]
fn what_is_not_a_solution_is_told() {
    let problem = puma();
    let samples = &problem.data.samples;
    for (name, settings) in [
        ("conic-lasso", &[][..]),
        ("conic-group-lasso", &[]),
        ("conic-huber", &[]),
        ("conic-bounded", &[("bounds", "0.8")]),
        ("conic-bounded", &[("cone", "1.5")]),
        ("conic-huber", &[("bounds", "2.5"), ("delta", "3")]),
    ] {
        let result = found(&problem, name, settings);
        let truth = problem.truth.as_ref().unwrap().nominal();
        let here = judged(&result, samples, &truth).unwrap();
        let limited = settings.iter().any(|(key, _)| *key != "delta");
        assert!(here.offset.unwrap() < 1e-5, "{name} {settings:?}: {here:?}");
        match here.reference {
            Some(reference) => assert!(here.value <= reference, "{name} {settings:?}: {here:?}"),
            None => assert!(limited, "{name} {settings:?}"),
        }
        let x = point(&result);
        // Shrunk by a tenth, which no limit forbids: a stationary point no more.
        let shrunk: Vec<f64> = x.iter().map(|x| 0.9 * x).collect();
        let there = judged(&moved(&result, &shrunk), samples, &truth).unwrap();
        assert!(there.offset.unwrap() > 0.1 && there.value > here.value, "{name} {settings:?}: {there:?}");
        // Grown by a tenth, limits are overstepped.
        let grown: Vec<f64> = x.iter().map(|x| 1.1 * x).collect();
        let there = judged(&moved(&result, &grown), samples, &truth).unwrap();
        assert!(there.offset.unwrap() > 0.1, "{name} {settings:?}: {there:?}");
    }
}

/// Least squares on the data alone is no stationary point of a sparse objective, and the other way round.
#[test]
fn results_are_held_to_their_own_objective() {
    let problem = puma();
    let samples = &problem.data.samples;
    let (sparse, bounded) = (found(&problem, "conic-lasso", &[]), found(&problem, "conic-bounded", &[]));
    let crossed = |objective: &Identification, geometry: &Identification| {
        let mut crossed = objective.clone();
        crossed.geometry = geometry.geometry.clone();
        judged(&crossed, samples, &crossed.start.nominal()).unwrap().offset.unwrap()
    };
    assert!(crossed(&sparse, &bounded) > 0.1);
    assert!(crossed(&sparse, &sparse) < 1e-4);
    // The largest residual has no derivative: what may still be gained judges a minimax result.
    let mut minimax = registry::find("conic-minimax").unwrap();
    minimax.set("bounds", "none").unwrap();
    let result = identify(&problem.mechanism, samples, minimax.as_ref(), &Stop::default()).unwrap();
    let truth = problem.truth.as_ref().unwrap().nominal();
    let here = judged(&result, samples, &truth).unwrap();
    assert_eq!(here.offset, None);
    assert!(here.value < here.reference.unwrap() && here.gain.unwrap() < 2e-3, "{here:?}");
    let shrunk: Vec<f64> = point(&result).iter().map(|x| 0.9 * x).collect();
    let there = judged(&moved(&result, &shrunk), samples, &truth).unwrap();
    assert!(there.gain.unwrap() > 0.1 && there.value > here.value, "{there:?}");
}

/// Bounds cut the truth off, by thousands of standard deviations: Huber's threshold never comes down to the one asked
/// for. It must be the one that belongs to the result's own residual.
#[test]
fn an_eased_threshold_belongs_to_the_result() {
    let problem = problem("problems/stress/serial-ur10-bounds.json");
    let result = found(&problem, "conic-huber", &[]);
    let samples = &problem.data.samples;
    let here = judged(&result, samples, &result.start.nominal()).unwrap();
    let r = residual(&result, samples, &point(&result));
    let beyond = r.iter().filter(|r| r.abs() > 10.0 * 1.345).count();
    assert!(beyond > r.len() / 2, "{beyond}: no misfit to speak of");
    assert!(here.offset.unwrap() < 1e-6, "{here:?}");
}

/// Where no limit is active the result is the unbounded optimum, which another method finds on other coordinates, and
/// stationary under the prior's weights at the result itself; as anybody runs it.
fn inactive_limits_leave_the_unbounded_optimum(class: impl Fn(&str) -> bool) {
    let paths: Vec<_> = support::problems().into_iter().filter(|path| class(&support::name(path))).collect();
    assert!(paths.len() >= 3);
    paths.into_par_iter().for_each(|path| {
        let (name, problem) = (support::name(&path), problem(&path.to_string_lossy()));
        let samples = &problem.data.samples;
        let found = |solver: &str, settings: &[(&str, &str)]| found(&problem, solver, settings);
        let at = |of: &Identification| representative(&of.start, &of.geometry);
        let apart = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        // Stopped late: where the optimum is.
        let late = Stop { iterations: 1000, gradient: 1e-12, step: 1e-12, cost: 1e-16 };
        let expected = at(&stopped(&problem, registry::find("argmin-lm").unwrap().as_ref(), &late));
        let damped = apart(&at(&found("argmin-lm", &[])), &expected);
        let free = found("conic-bounded", &[]);
        let bounded = found("conic-bounded", &[("bounds", "50"), ("cone", "100")]);
        assert!(bounded.report.active.is_empty() && bounded.report.kkt.unwrap() < 1e-6, "{name}");
        assert_eq!(bounded.report.x, free.report.x, "{name}");
        let conic = apart(&at(&bounded), &expected);
        let offsets = [
            relative_offset(&free, samples, Form::Complete).unwrap(),
            judged(&bounded, samples, &bounded.start.nominal()).unwrap().offset.unwrap(),
        ];
        eprintln!("{name}: {conic:.1e} tolerances apart, argmin-lm {damped:.1e}, offsets {offsets:?}");
        assert!(conic < 1e-6, "{name}: {conic:e}");
        assert!(damped < if name == "hexapod-ballscrew" { 1e-5 } else { 1e-7 }, "{name}: {damped:e}");
        assert!(offsets.iter().all(|offset| *offset < 1e-6), "{name}: {offsets:?}");
    });
}

#[test]
fn inactive_limits_leave_the_unbounded_optimum_of_hexapods() {
    inactive_limits_leave_the_unbounded_optimum(|name| name.starts_with("hexapod"));
}

#[test]
fn inactive_limits_leave_the_unbounded_optimum_of_others() {
    inactive_limits_leave_the_unbounded_optimum(|name| !name.starts_with("hexapod"));
}
