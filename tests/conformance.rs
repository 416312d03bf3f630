//! One suite for every registered identifier: a new one is picked up from the registry, with no edit here.

mod analytic;

use analytic::{Machine, Residual, numbers};
use gough::problem::{Dual, EvalError, Formula, Problem};
use gough::solve::{Estimate, Failure, Identifier, Outcome, Report, SettingError, Stop, registry};

const STOP: Stop = Stop { iterations: 200, step: 1e-11, gradient: 1e-11, cost: 1e-15 };

/// The identifiers that minimise the plain sum of squares, as their report says.
fn least_squares(report: &Report) -> bool {
    matches!(report.estimate, Estimate::LeastSquares | Estimate::Split { .. })
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Runs every identifier, checks what must hold of any report, and hands the report on.
fn each(problem: &dyn Problem, start: &[f64], mut check: impl FnMut(Box<dyn Identifier>, Report)) {
    for identifier in registry::all() {
        let report = identifier.identify(problem, start, &STOP);
        let name = report.identifier;
        assert_eq!(name, identifier.name());
        assert_eq!(report.x.len(), start.len(), "{name}");
        assert!(report.trace.len() <= STOP.iterations, "{name}");
        if report.outcome.converged() {
            assert!(report.cost.is_finite() && report.x.iter().all(|v| v.is_finite()), "{name}");
            let r = problem.residual(&report.x).expect("a solution can be evaluated");
            let cost = gough::problem::cost(&r);
            assert!((report.cost - cost).abs() <= 1e-9 * cost + 1e-25, "{name}: {} is {cost}", report.cost);
        }
        let again = identifier.identify(problem, start, &STOP);
        assert_eq!(again.x, report.x, "{name}: the same run gives the same bytes");
        check(identifier, report);
    }
}

fn linear(seed: u64, rows: usize, n: usize) -> (Vec<Vec<f64>>, Vec<f64>) {
    let jac = numbers(seed, rows * n).chunks(n).map(<[f64]>::to_vec).collect();
    (jac, numbers(seed + 1, rows))
}

fn formula(jac: Vec<Vec<f64>>, y: Vec<f64>, n: usize) -> Formula<Residual> {
    let residual: Residual = Box::new(move |x: &[Dual]| {
        let dot = |row: &Vec<f64>| row.iter().zip(x).fold(Dual::constant(0.0), |sum, (a, x)| sum + *x * *a);
        Ok(jac.iter().zip(&y).map(|(row, y)| dot(row) - *y).collect())
    });
    Formula::new(n, residual)
}

#[test]
fn linear_full_rank_has_one_answer() {
    let (jac, y) = linear(1, 20, 5);
    let problem = formula(jac, y, 5);
    let mut answers = 0;
    let best = registry::find("argmin-lm").expect("registered").identify(&problem, &[0.0; 5], &STOP);
    each(&problem, &[0.0; 5], |_, report| {
        if least_squares(&report) && report.outcome.converged() {
            answers += 1;
            assert!(distance(&report.x, &best.x) < 1e-6, "{}", report.identifier);
        }
    });
    assert!(answers >= 6, "{answers} identifiers agree");
}

#[test]
fn rank_deficiency_is_no_obstacle() {
    let (mut jac, y) = linear(3, 20, 5);
    jac.iter_mut().for_each(|row| row[4] = row[0] - 2.0 * row[2]);
    let problem = formula(jac, y, 5);
    let best = registry::find("argmin-lm").expect("registered").identify(&problem, &[0.0; 5], &STOP);
    assert!(best.outcome.converged());
    each(&problem, &[0.0; 5], |_, report| {
        if least_squares(&report) && report.outcome.converged() {
            assert!((report.cost - best.cost).abs() < 1e-9 * best.cost, "{}", report.identifier);
        }
    });
}

#[test]
fn a_curved_machine_is_identified_alike() {
    let problem = Machine::new(11, 60, 10.0, numbers(12, 12)).problem();
    let start = vec![0.0; 12];
    let best = registry::find("argmin-lm").expect("registered").identify(&problem, &start, &STOP);
    let map = registry::find("map").expect("registered").identify(&problem, &start, &STOP);
    assert!(best.outcome.converged() && map.outcome.converged());
    each(&problem, &start, |_, report| {
        let expected = match report.estimate {
            Estimate::Ridge { weight: 1.0 } => &map.x,
            _ if least_squares(&report) => &best.x,
            _ => return,
        };
        // The first two coordinates count by their sum.
        let sum = |x: &[f64]| x[0] + x[1];
        let apart = distance(&report.x[2..], &expected[2..]).max((sum(&report.x) - sum(expected)).abs());
        if report.outcome.converged() {
            assert!(apart < 1e-6, "{}: {apart:e}", report.identifier);
        }
    });
}

#[test]
fn an_exponential_decay_is_fitted() {
    let residual: Residual = Box::new(|b: &[Dual]| {
        let row = |t: usize| {
            let t = t as f64;
            b[0] * (-b[1] * t).exp() + b[2] - (3.0 * (-0.4 * t).exp() + 1.0 + 0.01 * (7.0 * t).sin())
        };
        Ok((0..15).map(row).collect())
    });
    let problem = Formula::new(3, residual);
    let start = [1.0, 1.0, 0.0];
    let best = registry::find("argmin-lm").expect("registered").identify(&problem, &start, &STOP);
    assert!(best.outcome.converged() && distance(&best.x, &[3.0, 0.4, 1.0]) < 0.05);
    each(&problem, &start, |_, report| {
        if least_squares(&report) && report.outcome.converged() {
            assert!(distance(&report.x, &best.x) < 1e-5, "{}: {:?}", report.identifier, report.x);
        }
    });
}

#[test]
fn a_zero_residual_is_reached() {
    let residual: Residual = Box::new(|x: &[Dual]| Ok(vec![10.0 * (x[1] - x[0].square()), 1.0 - x[0]]));
    let problem = Formula::new(2, residual);
    let mut reached = 0;
    each(&problem, &[-1.2, 1.0], |_, report| {
        if least_squares(&report) && report.outcome.converged() {
            reached += 1;
            assert!(distance(&report.x, &[1.0, 1.0]) < 1e-5, "{}: {:?}", report.identifier, report.x);
        }
    });
    assert!(reached >= 5, "{reached}");
}

#[test]
fn a_start_at_the_solution_stays() {
    let residual: Residual = Box::new(|x: &[Dual]| Ok(vec![x[0], x[1].square() - x[0], 2.0 * x[1]]));
    each(&Formula::new(2, residual).with_prior().grouped(1), &[0.0, 0.0], |_, report| {
        assert_eq!(report.x, [0.0, 0.0], "{}", report.identifier);
        let unsuited = matches!(report.outcome, Outcome::Failed(Failure::Unsuited(_)));
        assert!(report.outcome.converged() || unsuited, "{}: {}", report.identifier, report.outcome);
    });
}

/// `ln` as far as its argument is positive, an error beyond: the machine that does not close.
fn walled() -> Formula<Residual> {
    let residual: Residual = Box::new(|x: &[Dual]| {
        if x[0].v >= 2.0 || x[1].v >= 2.0 {
            return Err(EvalError("loop 1 does not close".into()));
        }
        Ok(vec![(2.0 - x[0]).ln() + 1.0, (2.0 - x[1]).ln() + 1.2, 0.1 * (x[0] - x[1])])
    });
    Formula::new(2, residual)
}

#[test]
fn a_wall_is_not_run_through() {
    // From -30, a full step leads far beyond the wall.
    let mut converged = 0;
    each(&walled(), &[-30.0, -30.0], |_, report| {
        let inside = report.x.iter().all(|v| *v < 2.0);
        match &report.outcome {
            Outcome::Converged(_) => {
                converged += 1;
                assert!(inside, "{}: {:?}", report.identifier, report.x);
            }
            Outcome::Failed(Failure::Evaluation(why)) => assert!(why.contains("does not close"), "{why}"),
            _ => {}
        }
    });
    assert!(converged >= 4, "{converged}");
    for name in ["argmin-lm", "conic-bounded", "argmin-trust-region"] {
        let report = registry::find(name).expect("registered").identify(&walled(), &[-30.0, -30.0], &STOP);
        assert!(report.outcome.converged(), "{name}: {}", report.outcome);
    }
}

#[test]
fn a_start_that_cannot_be_evaluated_is_said_to_be_that() {
    each(&walled(), &[3.0, 0.0], |_, report| {
        let honest = matches!(report.outcome, Outcome::Failed(Failure::Start(_) | Failure::Unsuited(_)));
        assert!(honest, "{}: {}", report.identifier, report.outcome);
    });
}

#[test]
fn nan_is_never_an_answer() {
    let residual: Residual = Box::new(|x: &[Dual]| Ok(vec![x[0].sqrt() - 3.0, x[1].ln() + 1.0, x[0] * x[1]]));
    each(&Formula::new(2, residual).with_prior().grouped(1), &[0.01, 8.0], |_, report| {
        assert!(
            report.x.iter().all(|v| v.is_finite()) || !report.outcome.converged(),
            "{}",
            report.identifier
        );
    });
    let nothing: Residual = Box::new(|_: &[Dual]| Ok(vec![Dual::constant(f64::NAN); 3]));
    each(&Formula::new(2, nothing), &[1.0, 1.0], |_, report| {
        assert!(!report.outcome.converged(), "{}: {}", report.identifier, report.outcome);
    });
}

#[test]
fn an_unknown_setting_is_refused_by_name() {
    for mut identifier in registry::all() {
        let refused = identifier.set("no-such-setting", "1").expect_err("refused");
        let SettingError::Unknown { solver, key, .. } = &refused else { panic!("{refused}") };
        assert_eq!((*solver, key.as_str()), (identifier.name(), "no-such-setting"));
        for (key, value) in identifier.settings() {
            identifier.set(key, &value).unwrap_or_else(|why| panic!("a setting it lists: {why}"));
            let error = identifier.set(key, "nonsense").expect_err("refused");
            assert!(error.to_string().contains("nonsense"), "{error}");
        }
    }
}

#[test]
fn names_are_unique_and_summaries_are_there() {
    let mut names: Vec<&str> = registry::all().iter().map(|i| i.name()).collect();
    assert!(registry::all().iter().all(|i| !i.summary().is_empty()));
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), registry::all().len());
    let unknown = registry::find("levenberg").err().expect("unknown").to_string();
    assert!(names.iter().all(|name| unknown.contains(name)), "{unknown}");
}

/// A fit that is exact but for rounding: the gradient of what is left says nothing.
#[test]
fn an_exact_fit_of_weak_directions_is_a_solution() {
    let residual: Residual = Box::new(|x: &[Dual]| {
        let noise = 1e-11 * (1e12 * x[0].v).sin();
        Ok(vec![(x[0] + x[1] * 0.3).sin() * 50.0 - 20.0 + noise, (x[1] - x[2] * 1e-3) * 20.0 - 7.0 - noise])
    });
    each(&Formula::new(3, residual).with_prior(), &[0.0; 3], |identifier, report| {
        if matches!(identifier.name(), "minimal" | "map" | "argmin-lm" | "conic-bounded") {
            assert!(report.outcome.converged(), "{}: {}", report.identifier, report.outcome);
        }
    });
}
