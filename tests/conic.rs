//! The conic identifiers against each other, against brute force and against their optimality conditions.

mod analytic;

use analytic::{Machine, numbers};
use gough::problem::{Dual, Formula, Problem};
use gough::solve::{Failure, Identifier, Outcome, Report, Stop, argmin_lm::ArgminLm, conic::Conic, map::Map};

const STOP: Stop = Stop { iterations: 60, step: 1e-12, gradient: 1e-10, cost: 1e-15 };

fn machine() -> impl Problem {
    Machine::new(1, 60, 10.0, numbers(7, 12)).problem()
}

fn with(mut identifier: Conic, settings: &[(&str, &str)]) -> Conic {
    settings.iter().for_each(|(key, value)| identifier.set(key, value).expect("a setting it has"));
    identifier
}

fn run(problem: &dyn Problem, identifier: &dyn Identifier) -> Report {
    let report = identifier.identify(problem, &vec![0.0; problem.params().len()], &STOP);
    println!(
        "{:18} {} in {}: cost {:.9e} kkt {:?} active {}",
        report.identifier,
        report.outcome,
        report.trace.len(),
        report.cost,
        report.kkt,
        report.active.len()
    );
    report
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn ridge_is_the_map_estimate() {
    let problem = machine();
    let (ridge, map) = (run(&problem, &Conic::ridge()), run(&problem, &Map::default()));
    assert!(ridge.outcome.converged() && map.outcome.converged());
    assert!(distance(&ridge.x, &map.x) < 1e-9, "{:e}", distance(&ridge.x, &map.x));
}

#[test]
fn inactive_bounds_change_nothing_and_the_gauge_is_the_smallest() {
    let problem = machine();
    let free = run(&problem, &ArgminLm::default());
    let bounded = run(&problem, &with(Conic::bounded(), &[("bounds", "5"), ("cone", "8")]));
    assert!(bounded.outcome.converged() && bounded.active.is_empty());
    assert!((free.x[0] + free.x[1] - bounded.x[0] - bounded.x[1]).abs() < 1e-6);
    assert!(distance(&free.x[2..], &bounded.x[2..]) < 1e-6);
    assert!((bounded.x[0] - bounded.x[1]).abs() < 1e-6, "among equals the smallest: {:?}", &bounded.x[..2]);
}

#[test]
fn active_bounds_satisfy_the_conditions_of_the_nonlinear_problem() {
    let problem = machine();
    for settings in [vec![("bounds", "0.4")], vec![("cone", "0.5")], vec![("bounds", "0.4"), ("cone", "0.5")]]
    {
        let report = run(&problem, &with(Conic::bounded(), &settings));
        assert!(report.outcome.converged(), "{settings:?}: {}", report.outcome);
        assert!(!report.active.is_empty() && report.active.iter().all(|a| a.multiplier >= 0.0));
        assert!(report.kkt.is_some_and(|kkt| kkt < 1e-9), "{settings:?}: {:?}", report.kkt);
    }
}

#[test]
fn a_multiplier_is_the_price_of_its_limit() {
    let problem = machine();
    let at = |bounds: &str| run(&problem, &with(Conic::bounded(), &[("bounds", bounds)]));
    let (low, middle, high) = (at("0.3999"), at("0.4"), at("0.4001"));
    let price: f64 = middle.active.iter().map(|a| a.multiplier).sum();
    let slope = (low.cost - high.cost) / 2e-4;
    assert!((price - slope).abs() < 1e-5 * slope, "{price} and {slope}");
}

/// Two parameters, three data, bounds that cut the optimum off.
fn small() -> impl Problem {
    let data = [(1.0, 2.0), (2.0, 2.9), (4.0, 7.0)];
    Formula::new(2, move |b: &[Dual]| Ok(data.iter().map(|(t, y)| b[0] * (b[1] * *t).exp() - *y).collect()))
        .bounded(&[(0.2, 1.0), (0.1, 0.3)])
}

#[test]
fn brute_force_agrees_within_bounds() {
    let problem = small();
    let report = Conic::bounded().identify(&problem, &[0.5, 0.2], &STOP);
    assert!(report.outcome.converged() && report.kkt.is_some_and(|kkt| kkt < 1e-9), "{report:?}");
    let cost = |x: &[f64]| gough::problem::cost(&problem.residual(x).expect("evaluable"));
    let (mut best, mut size) = (vec![0.6, 0.2], 0.5);
    while size > 1e-9 {
        let centre = best.clone();
        for i in -20..=20 {
            for j in -20..=20 {
                let at = [
                    (centre[0] + size * f64::from(i) / 20.0).clamp(0.2, 1.0),
                    (centre[1] + size * f64::from(j) / 20.0).clamp(0.1, 0.3),
                ];
                if cost(&at) < cost(&best) {
                    best = at.to_vec();
                }
            }
        }
        size *= 0.5;
    }
    assert!(distance(&report.x, &best) < 1e-6, "{:?} and {best:?}", report.x);
    assert!(!report.active.is_empty(), "the bound cuts the optimum off");
}

#[test]
fn contradicting_limits_are_named() {
    let bounds: Vec<(f64, f64)> = (0..6).map(|i| if i == 3 { (0.7, 2.0) } else { (-1.0, 1.0) }).collect();
    let problem = Formula::new(6, |b: &[Dual]| Ok(b.to_vec())).grouped(3).with_prior().bounded(&bounds);
    let report = run(&problem, &with(Conic::bounded(), &[("cone", "0.5")]));
    assert_eq!(report.outcome, Outcome::Failed(Failure::Infeasible(vec!["b4".into(), "g2".into()])));

    let reversed = Formula::new(2, |b: &[Dual]| Ok(b.to_vec())).bounded(&[(1.0, 1.0 - 1e-9), (0.0, 1.0)]);
    let report = run(&reversed, &Conic::bounded());
    assert_eq!(report.outcome, Outcome::Failed(Failure::Infeasible(vec!["b1".into()])));

    // A width that excludes the bound of the problem's own.
    let report = run(&problem, &with(Conic::bounded(), &[("bounds", "0.6")]));
    assert_eq!(report.outcome, Outcome::Failed(Failure::Infeasible(vec!["b4".into()])));
}

#[test]
fn a_held_coordinate_stays() {
    let problem = Formula::new(3, |b: &[Dual]| Ok(vec![b[0] + b[1] - 1.0, b[1] - b[2], b[0] - b[2] + 2.0]))
        .bounded(&[(0.25, 0.25), (-9.0, 9.0), (-9.0, 9.0)]);
    let report = run(&problem, &Conic::bounded());
    assert!(report.outcome.converged() && report.x[0] == 0.25, "{:?}", report.x);
    assert_eq!(report.active.len(), 1);
}

#[test]
fn lasso_and_group_lasso_find_the_few_that_are_off() {
    let mut truth = vec![0.0; 30];
    truth[9..12].copy_from_slice(&[1.0, -0.8, 0.5]);
    truth[21..24].copy_from_slice(&[-0.6, 0.9, 0.7]);
    let problem = Machine::new(3, 200, 30.0, truth).problem();
    for (identifier, weight) in [(Conic::lasso(), "900"), (Conic::group_lasso(), "1200")] {
        let report = run(&problem, &with(identifier, &[("weight", weight)]));
        assert!(report.outcome.converged(), "{}", report.outcome);
        assert!(report.kkt.is_some_and(|kkt| kkt < 1e-9), "{:?}", report.kkt);
        let off: Vec<&str> = problem
            .groups()
            .iter()
            .filter(|g| g.members.iter().any(|&i| report.x[i] != 0.0))
            .map(|g| g.name.as_str())
            .collect();
        assert_eq!(off, ["g4", "g8"], "{}", report.identifier);
    }
}

#[test]
fn huber_keeps_the_clean_error_among_gross_outliers() {
    let error = |outliers: bool, identifier: &dyn Identifier| {
        let mut machine = Machine::new(5, 600, 3.0, numbers(8, 12));
        let truth = machine.truth.clone();
        if outliers {
            machine.noise.iter_mut().step_by(10).for_each(|v| *v = 100.0 * v.signum());
        }
        let report = run(&machine.problem(), identifier);
        assert!(report.outcome.converged(), "{}: {}", report.identifier, report.outcome);
        let seen = (report.x[0] + report.x[1] - truth[0] - truth[1]).powi(2);
        (seen + report.x[2..].iter().zip(&truth[2..]).map(|(a, b)| (a - b).powi(2)).sum::<f64>()).sqrt()
    };
    let clean = error(false, &ArgminLm::default());
    let huber = error(true, &Conic::huber());
    let squares = error(true, &ArgminLm::default());
    println!("clean {clean:.4} huber {huber:.4} least squares {squares:.4}");
    assert!(huber < 1.5 * clean, "huber {huber}, clean {clean}");
    assert!(squares > 3.0 * clean, "least squares {squares}, clean {clean}");
}

#[test]
fn minimax_is_a_vertex_that_no_neighbour_beats() {
    let problem = Machine::new(9, 80, 5.0, numbers(10, 6)).problem();
    let report = run(&problem, &Conic::minimax());
    assert!(report.outcome.converged(), "{}", report.outcome);
    assert!(report.kkt.is_some_and(|kkt| kkt < 1e-6), "{:?}", report.kkt);
    let largest =
        |x: &[f64]| problem.residual(x).expect("evaluable").iter().fold(0.0f64, |a, v| a.max(v.abs()));
    let here = largest(&report.x);
    for (seed, size) in (0..300).flat_map(|seed| [1e-1, 1e-3, 1e-5].map(|size| (seed, size))) {
        let there: Vec<f64> = report.x.iter().zip(numbers(seed, 6)).map(|(x, d)| x + size * d).collect();
        assert!(largest(&there) > here - 1e-9, "{here} but {} nearby", largest(&there));
    }
}

#[test]
fn the_weight_can_be_chosen_and_the_curve_is_kept() {
    let mut truth = vec![0.0; 30];
    truth[9..12].copy_from_slice(&[1.0, -0.8, 0.5]);
    let problem = Machine::new(3, 200, 30.0, truth).problem();
    for (identifier, rule) in
        [(Conic::ridge(), "cv"), (Conic::ridge(), "discrepancy"), (Conic::group_lasso(), "cv")]
    {
        let report = run(&problem, &with(identifier, &[("weight", rule)]));
        assert!(report.outcome.converged(), "{}", report.outcome);
        assert!((3..=11).contains(&report.weights.len()), "{:?}", report.weights);
        assert!(report.weights.is_sorted_by(|a, b| a.weight < b.weight));
        println!("{:?}", report.weights);
        let first = report.weights[0].score;
        let last = report.weights.last().expect("a curve").score;
        assert!(last > 1.05 * first, "a weight of 1e4 must hurt: {first} to {last}");
    }
}
