//! One suite for every registered identifier: a new one is picked up from the registry, with no edit here.

mod analytic;

use analytic::{Machine, Residual, numbers};
use gough::problem::{Dual, EvalError, Formula, Problem};
use gough::solve::{Criterion, Estimate, Failure, Identifier, Outcome, Report, SettingError, Stop, registry};

const STOP: Stop = Stop { iterations: 200, step: 1e-11, gradient: 1e-11, cost: 1e-15 };

/// The identifiers that minimise the plain sum of squares, as their report says.
fn least_squares(report: &Report) -> bool {
    matches!(report.estimate, Estimate::LeastSquares | Estimate::Split { .. })
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Where an identifier need not converge, and why: identifier, problem, reason.
const EXCUSED: [(&str, &str, &str); 7] = [
    ("complete", "decay", "undamped Gauss-Newton steps overshoot"),
    ("textbook", "decay", "undamped Gauss-Newton steps overshoot"),
    ("complete", "wall", "undamped Gauss-Newton steps leave the region"),
    ("textbook", "wall", "undamped Gauss-Newton steps leave the region"),
    ("argmin-lbfgs", "wall", "its line search takes no step that cannot be evaluated for a long one"),
    ("argmin-trust-region", "zero", "its ratio of reductions is rounding at a zero residual"),
    ("argmin-trust-region", "weak", "its ratio of reductions is rounding at an exact fit"),
];

/// What must hold of any identifier's report on the problem of that name: `Err` says what does not.
fn judged(
    identifier: &dyn Identifier,
    name: &str,
    problem: &dyn Problem,
    start: &[f64],
) -> Result<Report, String> {
    let report = identifier.identify(problem, start, &STOP);
    let must = |holds: bool, what: &str| {
        let found = format!("{} on {name}: {what}: {} at {:?}", identifier.name(), report.outcome, report.x);
        if holds { Ok(()) } else { Err(found) }
    };
    must(report.identifier == identifier.name(), "the report has the identifier's name")?;
    must(report.x.len() == start.len(), "one value a parameter")?;
    must(report.trace.len() <= STOP.iterations, "no more iterations than allowed")?;
    if report.outcome.converged() {
        let r = problem.residual(&report.x).map_err(|why| why.0)?;
        let cost = gough::problem::cost(&r);
        must((report.cost - cost).abs() <= 1e-9 * cost + 1e-25, "the cost is that of the point")?;
        must(report.x.iter().all(|v| v.is_finite()), "the point is finite")?;
    }
    let unsuited = matches!(report.outcome, Outcome::Failed(Failure::Unsuited(_)));
    let excused = EXCUSED.iter().any(|(of, on, _)| *of == identifier.name() && *on == name);
    let solvable = name != "nan" && problem.residual(start).is_ok();
    must(report.outcome.converged() || unsuited || excused || !solvable, "it converges")?;
    let again = identifier.identify(problem, start, &STOP);
    must(again.x == report.x, "the same run gives the same bytes")?;
    Ok(report)
}

/// Runs every registered identifier on the problem of that name and hands the report on.
fn each(
    name: &str,
    problem: &dyn Problem,
    start: &[f64],
    mut check: impl FnMut(Box<dyn Identifier>, Report),
) {
    for identifier in registry::all() {
        let report = judged(identifier.as_ref(), name, problem, start).unwrap_or_else(|why| panic!("{why}"));
        check(identifier, report);
    }
}

/// Evaluates the start and does nothing.
struct Lazy;

impl Identifier for Lazy {
    fn name(&self) -> &'static str {
        "lazy"
    }

    fn summary(&self) -> &'static str {
        "does nothing"
    }

    fn identify(&self, problem: &dyn Problem, start: &[f64], _: &Stop) -> Report {
        let report = Report::new("lazy", start, Estimate::LeastSquares);
        match problem.residual(start) {
            Err(why) => report.fail(Failure::Start(why.0)),
            Ok(r) if gough::problem::cost(&r) == 0.0 => {
                Report { cost: 0.0, outcome: Outcome::Converged(Criterion::Zero), ..report }
            }
            Ok(_) => report,
        }
    }
}

/// Calls the start a solution.
struct Boastful;

impl Identifier for Boastful {
    fn name(&self) -> &'static str {
        "boastful"
    }

    fn summary(&self) -> &'static str {
        "claims to have converged"
    }

    fn identify(&self, problem: &dyn Problem, start: &[f64], _: &Stop) -> Report {
        let report = Report::new("boastful", start, Estimate::LeastSquares);
        let cost = problem.residual(start).map_or(f64::INFINITY, |r| gough::problem::cost(&r));
        Report { cost, outcome: Outcome::Converged(Criterion::Cost), ..report }
    }
}

