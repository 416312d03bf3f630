//! Moré-Garbow-Hillstrom problems 1 to 19 from the standard start and 10 and 100 times as far, unbounded through
//! `argmin-lm`, and the ten that have published bounds through `conic-bounded`.

#[path = "mgh/mod.rs"]
mod functions;
mod shared;

use gough::problem::Problem;
use gough::solve::{Identifier, Report, Stop, registry};
use serde::Deserialize;

/// One entry of the published table; `f_*` are sums of squares.
#[derive(Deserialize)]
struct Entry {
    mgh: usize,
    n: usize,
    m: usize,
    start: Vec<f64>,
    lower: Option<Vec<f64>>,
    upper: Option<Vec<f64>>,
    f_bounded: Option<f64>,
    f_free: f64,
}

/// Other minima that are published with the problems: (number, sum of squares). Rosenbrock-like valleys aside, a
/// method that ends in one of them has done its work.
const OTHER_MINIMA: &[(usize, f64)] = &[
    (2, 48.9842),
    (5, 0.45202),
    (8, 17.4286),
    (11, 0.038),
    (12, 0.0140896877),
    (15, 0.00102734),
    (18, 5.65565e-3),
    (18, 0.30636677262479482),
    (19, 1.78981),
];

/// Problem 11 within its bounds. The published 5.83e-5 belongs to another reading of the formula: 200 random starts
/// of scipy 1.17 `least_squares` within the bounds find nothing below this.
const GULF_BOUNDED: f64 = 5.290862425885;

const STOP: Stop = Stop { iterations: 1000, step: 1e-15, gradient: 1e-15, cost: 1e-18 };

fn table() -> Vec<Entry> {
    let text =
        std::fs::read_to_string(shared::directory("mgh").join("mgh_1_19.json")).expect("a readable table");
    let entries: Vec<Entry> = serde_json::from_str(&text).expect("a table of problems");
    assert_eq!(entries.len(), 19);
    entries
}

/// Ceres' measure: digits of the sum of squares, absolute where the optimum is zero.
fn digits(found: f64, optimum: f64) -> f64 {
    let error = (found - optimum).abs();
    -(if optimum == 0.0 { error } else { error / optimum }).max(1e-17).log10()
}

fn runs(entry: &Entry, identifier: &dyn Identifier, problem: &dyn Problem) -> Vec<(f64, Report)> {
    [1.0, 10.0, 100.0]
        .iter()
        .map(|factor| {
            let start: Vec<f64> = entry.start.iter().map(|v| factor * v).collect();
            let report = identifier.identify(problem, &start, &STOP);
            println!(
                "{:2} x{factor:<3} {:.6e} in {}: {} {:?}",
                entry.mgh,
                2.0 * report.cost,
                report.trace.len(),
                report.outcome,
                report.kkt
            );
            (2.0 * report.cost, report)
        })
        .collect()
}

#[test]
#[cfg_attr(not(shared_mgh), ignore = "no folder mgh in GOUGH_SHARED (default ../shared)")]
fn functions_have_the_published_size_and_derivatives() {
    for entry in table() {
        let problem = functions::problem(entry.mgh, entry.n).expect("a function");
        let at: Vec<f64> = entry.start.iter().map(|v| v + 0.1 * v.abs().max(0.1)).collect();
        assert_eq!(problem.residual(&at).expect("evaluable").len(), entry.m, "problem {}", entry.mgh);
        let error = gough::problem::check::jacobian_error(&problem, &at, 1e-4).expect("evaluable");
        assert!(error < 1e-6, "problem {}: {error:e}", entry.mgh);
    }
}

#[test]
#[cfg_attr(not(shared_mgh), ignore = "no folder mgh in GOUGH_SHARED (default ../shared)")]
fn argmin_lm_solves_them_from_near_and_far() {
    let entries = table();
    let identifier = registry::find("argmin-lm").expect("registered");
    let (mut solved, mut elsewhere) = (0, 0);
    for entry in &entries {
        let problem = functions::problem(entry.mgh, entry.n).expect("a function");
        for (found, report) in runs(entry, identifier.as_ref(), &problem) {
            let other = |(number, value): &(usize, f64)| *number == entry.mgh && digits(found, *value) >= 3.0;
            if digits(found, entry.f_free) >= 4.0 {
                solved += 1;
                assert!(report.outcome.converged() || report.trace.len() == STOP.iterations);
            } else if OTHER_MINIMA.iter().any(other) {
                elsewhere += 1;
            }
        }
    }
    println!("solved {solved}, at another minimum {elsewhere}, of 57");
    // The rest starts where exponentials overflow (6, 11), or runs down a valley without floor.
    assert!(solved >= 39 && solved + elsewhere >= 51, "solved {solved}, elsewhere {elsewhere}");
}

#[test]
#[cfg_attr(not(shared_mgh), ignore = "no folder mgh in GOUGH_SHARED (default ../shared)")]
fn conic_bounded_solves_the_bounded_ones() {
    let entries = table();
    let identifier = registry::find("conic-bounded").expect("registered");
    let mut solved = 0;
    let mut of = 0;
    for entry in &entries {
        let (Some(lower), Some(upper), Some(optimum)) = (&entry.lower, &entry.upper, entry.f_bounded) else {
            continue;
        };
        let bounds: Vec<(f64, f64)> = lower.iter().copied().zip(upper.iter().copied()).collect();
        let problem = functions::problem(entry.mgh, entry.n).expect("a function").bounded(&bounds);
        for (found, report) in runs(entry, identifier.as_ref(), &problem) {
            of += 1;
            let optimum = if entry.mgh == 11 { GULF_BOUNDED } else { optimum };
            solved += usize::from(digits(found, optimum) >= 4.0);
            let inside = report.x.iter().zip(&bounds).all(|(x, (l, u))| x >= l && x <= u);
            assert!(inside, "problem {}: {:?} outside {bounds:?}", entry.mgh, report.x);
        }
    }
    // All but problem 11 from 100 times its start, which the bounds move to a corner where the gradient vanishes.
    assert_eq!((solved, of), (29, 30));
}
