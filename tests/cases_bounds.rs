//! Bounded, sparse and robust results against what docs/theory.md section 9 says that they minimise: the conditions of
//! Karush, Kuhn and Tucker, from differences of the residual.

mod support;

use gough::calibration::representative::representative;
use gough::calibration::{Calibration, Coordinates};
use gough::files::{DataPlaces, ProblemFile, read_problem};
use gough::identify::{Identification, identify};
use gough::linalg;
use gough::problem::{Form, Problem};
use gough::simulate::close;
use gough::solve::{Stop, registry};

/// Half the distance over which rows are differenced, tolerances.
const STEP: f64 = 1e-2;
/// Distance, tolerances, from a limit or from zero up to which a coordinate is there.
const THERE: f64 = 1e-9;

fn problem(path: &str) -> ProblemFile {
    let places = DataPlaces { data_dir: None, shared: "no such folder".into() };
    read_problem(path.as_ref(), &places).unwrap()
}

fn found(problem: &ProblemFile, name: &str, settings: &[(&str, &str)]) -> Identification {
    let mut identifier = registry::find(name).unwrap();
    settings.iter().for_each(|(key, value)| identifier.set(key, value).unwrap());
    identify(&problem.mechanism, &problem.data.samples, identifier.as_ref(), &Stop::default()).unwrap()
}

/// What a run is told to minimise.
#[derive(Clone, Copy, Debug)]
struct Asked {
    bounds: f64,
    cone: f64,
    lasso: f64,
    group: f64,
    ridge: f64,
    huber: f64,
}

impl Asked {
    fn of(name: &str, settings: &[(&str, &str)]) -> Self {
        let number = |key: &str, none: f64| {
            settings.iter().find(|(k, _)| *k == key).map_or(none, |(_, value)| value.parse().unwrap())
        };
        let weight = |of: &str| if name == of { number("weight", 1.0) } else { 0.0 };
        Self {
            bounds: number("bounds", f64::INFINITY),
            cone: number("cone", f64::INFINITY),
            lasso: weight("conic-lasso"),
            group: weight("conic-group-lasso"),
            ridge: weight("conic-ridge"),
            huber: if name == "conic-huber" { number("delta", 1.345) } else { f64::INFINITY },
        }
    }

    fn has_prior(&self) -> bool {
        self.lasso + self.group + self.ridge == 0.0
    }
}

/// What was found of a result.
#[derive(Debug)]
struct Conditions {
    /// Value of the objective, the ridge among equals left out.
    value: f64,
    /// Largest component of the Lagrangian's gradient, and the same relative to column times influence.
    gradient: f64,
    relative: f64,
    /// Largest distance beyond a limit, tolerances.
    beyond: f64,
}

fn size(v: &[f64]) -> f64 {
    v.iter().map(|v| v * v).sum::<f64>().sqrt()
}

