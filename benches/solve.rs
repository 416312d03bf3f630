//! One conic step at the sizes of a hexapod, and what argmin's executor costs over a plain loop.

#![allow(missing_docs)]

#[allow(dead_code)]
#[path = "../tests/nist/mod.rs"]
mod nist;
#[path = "../tests/shared/mod.rs"]
mod shared;

use argmin::core::{Solver, State};
use criterion::{Criterion, criterion_group, criterion_main};
use faer::Mat;
use gough::linalg;
use gough::problem::{EvalError, Linearized, Param, Problem};
use gough::solve::Stop;
use gough::solve::conic::here::Here;
use gough::solve::conic::limits::Limits;
use gough::solve::conic::loss::{Frame, loss};
use gough::solve::conic::penalty::Penalty;
use gough::solve::conic::step::Model;
use gough::solve::levenberg::{LevenbergMarquardt, LevenbergState, minimise};
use gough::statistics::quantile;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::hint::black_box;
use std::time::{Duration, Instant};

/// A linear problem of 600 rows whose Jacobian has the given rank and singular values of 1e3 down to 1.
struct Linear {
    jac: Mat<f64>,
    r: Vec<f64>,
    params: Vec<Param>,
}

impl Linear {
    fn new(n: usize, rank: usize) -> Self {
        let mut stream = ChaCha8Rng::seed_from_u64(n as u64);
        let mut random = |rows, columns| Mat::from_fn(rows, columns, |_, _| stream.random_range(-1.0..1.0));
        let (left, right): (Mat<f64>, Mat<f64>) = (random(600, rank), random(rank, n));
        let decay = |k: usize| 10f64.powf(2.0 - 3.0 * k as f64 / rank as f64);
        let jac =
            Mat::from_fn(600, n, |i, j| (0..rank).map(|k| decay(k) * left[(i, k)] * right[(k, j)]).sum());
        let noise: Mat<f64> = random(600, 1);
        let truth: Vec<f64> = (0..n).map(|i| ((7 * i) as f64).sin()).collect();
        let r =
            linalg::mul(jac.as_ref(), &truth).iter().enumerate().map(|(i, v)| noise[(i, 0)] - v).collect();
        let param = |i: usize| Param { name: format!("x{i}"), unit: "", scale: 1.0, bounds: (-3.0, 3.0) };
        Self { jac, r, params: (0..n).map(param).collect() }
    }
}

impl Problem for Linear {
    fn params(&self) -> &[Param] {
        &self.params
    }

    fn residual(&self, x: &[f64]) -> Result<Vec<f64>, EvalError> {
        Ok(linalg::mul(self.jac.as_ref(), x).iter().zip(&self.r).map(|(d, r)| d + r).collect())
    }

    fn linearize(&self, x: &[f64]) -> Result<Linearized, EvalError> {
        Ok(Linearized { r: self.residual(x)?, jac: self.jac.clone() })
    }
}

fn conic_step(c: &mut Criterion) {
    let mut group = c.benchmark_group("conic step, 600 rows");
    group.sample_size(10);
    for (n, rank) in [(138, 138), (138, 66), (252, 138), (252, 66)] {
        let problem = Linear::new(n, rank);
        let zero = vec![0.0; n];
        let Ok(here) = Here::at(&problem, &zero, false) else { continue };
        let Ok(limits) = Limits::of(&problem, 0.8, f64::INFINITY) else { continue };
        let Some(loss) = loss("least-squares", 1.0) else { continue };
        let metric = vec![1.0; n];
        let penalty = Penalty { ridge: 1e-8, ..Penalty::default() };
        let model = Model { loss: loss.as_ref(), penalty, limits: &limits, groups: &[], metric: &metric };
        group.bench_function(format!("box, n={n}, rank {rank}"), |b| {
            b.iter(|| black_box(model.step(&here, None)).map(|step| step.predicted));
        });
        let frame = Frame { here: &here, unit: vec![1.6; n] };
        group.bench_function(format!("box, clarabel alone, n={n}, rank {rank}"), |b| {
            b.iter(|| black_box(model.program(&frame, None, &[]).solve()).map(|s| s.status));
        });
    }
    group.finish();
}

