//! Plans against enumeration, conic programs, direct formulas and simulated calibrations.

mod relaxed;
mod support;

use gough::calibration::{Calibration, Sample};
use gough::design::candidates::Candidates;
use gough::design::exchange::exchange;
use gough::design::order::short_way;
use gough::design::relaxation::relax;
use gough::design::{Criterion, Information, Instrument, Observability, Settings, plan};
use gough::files::{DataPlaces, ProblemFile, read_problem};
use gough::lie::Se3;
use gough::measure::Pose;
use gough::model::Mechanism;
use gough::problem::{Form, Problem};
use gough::simulate::close;
use nalgebra::{DMatrix, Matrix6};
use std::sync::Arc;

fn problem(name: &str) -> ProblemFile {
    let path = support::file(&format!("problems/{name}.json"));
    read_problem(&path, &DataPlaces::from_environment(None)).unwrap()
}

fn sample(actuators: &[f64], pose: Se3, covariance: &Matrix6<f64>) -> Sample {
    let measurement = Arc::new(Pose::new(pose, [true; 6], covariance).unwrap());
    Sample { name: "planned".into(), actuators: actuators.to_vec(), measurement }
}

fn whole(problem: &ProblemFile) -> Instrument {
    let blank = Pose::new(Se3::identity(), [true; 6], &problem.data.noise.unwrap()).unwrap();
    Instrument { blanks: vec![Arc::new(blank)] }
}

/// `log det(I + J'J)` and the information of each posture, from the Jacobian itself.
fn direct(machine: &Mechanism, candidates: &Candidates, covariance: &Matrix6<f64>) -> Vec<DMatrix<f64>> {
    let zero = vec![0.0; machine.component_count()];
    let one = |i: usize| {
        let c = &candidates.fit[i];
        let samples = [sample(&c.actuators, c.pose, covariance)];
        let problem = Calibration::new(machine, &samples, Form::Minimal, &zero);
        let jac = problem.linearize(&vec![0.0; problem.params().len()]).unwrap().jac;
        let jac = DMatrix::from_fn(jac.nrows(), jac.ncols(), |i, j| jac[(i, j)]);
        jac.transpose() * jac
    };
    (0..candidates.fit.len()).map(one).collect()
}

/// All sets of three out of `count`.
fn triples(count: usize) -> Vec<[usize; 3]> {
    let mut all = Vec::new();
    for a in 0..count {
        for b in a + 1..count {
            all.extend((b + 1..count).map(|c| [a, b, c]));
        }
    }
    all
}

/// Enumeration of all 220 plans of 3 among 12 postures: the value is that of the formula, the bound holds for all of them,
/// and the plan is nearly the best (exchange need not find the very best, the stated efficiency must be true).
#[test]
fn bounds_hold_for_every_plan_and_values_are_those_of_the_formulas() {
    for name in ["serial-scara", "tripod-3rps"] {
        let file = problem(name);
        let machine = &file.mechanism;
        let candidates = Candidates::random(machine, 12, 5, 1e-2);
        let workspace = Candidates::random(machine, 6, 6, 1e-2);
        let info = Information::new(machine, &whole(&file), &candidates.fit, &[], &workspace.fit, 3).unwrap();
        let single = direct(machine, &candidates, &file.data.noise.unwrap());
        let n = single[0].nrows();
        let scaled = |set: &[usize]| {
            set.iter().fold(DMatrix::identity(n, n), |sum: DMatrix<f64>, &i| sum + &single[i])
        };
        // The worst posture of the workspace from the Jacobian itself, too.
        let seen = direct(machine, &workspace, &file.data.noise.unwrap());
        for criterion in Criterion::ALL {
            let settings = Settings { poses: 3, criterion, starts: 3, seed: 1 };
            let plan = plan(machine, &candidates.fit, &info, &settings).unwrap();
            let sign = if criterion == Criterion::D { 1.0 } else { -1.0 };
            let units: f64 = info.scale.iter().map(|s| 2.0 * s.ln()).sum();
            let shift = if criterion == Criterion::D { -units } else { 0.0 };
            let mut best = f64::NEG_INFINITY;
            for set in triples(12) {
                let value = criterion.exact(&info, &info.of(&set)).unwrap() + shift;
                best = best.max(value);
                assert!(value <= sign * plan.bound + 1e-9 * value.abs(), "{name} {criterion:?} {set:?}");
                let formula = match criterion {
                    Criterion::D => {
                        scaled(&set).cholesky().unwrap().l().diagonal().map(|d| 2.0 * d.ln()).sum()
                    }
                    Criterion::G => {
                        let covariance = scaled(&set).cholesky().unwrap().inverse();
                        -seen.iter().map(|m| (m * &covariance).trace()).fold(0.0, f64::max)
                    }
                    _ => continue,
                };
                assert!(
                    (value - formula).abs() < 1e-6 * formula.abs(),
                    "{name} {criterion:?}: {value} {formula}"
                );
            }
            let found = sign * plan.value;
            assert!(found <= best + 1e-9 * best.abs(), "{name} {criterion:?}");
            let true_efficiency = match criterion {
                Criterion::D => ((found - best) / plan.kept as f64).exp(),
                _ => best / found,
            };
            println!(
                "{name} {criterion:?}: {found} of {best}, stated {}, true {true_efficiency}",
                plan.efficiency
            );
            assert!(plan.efficiency <= true_efficiency + 1e-9 && plan.efficiency > 0.0);
            assert!(true_efficiency > 0.97, "{name} {criterion:?}: {true_efficiency}");
        }
    }
}