fn conditions(problem: &ProblemFile, found: &Identification, asked: &Asked) -> Conditions {
    let at = found.geometry.deviations_from(&found.start.nominal());
    let complete = Calibration::new(&found.start, &problem.data.samples, Form::Complete, &at);
    let coordinates = Coordinates::new(&found.start, Form::Complete);
    let x = coordinates.nearest(&at);
    let n = x.len();
    let representative =
        |x: &[f64]| representative(&found.start, &found.start.deviated(&coordinates.deviations(x)));
    let differences = |of: &dyn Fn(&[f64]) -> Vec<f64>| -> Vec<Vec<f64>> {
        let moved = |i: usize, way: f64| {
            let mut moved = x.clone();
            moved[i] += way;
            of(&moved)
        };
        let column = |i: usize| {
            let (ahead, behind) = (moved(i, STEP), moved(i, -STEP));
            ahead.iter().zip(behind).map(|(a, b)| (a - b) / (2.0 * STEP)).collect()
        };
        (0..n).map(column).collect()
    };
    let r = complete.residual(&x).unwrap();
    let columns = differences(&|x| complete.residual(x).unwrap());
    // The loss, posture by posture.
    let (mut influence, mut value) = (r.clone(), 0.0);
    for block in complete.blocks() {
        let (length, threshold) = (size(&r[block.clone()]), asked.huber * (block.len() as f64).sqrt());
        if length <= threshold {
            value += 0.5 * length * length;
        } else {
            value += threshold * (length - 0.5 * threshold);
            influence[block].iter_mut().for_each(|v| *v *= threshold / length);
        }
    }
    let mut gradient: Vec<f64> = columns.iter().map(|column| linalg::dot(column, &influence)).collect();
    if asked.has_prior() {
        let z = representative(&x);
        let minimal = Calibration::new(&found.start, &problem.data.samples, Form::Minimal, &at);
        let svd = linalg::svd(minimal.linearize(&z).unwrap().jac.as_ref()).unwrap();
        let mut pull = vec![0.0; z.len()];
        for k in 0..z.len() {
            let s = svd.s.get(k).copied().unwrap_or(0.0);
            let weight = ((s.max(1.0).powi(-2) - 0.01) / 0.99).max(0.0);
            let along: f64 = (0..z.len()).map(|i| svd.v[(i, k)] * z[i]).sum();
            value += 0.5 * weight * along * along;
            (0..z.len()).for_each(|i| pull[i] += weight * along * svd.v[(i, k)]);
        }
        for (g, column) in gradient.iter_mut().zip(differences(&representative)) {
            *g += linalg::dot(&column, &pull);
        }
    }
    for i in 0..n {
        value += 0.5 * asked.ridge * x[i] * x[i] + asked.lasso * x[i].abs();
        gradient[i] += asked.ridge * x[i];
        if x[i].abs() > THERE {
            gradient[i] += asked.lasso.copysign(x[i]);
        } else {
            gradient[i] = (gradient[i].abs() - asked.lasso).max(0.0).copysign(gradient[i]);
        }
    }
    let mut beyond = f64::NEG_INFINITY;
    let limits: Vec<(f64, f64)> = complete
        .params()
        .iter()
        .map(|p| (p.bounds.0.max(-asked.bounds), p.bounds.1.min(asked.bounds)))
        .collect();
    for (x, (low, high)) in x.iter().zip(&limits) {
        beyond = beyond.max(x - high).max(low - x);
    }
    for group in complete.groups() {
        let members = &group.members;
        let own: Vec<f64> = members.iter().map(|&i| x[i]).collect();
        let (length, steep) = (size(&own), size(&members.iter().map(|&i| gradient[i]).collect::<Vec<_>>()));
        value += asked.group * length;
        for &i in members {
            if length > THERE {
                gradient[i] += asked.group * x[i] / length;
            } else if asked.group > 0.0 {
                gradient[i] *= (1.0 - asked.group / steep).max(0.0);
            }
        }
        beyond = beyond.max(length - asked.cone);
        if length >= asked.cone - THERE {
            let free = |i: usize| x[i] < limits[i].1 - THERE && x[i] > limits[i].0 + THERE;
            let along: f64 = members.iter().filter(|&&i| free(i)).map(|&i| gradient[i] * x[i]).sum();
            let square: f64 = members.iter().filter(|&&i| free(i)).map(|&i| x[i] * x[i]).sum();
            members.iter().for_each(|&i| gradient[i] -= (along / square).min(0.0) * x[i]);
        }
    }
    let sizes: Vec<f64> = columns.iter().map(|column| size(column)).collect();
    let largest = sizes.iter().fold(0.0f64, |a, b| a.max(*b));
    let force = size(&influence);
    let (mut left, mut relative) = (0.0f64, 0.0f64);
    for i in 0..n {
        let (low, high) = limits[i];
        let held =
            (x[i] >= high - THERE && gradient[i] <= 0.0) || (x[i] <= low + THERE && gradient[i] >= 0.0);
        if !held {
            let terms = sizes[i].max(1e-8 * largest) * force + asked.lasso + asked.group + 1.0;
            left = left.max(gradient[i].abs());
            relative = relative.max(gradient[i].abs() / terms);
        }
    }
    Conditions { value, gradient: left, relative, beyond }
}

/// Runs `name`, prints what came of it, and returns it with its conditions.
fn checked(path: &str, name: &str, settings: &[(&str, &str)]) -> (Identification, Conditions) {
    let problem = problem(path);
    let begun = std::time::Instant::now();
    let found = found(&problem, name, settings);
    let time = begun.elapsed().as_secs_f64();
    let conditions = conditions(&problem, &found, &Asked::of(name, settings));
    let (report, steps) = (&found.report, found.trace.len());
    println!(
        "{path} {name} {settings:?}: {} in {steps} ({time:.2} s), {} active, kkt {:?}, {conditions:?}",
        report.outcome,
        report.active.len(),
        report.kkt
    );
    (found, conditions)
}

/// Five joints, sixty thousandths of noise: the data decide everything, no prior has a say.
#[test]
fn within_limits_the_projected_gradient_of_the_squares_is_zero() {
    let path = "tests/data/cases/bounds/bounded-arm-5r.json";
    for settings in [
        &[("bounds", "1.2")][..],
        &[("bounds", "0.5")],
        &[("cone", "1.5")],
        &[("bounds", "1.2"), ("cone", "1.6")],
    ] {
        let (found, conditions) = checked(path, "conic-bounded", settings);
        assert!(found.report.outcome.converged() && !found.report.active.is_empty());
        assert!(conditions.gradient < 1e-4 && conditions.relative < 1e-8, "{settings:?}: {conditions:?}");
        assert!(conditions.beyond < 1e-9 && found.report.kkt.unwrap() < 1e-6);
    }
}