fn compress(c: &mut Criterion) {
    for rows in [600, 6000] {
        let mut stream = ChaCha8Rng::seed_from_u64(5);
        let jac = Mat::from_fn(rows, 138, |_, _| stream.random_range(-1.0..1.0));
        let r: Vec<f64> = (0..rows).map(|_| stream.random_range(-1.0..1.0)).collect();
        c.bench_function(&format!("compress {rows} x 138"), |b| {
            b.iter(|| linalg::compress(black_box(&jac), &r))
        });
    }
}

/// The same solver as [`minimise`] runs, driven by a plain loop instead of argmin's executor.
fn plain(problem: &dyn Problem, start: &[f64], stop: &Stop) -> Vec<f64> {
    let mut solver = LevenbergMarquardt::new(*stop);
    let mut wrapped = argmin::core::Problem::new(problem);
    let state = LevenbergState::new().param(start.to_vec());
    let (mut state, _) = solver.init(&mut wrapped, state).expect("a start");
    for _ in 0..stop.iterations {
        if solver.outcome().is_some() {
            break;
        }
        state = solver.next_iter(&mut wrapped, state).expect("a point").0;
    }
    state.take_param().expect("a point")
}

/// Times executor and plain loop in turn, `batch` runs at a time, the first of a pair the second of the next: both see
/// the same moments of the machine. Criterion reports the time under the executor; the line after it the paired
/// difference, median with its 95 % interval (order statistics).
fn in_turn(c: &mut Criterion, name: &str, batch: usize, problem: &dyn Problem, start: &[f64], stop: &Stop) {
    let under_argmin = || minimise(black_box(problem), start, stop).x;
    let alone = || plain(black_box(problem), start, stop);
    assert_eq!(under_argmin(), alone(), "the two do the same work");
    let iterations = minimise(problem, start, stop).trace.len();
    let time = |run: &dyn Fn() -> Vec<f64>| {
        let from = Instant::now();
        (0..batch).for_each(|_| drop(black_box(run())));
        from.elapsed() / batch as u32
    };
    let mut pairs: Vec<(f64, f64)> = Vec::new();
    c.bench_function(&format!("argmin-lm, {name}, {iterations} iterations"), |b| {
        b.iter_custom(|count| {
            let mut total = Duration::ZERO;
            for _ in 0..count {
                let (with, without);
                if pairs.len().is_multiple_of(2) {
                    (with, without) = (time(&under_argmin), time(&alone));
                } else {
                    let before = time(&alone);
                    (with, without) = (time(&under_argmin), before);
                }
                pairs.push((with.as_secs_f64(), without.as_secs_f64()));
                total += with;
            }
            total
        });
    });
    // A filter may have left this one out.
    if pairs.is_empty() {
        return;
    }
    let middle = |each: &dyn Fn(&(f64, f64)) -> f64| {
        let mut values: Vec<f64> = pairs.iter().map(each).collect();
        values.sort_by(f64::total_cmp);
        let half = 0.98 / (values.len() as f64).sqrt();
        [0.5, 0.5 - half, 0.5 + half].map(|p| quantile(&values, p).unwrap_or(f64::NAN))
    };
    let [percent, low, high] = middle(&|(with, without)| 100.0 * (with / without - 1.0));
    println!(
        "    executor over plain loop: {percent:+.2} % ({low:+.2} to {high:+.2}), {} pairs",
        pairs.len()
    );
    let [excess, low, high] = middle(&|(with, without)| 1e6 * (with - without) / iterations as f64);
    println!("    in one iteration: {excess:+.3} us ({low:+.3} to {high:+.3})");
}

fn argmin(c: &mut Criterion) {
    let five = Stop { iterations: 5, step: 0.0, gradient: 0.0, cost: 0.0 };
    in_turn(c, "600 x 138", 1, &Linear::new(138, 138), &[0.0; 138], &five);
    if !cfg!(shared_nist) {
        return;
    }
    let directory = shared::directory("nist");
    let misra = nist::read(&directory.join("Misra1a.dat")).expect("the file can be read");
    in_turn(c, "NIST Misra1a (14 x 2)", 100, &misra, &misra.starts[0], &nist::TIGHT);
}

criterion_group!(benches, conic_step, compress, argmin);
criterion_main!(benches);
