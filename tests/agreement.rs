//! Every identifier on every problem of problems/: those that minimise the same predict the same poses, and where
//! two minimise different things, removing the difference removes the disagreement.

mod support;

use gough::calibration::{Calibration, Sample};
use gough::files::{DataPlaces, ProblemFile, read_problem};
use gough::identify::{Identification, identify};
use gough::measure::{Evaluation, View, Weights};
use gough::model::{Geometry, Mechanism, Posture};
use gough::problem::Form;
use gough::simulate::{Plan, draw_deviations, simulate};
use gough::solve::{Estimate, Identifier, Stop, registry};
use rayon::prelude::*;

/// Root mean square difference of predicted hold-out poses, in standard deviations of a measured component, up to
/// which two identifiers agree.
const AGREE: f64 = 0.05;

/// Identifiers of another merit than least squares and prior: they may differ from the others by as much as their
/// loss or penalty changes the estimate, and no limit of that follows from the problem. `conic-minimax` moreover
/// takes more steps than a test may on closed loops (docs/identifiers.md).
const OTHER_MERIT: [&str; 4] = ["conic-lasso", "conic-group-lasso", "conic-huber", "conic-minimax"];

/// Kinds of machine, so that no test takes long.
const SERIAL: &[&str] = &["serial"];
const FEW_LIMBS: &[&str] = &["delta", "positioner", "tricept", "tripod"];
const HEXAPODS: &[&str] = &["hexapod-6"];
const HEXAPODS_2: &[&str] = &["hexapod-b", "hexapod-s"];

fn problems(class: &[&str]) -> Vec<ProblemFile> {
    let places = DataPlaces { data_dir: None, shared: "no such folder".into() };
    let of_class = |name: &str| class.iter().any(|start| name.starts_with(start));
    let paths = support::problems().into_iter().filter(|path| of_class(&support::name(path)));
    let problems: Vec<ProblemFile> =
        paths.map(|path| read_problem(&path, &places).expect("a problem")).collect();
    assert!(problems.len() >= 2, "{class:?}");
    problems
}

#[test]
fn every_problem_is_in_a_class() {
    let classes = [SERIAL, FEW_LIMBS, HEXAPODS, HEXAPODS_2];
    let count: usize = classes.iter().map(|class| problems(class).len()).sum();
    assert_eq!(count, support::problems().len());
}

fn with(name: &str, settings: &[(&str, &str)]) -> Box<dyn Identifier> {
    let mut identifier = registry::find(name).expect("registered");
    settings.iter().for_each(|(key, value)| identifier.set(key, value).expect("a setting it has"));
    identifier
}

/// Setting of `minimal` that puts the prior at full weight on every direction.
const ONLY_PRIOR: (&str, &str) = ("threshold", "1e9");
/// Setting of `minimal` that leaves no prior to speak of.
const NO_PRIOR: (&str, &str) = ("threshold", "1e-9");

fn run(problem: &ProblemFile, samples: &[Sample], identifier: &dyn Identifier) -> Identification {
    identify(&problem.mechanism, samples, identifier, &Stop::default()).expect("identified")
}

/// Root mean square difference of the hold-out poses that two machines predict, each component in its own noise.
fn apart(problem: &ProblemFile, a: &Geometry, b: &Geometry) -> f64 {
    assert!(problem.data.has_noise() && problem.holdout.samples.len() >= 20, "{}", problem.name);
    let (mut square, mut count) = (0.0, 0.0);
    let mut posture = Posture::new(&problem.mechanism);
    let mut predict = |geometry: &Geometry, sample: &Sample| {
        sample.close(&problem.mechanism, geometry, &mut posture).expect("a hold-out pose that closes");
        posture.tool()
    };
    for sample in &problem.holdout.samples {
        let (one, other) = (predict(a, sample), predict(b, sample));
        let mut out = Evaluation::default();
        sample.measurement.expected(&View::of_tool(&one)).evaluate(&View::of_tool(&other), &mut out);
        square += out.square();
        count += out.rows.len() as f64;
    }
    (square / count).sqrt()
}