#[test]
fn the_relaxation_agrees_with_conic_programs() {
    let file = problem("serial-scara");
    let candidates = Candidates::random(&file.mechanism, 15, 8, 1e-2);
    let info = Information::new(&file.mechanism, &whole(&file), &candidates.fit, &[], &[], 4).unwrap();
    for (criterion, conic) in
        [(Criterion::D, relaxed::d_optimum(&info, 4)), (Criterion::A, -relaxed::a_optimum(&info, 4))]
    {
        let (start, _) = exchange(&info, criterion, 4, 0, 0).unwrap();
        let relaxed = relax(&info, criterion, &start).unwrap();
        let reached = criterion.exact(&info, &info.weighted(&relaxed.weights)).unwrap();
        println!("{criterion:?}: {reached} <= {conic} <= {}", relaxed.bound);
        let gap = 1e-3 * if criterion == Criterion::D { info.kept as f64 } else { conic.abs() };
        let rounding = 1e-6 * conic.abs().max(1.0);
        assert!(reached <= conic + rounding && conic <= relaxed.bound + rounding);
        assert!(relaxed.bound - reached <= gap * 1.01 + rounding);
        assert!((relaxed.weights.iter().sum::<f64>() - 4.0).abs() < 1e-9);
        assert!(relaxed.weights.iter().all(|w| (-1e-12..=1.0 + 1e-12).contains(w)));
    }
}

#[test]
fn what_has_been_measured_counts() {
    let file = problem("tripod-3rps");
    let machine = &file.mechanism;
    let candidates = Candidates::random(machine, 40, 2, 1e-2);
    let measured = &file.data.samples[..10];
    let fresh = Information::new(machine, &whole(&file), &candidates.fit, &[], &[], 5).unwrap();
    let added = Information::new(machine, &whole(&file), &candidates.fit, measured, &[], 5).unwrap();
    // log det(I + J'J) of measured and chosen postures together, from the Jacobian of them all.
    let chosen = [3, 17, 21, 30, 39];
    let covariance = file.data.noise.unwrap();
    let mut all: Vec<Sample> =
        chosen.map(|i| sample(&candidates.fit[i].actuators, candidates.fit[i].pose, &covariance)).into();
    // The instrument is taken to read what the drawing predicts.
    all.extend(measured.iter().map(|s| {
        let pose = close(machine, &machine.nominal(), &s.actuators).unwrap().tool();
        sample(&s.actuators, pose, &covariance)
    }));
    let zero = vec![0.0; machine.component_count()];
    let whole = Calibration::new(machine, &all, Form::Minimal, &zero);
    assert!(whole.set_aside().is_empty());
    let jac = whole.linearize(&vec![0.0; whole.params().len()]).unwrap().jac;
    let jac = DMatrix::from_fn(jac.nrows(), jac.ncols(), |i, j| jac[(i, j)]);
    let sum = DMatrix::identity(jac.ncols(), jac.ncols()) + jac.transpose() * jac;
    let formula: f64 = sum.cholesky().unwrap().l().diagonal().map(|d| 2.0 * d.ln()).sum();
    let value = added.log_det(&added.of(&chosen)).unwrap();
    assert!((value - formula).abs() < 1e-8 * formula, "{value} {formula}");
    assert!(added.left_out.is_empty());
    assert!(fresh.log_det(&fresh.of(&chosen)).unwrap() < value - 1.0);
}

#[test]
fn observability_indices_by_hand() {
    let of = Observability::of(&[8.0, 2.0, 0.5, 0.0], 4).unwrap();
    assert_eq!((of.directions, of.poses), (2, 4));
    for (index, by_hand) in [(of.o1, 2.0), (of.o2, 0.25), (of.o3, 2.0), (of.o4, 0.5), (of.o5, 1.6)] {
        assert!((index - by_hand).abs() < 1e-15 * by_hand.max(1.0) * 4.0, "{index} {by_hand}");
    }
    assert_eq!(Observability::of(&[0.9, 0.0], 3), None);
}