/// Limits on two links, whose errors along their parallel axes any of the other links may carry as well.
#[test]
fn limits_exclude_a_machine_only_if_no_description_of_it_fits() {
    let path = "tests/data/cases/bounds/bounds-gauge.json";
    let (_, unlimited) = checked(path, "minimal", &[]);
    let (found, conditions) = checked(path, "conic-bounded", &[]);
    assert!(unlimited.beyond > 1.0, "limits must bind: {unlimited:?}");
    assert!(found.report.outcome.converged() && conditions.beyond < 1e-9);
    assert!(conditions.relative < 1e-6, "{conditions:?}");
    assert!(conditions.value < 1.005 * unlimited.value, "{conditions:?}");
}

/// The same programs, solved by SciPy with kinematics of its own (tests/generate/bounded.py).
#[test]
fn scipy_finds_the_same() {
    let solved = support::json(&support::file("tests/data/cases/bounds/scipy.json"));
    for solved in solved.as_array().unwrap() {
        let path = solved["problem"].as_str().unwrap();
        let limit = |key: &str| solved[key].as_f64().map(|v| (key.to_owned(), v.to_string()));
        let limits: Vec<(String, String)> = ["bounds", "cone"].into_iter().filter_map(limit).collect();
        let settings: Vec<(&str, &str)> = limits.iter().map(|(k, v)| (k.as_str(), v.as_str())).collect();
        let (found, conditions) = checked(path, "conic-bounded", &settings);
        let value = solved["value"].as_f64().unwrap();
        assert!((conditions.value / value - 1.0).abs() < 1e-7, "{path}: {} and {value}", conditions.value);
        let samples = problem(path).data.samples;
        for (sample, position) in samples.iter().zip(solved["positions"].as_array().unwrap()) {
            let tool = close(&found.start, &found.geometry, &sample.actuators).unwrap().tool();
            let apart = size(&[0, 1, 2].map(|i| tool.p[i] - position[i].as_f64().unwrap()));
            assert!(apart < 1e-7, "{path}: {apart:e} m apart");
        }
    }
}

/// A problem, an identifier and its settings.
type Job<'a> = (&'a str, &'a str, &'a [(&'a str, &'a str)]);

fn all_meet_their_conditions(jobs: &[Job]) {
    for (path, name, settings) in jobs {
        let (found, conditions) = checked(path, name, settings);
        assert!(found.report.outcome.converged(), "{path} {name} {settings:?}: {}", found.report.outcome);
        assert!(conditions.relative < 1e-6, "{path} {name} {settings:?}: {conditions:?}");
        assert!(conditions.beyond < 1e-9 && found.report.kkt.unwrap() < 1e-6);
    }
}

#[test]
fn arms_meet_their_conditions() {
    all_meet_their_conditions(&[
        ("problems/serial-puma560.json", "conic-bounded", &[("bounds", "0.8")]),
        ("problems/serial-puma560.json", "conic-huber", &[]),
        ("tests/data/cases/bounds/bounded-arm-5r.json", "conic-bounded", &[("cone", "1.6")]),
        ("problems/serial-scara.json", "conic-bounded", &[("cone", "1.2")]),
        ("problems/serial-scara.json", "conic-lasso", &[("weight", "10")]),
        ("problems/serial-kuka-lbr.json", "conic-bounded", &[("bounds", "1")]),
        ("problems/serial-stanford.json", "conic-group-lasso", &[("weight", "30")]),
        ("problems/serial-stanford.json", "conic-ridge", &[("bounds", "1")]),
    ]);
}

#[test]
fn a_tripod_meets_its_conditions() {
    all_meet_their_conditions(&[
        ("problems/tripod-3rps.json", "conic-huber", &[]),
        ("problems/tripod-3rps.json", "conic-ridge", &[]),
    ]);
}

#[test]
#[ignore = "minutes: closed loops under every limit, penalty and loss"]
fn closed_loops_meet_their_conditions() {
    all_meet_their_conditions(&[
        ("problems/tripod-3rps.json", "conic-bounded", &[("bounds", "1.5")]),
        ("problems/tripod-3rps.json", "conic-bounded", &[("cone", "1.5")]),
        ("problems/tripod-3prs.json", "conic-bounded", &[("bounds", "1.5")]),
        ("problems/tripod-3prs.json", "conic-lasso", &[("weight", "3")]),
        ("problems/delta-3puu.json", "conic-bounded", &[("bounds", "1.2")]),
        ("problems/delta-3puu.json", "conic-group-lasso", &[("weight", "3")]),
        ("problems/delta-3puu.json", "conic-huber", &[("bounds", "2"), ("delta", "3")]),
        ("problems/tripod-3rrs.json", "conic-bounded", &[("bounds", "1.5")]),
        ("problems/tripod-3rrs.json", "conic-bounded", &[("cone", "2")]),
        ("problems/hexapod-6ups.json", "conic-bounded", &[("bounds", "1.5")]),
        ("problems/hexapod-6ups.json", "conic-huber", &[]),
    ]);
}