/// Checks every identifier that minimises squares, with or without the prior, on the problems of a class.
fn agree(class: &[&str]) {
    problems(class).par_iter().for_each(|problem| {
        let samples = &problem.data.samples;
        let minimal = run(problem, samples, with("minimal", &[]).as_ref());
        let under_prior = run(problem, samples, with("minimal", &[ONLY_PRIOR]).as_ref());
        assert!(minimal.report.outcome.converged() && under_prior.report.outcome.converged());
        let mut agreed = 0;
        for identifier in registry::all() {
            let (name, form) = (identifier.name(), identifier.form());
            // `limbwise` and the published form weigh the data otherwise: they have tests of their own below.
            if OTHER_MERIT.contains(&name) || name == "limbwise" || form == Form::Plain {
                continue;
            }
            let found = run(problem, samples, identifier.as_ref());
            let outcome = &found.report.outcome;
            if !outcome.converged() {
                eprintln!("{} {name}: {outcome}", problem.name);
                // Baselines may fail, and say so; the others may not.
                assert!(["argmin-lbfgs", "complete"].contains(&name), "{} {name}: {outcome}", problem.name);
                continue;
            }
            // What the prior moves is no disagreement between solvers: like is compared with like.
            let reference = match found.report.estimate {
                Estimate::Ridge { .. } => &under_prior,
                _ => &minimal,
            };
            let distance = apart(problem, &found.geometry, &reference.geometry);
            eprintln!("{} {name}: {distance:.5}", problem.name);
            assert!(distance <= AGREE, "{} {name}: {distance}", problem.name);
            agreed += 1;
        }
        assert!(agreed >= 6, "{}: {agreed} agree", problem.name);
        // All that `map` and `conic-ridge` differ by from the others is the prior on directions that the data know
        // better than the tolerance: it moves a prediction by less than the data leave uncertain.
        let by_prior = apart(problem, &minimal.geometry, &under_prior.geometry);
        eprintln!("{} moved by the prior: {by_prior:.5}", problem.name);
        assert!(by_prior <= 0.2, "{}: {by_prior}", problem.name);
    });
}

#[test]
fn serial_machines_agree() {
    agree(SERIAL);
}

#[test]
fn machines_with_few_limbs_agree() {
    agree(FEW_LIMBS);
}

#[test]
fn hexapods_agree() {
    agree(HEXAPODS);
}

#[test]
fn other_hexapods_agree() {
    agree(HEXAPODS_2);
}

/// The samples as the true machine gives them, weighted as if their noise were `share` of the stated one.
fn exact(problem: &ProblemFile, share: f64) -> Vec<Sample> {
    let truth: &Mechanism = problem.truth.as_ref().expect("a benchmark problem states its truth");
    let noise = problem.data.noise.expect("stated").map_diagonal(|v| v.sqrt() * share);
    let weights = Weights::Isotropic { angle: noise[0], length: noise[3] };
    let mut posture = Posture::new(truth);
    let exact = |sample: &Sample| {
        sample.close(truth, &truth.nominal(), &mut posture).expect("the true machine closes");
        let measurement = sample.measurement.expected(&View::of_tool(&posture.tool())).reweighted(weights);
        Sample { measurement, ..sample.clone() }
    };
    problem.data.samples.iter().map(exact).collect()
}

/// `limbwise` ignores that the noise of one pose is the same for all limbs, and leaves to the prior what a limb by
/// itself does not show. Both are matters of noise: predictions differ by less than the noise itself, and
/// where the data are exact, and weighted as such within a tenth of the noise, they agree. A serial machine is one
/// limb: they always agree.
#[test]
fn limbwise_differs_by_the_noise_that_limbs_share() {
    for class in [SERIAL, FEW_LIMBS, HEXAPODS, HEXAPODS_2] {
        problems(class).par_iter().for_each(|problem| {
            let distance = |samples: &[Sample]| {
                let minimal = run(problem, samples, with("minimal", &[]).as_ref());
                let limbwise = run(problem, samples, with("limbwise", &[]).as_ref());
                let outcome = &limbwise.report.outcome;
                assert!(outcome.converged(), "{}: {outcome}", problem.name);
                apart(problem, &limbwise.geometry, &minimal.geometry)
            };
            let (noisy, clean) = (distance(&problem.data.samples), distance(&exact(problem, 0.1)));
            eprintln!("{} limbwise: {noisy:.5}, without noise {clean:.5}", problem.name);
            assert!(noisy <= if class == SERIAL { AGREE } else { 1.0 }, "{}: {noisy}", problem.name);
            assert!(clean <= AGREE, "{}: {clean}", problem.name);
        });
    }
}