#[test]
fn an_identifier_that_does_nothing_does_not_conform() {
    let (jac, y) = linear(1, 20, 5);
    let machine = Machine::new(11, 60, 10.0, numbers(12, 12)).problem();
    let problems: [(&str, &dyn Problem, &[f64]); 5] = [
        ("linear", &formula(jac, y, 5), &[0.0; 5]),
        ("machine", &machine, &[0.0; 12]),
        ("decay", &decay(), &[1.0, 1.0, 0.0]),
        ("zero", &banana(), &[-1.2, 1.0]),
        ("wall", &walled(), &[-30.0, -30.0]),
    ];
    for (name, problem, start) in problems {
        assert!(judged(&Lazy, name, problem, start).is_err(), "{name}");
        // A claim is held against the answer of another.
        let claimed = judged(&Boastful, name, problem, start).unwrap();
        let found = registry::find("argmin-lm").unwrap().identify(problem, start, &STOP);
        assert!(found.outcome.converged() && distance(&claimed.x, &found.x) > 1e-3, "{name}");
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
    each("linear", &problem, &[0.0; 5], |_, report| {
        if least_squares(&report) {
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
    each("deficient", &problem, &[0.0; 5], |_, report| {
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
    each("machine", &problem, &start, |_, report| {
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

/// An exponential decay with a ripple.
fn decay() -> Formula<Residual> {
    let residual: Residual = Box::new(|b: &[Dual]| {
        let row = |t: usize| {
            let t = t as f64;
            b[0] * (-b[1] * t).exp() + b[2] - (3.0 * (-0.4 * t).exp() + 1.0 + 0.01 * (7.0 * t).sin())
        };
        Ok((0..15).map(row).collect())
    });
    Formula::new(3, residual)
}

#[test]
fn an_exponential_decay_is_fitted() {
    let start = [1.0, 1.0, 0.0];
    let best = registry::find("argmin-lm").expect("registered").identify(&decay(), &start, &STOP);
    assert!(best.outcome.converged() && distance(&best.x, &[3.0, 0.4, 1.0]) < 0.05);
    each("decay", &decay(), &start, |_, report| {
        if least_squares(&report) && report.outcome.converged() {
            assert!(distance(&report.x, &best.x) < 1e-5, "{}: {:?}", report.identifier, report.x);
        }
    });
}

/// Rosenbrock's valley.
fn banana() -> Formula<Residual> {
    let residual: Residual = Box::new(|x: &[Dual]| Ok(vec![10.0 * (x[1] - x[0].square()), 1.0 - x[0]]));
    Formula::new(2, residual)
}

#[test]
fn a_zero_residual_is_reached() {
    let mut reached = 0;
    each("zero", &banana(), &[-1.2, 1.0], |_, report| {
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
    each("solved", &Formula::new(2, residual).with_prior().grouped(1), &[0.0, 0.0], |_, report| {
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
    each("wall", &walled(), &[-30.0, -30.0], |_, report| {
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
    each("beyond", &walled(), &[3.0, 0.0], |_, report| {
        let honest = matches!(report.outcome, Outcome::Failed(Failure::Start(_) | Failure::Unsuited(_)));
        assert!(honest, "{}: {}", report.identifier, report.outcome);
    });
}

#[test]
fn nan_is_never_an_answer() {
    let residual: Residual = Box::new(|x: &[Dual]| Ok(vec![x[0].sqrt() - 3.0, x[1].ln() + 1.0, x[0] * x[1]]));
    each("nan", &Formula::new(2, residual).with_prior().grouped(1), &[0.01, 8.0], |_, report| {
        assert!(
            report.x.iter().all(|v| v.is_finite()) || !report.outcome.converged(),
            "{}",
            report.identifier
        );
    });
    let nothing: Residual = Box::new(|_: &[Dual]| Ok(vec![Dual::constant(f64::NAN); 3]));
    each("nan", &Formula::new(2, nothing), &[1.0, 1.0], |_, report| {
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
    each("weak", &Formula::new(3, residual).with_prior(), &[0.0; 3], |identifier, report| {
        if matches!(identifier.name(), "minimal" | "map" | "argmin-lm" | "conic-bounded") {
            assert!(report.outcome.converged(), "{}: {}", report.identifier, report.outcome);
        }
    });
}