/// Postures in a row are visited in a row; of seven others no order of all 5,040 is much shorter.
#[test]
fn moves_are_short() {
    let ranges = [(-1.0, 1.0), (-2.0, 2.0)];
    let row: Vec<Vec<f64>> = [0.5, 0.1, 0.9, 0.3, 0.7].iter().map(|x| vec![*x, 0.0]).collect();
    let alone = |postures: &[Vec<f64>]| -> Vec<usize> {
        let stops: Vec<[&[f64]; 2]> = postures.iter().map(|p| [p.as_slice(); 2]).collect();
        short_way(&stops, &ranges).into_iter().map(|(i, _)| i).collect()
    };
    assert_eq!(alone(&row), [1, 3, 0, 4, 2]);
    let some: Vec<Vec<f64>> =
        (0..7).map(|i| vec![(1.7 * f64::from(i)).sin(), 2.0 * (2.9 * f64::from(i) + 1.0).cos()]).collect();
    let length = |order: &[usize]| {
        let mut at = vec![0.0; 2];
        let mut sum = 0.0;
        for &i in order {
            sum += f64::max((some[i][0] - at[0]).abs() / 2.0, (some[i][1] - at[1]).abs() / 4.0);
            at.clone_from(&some[i]);
        }
        sum
    };
    let mut best = f64::INFINITY;
    let mut order: Vec<usize> = (0..7).collect();
    permute(&mut order, 0, &mut |order| best = best.min(length(order)));
    let found = alone(&some);
    let mut sorted = found.clone();
    sorted.sort_unstable();
    assert_eq!(sorted, [0, 1, 2, 3, 4, 5, 6]);
    assert!(length(&found) <= 1.1 * best, "{} {best}", length(&found));
}

/// Pairs of postures are visited from either end: of all 384 orders of four none is much shorter.
#[test]
fn the_way_to_the_second_of_two_postures_counts() {
    let ranges = [(-1.0, 1.0)];
    let row = [[[0.5], [0.1]], [[0.9], [0.6]]];
    fn stops(pairs: &[[[f64; 1]; 2]]) -> Vec<[&[f64]; 2]> {
        pairs.iter().map(|[a, b]| [a.as_slice(), b.as_slice()]).collect()
    }
    assert_eq!(short_way(&stops(&row), &ranges), [(0, true), (1, true)]);
    let some: Vec<[[f64; 1]; 2]> =
        (0..4).map(|i| [[(1.7 * f64::from(i)).sin()], [(2.9 * f64::from(i) + 1.0).cos()]]).collect();
    let length = |way: &[(usize, bool)]| {
        let mut at = 0.0;
        let mut sum = 0.0;
        for &(i, reversed) in way {
            let [first, second] = if reversed { [some[i][1], some[i][0]] } else { some[i] };
            sum += (first[0] - at).abs() / 2.0 + (second[0] - first[0]).abs() / 2.0;
            at = second[0];
        }
        sum
    };
    let mut best = f64::INFINITY;
    permute(&mut vec![0, 1, 2, 3], 0, &mut |order| {
        for turned in 0..16_usize {
            let way: Vec<_> = order.iter().map(|&i| (i, turned >> i & 1 == 1)).collect();
            best = best.min(length(&way));
        }
    });
    let found = short_way(&stops(&some), &ranges);
    let mut sorted: Vec<usize> = found.iter().map(|(i, _)| *i).collect();
    sorted.sort_unstable();
    assert_eq!(sorted, [0, 1, 2, 3]);
    assert!(length(&found) <= 1.1 * best, "{} {best}", length(&found));
}

/// No two candidates are the same two postures, and none is compared with itself.
#[test]
fn no_pair_of_postures_is_offered_twice() {
    assert_eq!((Instrument::second(0, 1), Instrument::second(0, 2), Instrument::second(1, 2)), (0, 1, 0));
    for count in 3..60 {
        for i in 0..count {
            let second = Instrument::second(i, count);
            assert!(second < count && second != i && Instrument::second(second, count) != i, "{i} {count}");
        }
    }
}

fn permute(order: &mut Vec<usize>, from: usize, visit: &mut impl FnMut(&[usize])) {
    if from == order.len() {
        visit(order);
        return;
    }
    for i in from..order.len() {
        order.swap(from, i);
        permute(order, from + 1, visit);
        order.swap(from, i);
    }
}