/// `textbook` weighs 1 rad like 1 m and takes twists at the origin: least squares under the same weights agree with
/// it. On closed loops it diverges or follows noise along flat valleys (docs/theory.md section 5).
#[test]
fn textbook_differs_by_its_weights() {
    problems(SERIAL).par_iter().for_each(|problem| {
        let samples = &problem.data.samples;
        let textbook = run(problem, samples, with("textbook", &[]).as_ref());
        assert!(textbook.report.outcome.converged(), "{}", problem.name);
        let plain = |s: &Sample| s.measurement.reweighted(Weights::SpatialTwist);
        let plain: Vec<Sample> =
            samples.iter().map(|s| Sample { measurement: plain(s), ..s.clone() }).collect();
        let same = run(problem, &plain, with("minimal", &[NO_PRIOR]).as_ref());
        let distance = apart(problem, &textbook.geometry, &same.geometry);
        eprintln!("{} textbook: {distance:.5} under its own weights", problem.name);
        assert!(distance <= AGREE, "{}: {distance}", problem.name);
    });
}

/// Draws of a start or a truth.
const SEEDS: [u64; 3] = [1, 2, 3];

/// Runs from link deviations drawn from five times the tolerances, with the samples that close there, and again with
/// those that close where the run ended, as `identify` does.
fn from_afar(problem: &ProblemFile, identifier: &dyn Identifier, seed: u64) -> Geometry {
    let (machine, samples) = (&problem.mechanism, &problem.data.samples);
    let mut at = draw_deviations(machine, seed, 5.0);
    let mut calibration = Calibration::new(machine, samples, identifier.form(), &at);
    for _ in 0..4 {
        let start = calibration.coordinates().nearest(&at);
        let report = identifier.identify(&calibration, &start, &Stop::default());
        let set_aside = calibration.set_aside().len();
        eprintln!(
            "{} {} from start {seed}: {} after {} iterations, {set_aside} set aside",
            problem.name,
            identifier.name(),
            report.outcome,
            report.trace.len(),
        );
        assert!(report.outcome.converged(), "{} {}: {}", problem.name, identifier.name(), report.outcome);
        at = calibration.coordinates().deviations(&report.x);
        if set_aside == 0 {
            return machine.deviated(&at);
        }
        calibration.take_back(samples, &at, 0.0);
    }
    panic!("{} {}: postures stay set aside", problem.name, identifier.name());
}

/// A machine drawn from five times the tolerances, measured as the problem's was.
fn far_machine(problem: &ProblemFile, seed: u64) -> Vec<Sample> {
    let plan = Plan { poses: 60, holdout: 0, seed, noise: 1.0, distance: 5.0 };
    let there = simulate(&problem.mechanism, &problem.data.noise.expect("stated"), &plan).expect("simulated");
    let samples = there.samples.iter().zip(&problem.data.samples);
    samples
        .map(|((actuators, pose), like)| Sample {
            actuators: actuators.clone(),
            measurement: like.measurement.expected(&View::of_tool(pose)),
            ..like.clone()
        })
        .collect()
}

/// `argmin-lm` and `map` from nominal, from starts five tolerances away, and to machines five tolerances away.
fn converge(class: &[&str]) {
    problems(class).par_iter().for_each(|problem| {
        for solver in ["argmin-lm", "map"] {
            let identifier = with(solver, &[]);
            let near = run(problem, &problem.data.samples, identifier.as_ref());
            assert!(near.report.outcome.converged(), "{} {solver}: {}", problem.name, near.report.outcome);
            for seed in SEEDS {
                let far = from_afar(problem, identifier.as_ref(), seed);
                let distance = apart(problem, &far, &near.geometry);
                eprintln!("{} {solver} from start {seed}: {distance:.5}", problem.name);
                assert!(distance <= AGREE, "{} {solver} from start {seed}: {distance}", problem.name);
                let there = run(problem, &far_machine(problem, seed), identifier.as_ref());
                let outcome = &there.report.outcome;
                eprintln!(
                    "{} {solver} to machine {seed}: {outcome} in {}, {} set aside",
                    problem.name,
                    there.trace.len(),
                    there.set_aside.len()
                );
                assert!(outcome.converged(), "{} {solver} to machine {seed}: {outcome}", problem.name);
            }
        }
    });
}

#[test]
fn serial_machines_converge_from_afar() {
    converge(SERIAL);
}

#[test]
fn machines_with_few_limbs_converge_from_afar() {
    converge(FEW_LIMBS);
}

#[test]
fn hexapods_converge_from_afar() {
    converge(HEXAPODS);
}

#[test]
fn other_hexapods_converge_from_afar() {
    converge(HEXAPODS_2);
}
