//! Right results and planted wrong ones, with and without a truth: what a comparison says of them.
//!
//! A result is right that its identifier calls converged. Wrong ones are made of it: they differ from it by at least three
//! standard errors in what they predict of the training postures, or stand in another assembly mode.

mod support;

use gough::calibration::{Coordinates, Sample};
use gough::compare::bound::{Bound, bound};
use gough::compare::draw::{Drawn, draw};
use gough::compare::line::{Score, Source};
use gough::compare::score::{after, before, verify};
use gough::compare::tolerance::Tolerance;
use gough::files::{DataPlaces, ProblemFile, read_problem};
use gough::identify::residuals::residuals;
use gough::identify::{Identification, identify_from};
use gough::model::{Geometry, Mechanism, Posture};
use gough::problem::Form;
use gough::simulate::close;
use gough::solve::{Identifier, Stop, registry};
use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::collections::BTreeMap;

/// Arms, closed loops, kinds of measurement.
const MACHINES: [&str; 14] = [
    "serial-puma560",
    "serial-scara",
    "serial-scara-screw",
    "serial-stanford",
    "serial-ur10",
    "kinds/serial-puma560-position",
    "kinds/serial-puma560-mixed",
    "tripod-3rps",
    "tripod-3prs",
    "delta-3puu",
    "kinds/delta-3puu-separation",
    "kinds/hexapod-6ups-plane",
    "hexapod-6ups",
    "hexapod-640",
];

/// Identifiers with their settings; limits that are wide, that some of the truth is beyond, and that exclude it.
const IDENTIFIERS: [(&str, &[(&str, &str)]); 18] = [
    ("minimal", &[]),
    ("map", &[]),
    ("argmin-lm", &[]),
    ("argmin-trust-region", &[]),
    ("argmin-lbfgs", &[]),
    ("complete", &[]),
    ("textbook", &[]),
    ("limbwise", &[]),
    ("conic-bounded", &[]),
    ("conic-bounded", &[("bounds", "50"), ("cone", "100")]),
    ("conic-bounded", &[("bounds", "1")]),
    ("conic-bounded", &[("cone", "1.5")]),
    ("conic-ridge", &[("bounds", "0.5")]),
    ("conic-lasso", &[]),
    ("conic-group-lasso", &[]),
    ("conic-huber", &[]),
    ("conic-huber", &[("bounds", "1")]),
    ("conic-minimax", &[]),
];

/// What a comparison said: of how many, and of how many otherwise than it should.
#[derive(Default)]
struct Counted(BTreeMap<String, (usize, usize)>);

impl Counted {
    fn add(&mut self, what: &str, mistaken: bool) {
        let (all, wrong) = self.0.entry(what.to_owned()).or_default();
        (*all, *wrong) = (*all + 1, *wrong + usize::from(mistaken));
    }

    fn sum(&self) -> (usize, usize) {
        self.0.values().fold((0, 0), |(a, b), (all, wrong)| (a + all, b + wrong))
    }
}

/// A run with the truth, or without one, with or without a hold-out.
struct Judge {
    drawn: Drawn,
    bound: Option<Bound>,
    before: Score,
    label: &'static str,
}

impl Judge {
    fn new(drawn: Drawn, label: &'static str) -> Self {
        let bound = bound(&drawn);
        let before = before(&drawn, bound.as_ref());
        Self { drawn, bound, before, label }
    }

    /// Whether the result is verified, and what is said.
    fn verified(&self, found: &Identification, form: Form) -> (bool, String) {
        let score = after(&self.before, &self.drawn, self.bound.as_ref(), found, form);
        let verified = verify(&score, &Tolerance::named("default").unwrap());
        (verified.success, format!("{verified:?} {score:?}"))
    }
}

fn judges(drawn: &Drawn) -> [Judge; 3] {
    let unknown = Drawn { truth: None, ..drawn.clone() };
    let bare = Drawn { holdout: Vec::new(), ..unknown.clone() };
    [Judge::new(drawn.clone(), "truth"), Judge::new(unknown, "no truth"), Judge::new(bare, "no hold-out")]
}

/// Length of the difference of what two machines predict of the samples, in standard deviations of the noise.
fn apart(machine: &Mechanism, samples: &[Sample], a: &Geometry, b: &Geometry) -> f64 {
    let [a, b] = [a, b].map(|geometry| residuals(machine, geometry, samples));
    let square = a.iter().zip(&b).map(|pair| match pair {
        (Some(a), Some(b)) => a.rows.iter().zip(&b.rows).map(|(a, b)| (a - b).powi(2)).sum::<f64>(),
        (None, None) => 0.0,
        _ => f64::INFINITY,
    });
    square.sum::<f64>().sqrt()
}

struct Planter<'a> {
    found: &'a Identification,
    coordinates: Coordinates,
    at: Vec<f64>,
    rng: ChaCha8Rng,
}

impl<'a> Planter<'a> {
    fn new(found: &'a Identification, seed: u64) -> Self {
        let at = found.geometry.deviations_from(&found.start.nominal());
        let coordinates = Coordinates::new(&found.start, Form::Complete);
        Self { found, coordinates, at, rng: ChaCha8Rng::seed_from_u64(seed) }
    }

    fn with(&self, deviations: &[f64]) -> Identification {
        Identification { geometry: self.found.start.deviated(deviations), ..self.found.clone() }
    }

    /// Standard errors of the complete coordinates with the full prior, and directions of all, by (10.1).
    fn covariance_root(&self) -> Vec<Vec<f64>> {
        let seen = self.found.visibility.as_ref().unwrap();
        let minimal = Coordinates::new(&self.found.start, Form::Minimal);
        let columns = seen.directions.col_iter().zip(&seen.singular_values);
        let links = |(v, s): (faer::ColRef<f64>, &f64)| {
            let scaled: Vec<f64> = v.iter().map(|v| v / (1.0 + s * s).sqrt()).collect();
            self.coordinates.nearest(&minimal.deviations(&scaled))
        };
        columns.map(links).collect()
    }

    /// A link off in one component by some standard errors, up to a tolerance.
    fn link_off(&mut self, root: &[Vec<f64>]) -> Option<Identification> {
        let count = self.coordinates.count();
        let std = |i: usize| root.iter().map(|column| column[i] * column[i]).sum::<f64>().sqrt();
        let known: Vec<usize> = (0..count).filter(|&i| std(i) > 1e-9 && std(i) < 1.0 / 3.0).collect();
        let &i = known.get(self.rng.random_range(0..known.len().max(1)))?;
        let share: f64 = self.rng.random();
        let size = (3.0 * std(i)).powf(1.0 - share);
        let mut x = self.coordinates.nearest(&self.at);
        x[i] += if self.rng.random() { size } else { -size };
        Some(self.with(&self.coordinates.deviations(&x)))
    }

    /// All directions off by a part of a standard error.
    fn shaken(&mut self, root: &[Vec<f64>], part: f64) -> Identification {
        let mut x = self.coordinates.nearest(&self.at);
        for column in root {
            let normal: f64 = StandardNormal.sample(&mut self.rng);
            x.iter_mut().zip(column).for_each(|(x, c)| *x += part * normal * c);
        }
        self.with(&self.coordinates.deviations(&x))
    }

    /// Deviations of two links exchanged, of different limbs where there are several.
    fn exchanged(&mut self) -> Identification {
        let limbs = &self.found.start.limbs;
        let mut first = vec![0];
        limbs.iter().for_each(|limb| first.push(first[first.len() - 1] + limb.links.len()));
        let mut pairs = Vec::new();
        for a in 0..first[limbs.len()] {
            for b in a + 1..first[limbs.len()] {
                let limb = |link: usize| first.iter().rposition(|f| *f <= link).unwrap();
                if limbs.len() == 1 || (limb(a) != limb(b) && a - first[limb(a)] == b - first[limb(b)]) {
                    pairs.push((a, b));
                }
            }
        }
        pairs.shuffle(&mut self.rng);
        let (a, b) = pairs[0];
        let mut at = self.at.clone();
        (0..6).for_each(|i| at.swap(6 * a + i, 6 * b + i));
        self.with(&at)
    }

    /// The machine in another assembly mode at home.
    fn other_mode(&mut self) -> Option<Identification> {
        let (machine, geometry) = (&self.found.start, &self.found.geometry);
        let home = close(machine, geometry, &vec![0.0; machine.actuator_count()]).ok()?.tool();
        let mut posture = Posture::new(machine);
        let passive = posture.passive(machine).len();
        for _ in 0..60 {
            let random: Vec<f64> = (0..passive).map(|_| self.rng.random_range(-1.5..1.5)).collect();
            posture.set_joints(machine, &vec![0.0; machine.actuator_count()], &random);
            if posture.close(machine, geometry).is_err() || (posture.tool().p - home.p).norm() < 1e-3 {
                continue;
            }
            let mut turned = geometry.clone();
            let mut q = posture.q.iter();
            for (limb, links) in machine.limbs.iter().zip(&mut turned.limbs) {
                for (joint, link) in limb.joints.iter().zip(links.iter_mut()) {
                    *link = joint.motion.moved(link, *q.next()?);
                }
            }
            return Some(Identification { geometry: turned, ..self.found.clone() });
        }
        None
    }
}

/// What is planted, by kind.
fn planted(
    found: &Identification,
    other: Option<&Identification>,
    stopped: Option<&Identification>,
    seed: u64,
) -> Vec<(&'static str, Identification)> {
    let mut planter = Planter::new(found, seed);
    let root = planter.covariance_root();
    let mut out = Vec::new();
    for _ in 0..2 {
        out.extend(planter.link_off(&root).map(|wrong| ("a link off", wrong)));
    }
    out.push(("noise of a standard error", planter.shaken(&root, 1.0)));
    out.push(("noise of half of one", planter.shaken(&root, 0.5)));
    let signs: Vec<f64> = planter.at.iter().map(|d| -d).collect();
    out.push(("wrong sign", planter.with(&signs)));
    let mut one = planter.at.clone();
    let link = 6 * planter.rng.random_range(0..found.start.link_component_count() / 6);
    one[link..link + 6].iter_mut().for_each(|d| *d = -*d);
    out.push(("wrong sign of a link", planter.with(&one)));
    out.push(("links exchanged", planter.exchanged()));
    out.push(("the drawing", planter.with(&vec![0.0; planter.at.len()])));
    if !found.start.is_open_chain() {
        out.extend(planter.other_mode().map(|wrong| ("another assembly mode", wrong)));
    }
    let with_geometry =
        |of: &Identification| Identification { geometry: of.geometry.clone(), ..found.clone() };
    out.extend(other.map(|of| ("deviations of another seed", with_geometry(of))));
    out.extend(stopped.map(|of| ("stopped early", of.clone())));
    // It says that it fits to perfection, whatever it is.
    let mut lies = planter.link_off(&root).unwrap_or_else(|| planter.shaken(&root, 1.0));
    lies.report.cost = 0.0;
    lies.report.kkt = Some(0.0);
    lies.trace.iter_mut().for_each(|step| step.cost = 0.0);
    let little = lies.fit.1.map(|fit| gough::identify::Fit { weighted_rms: 0.5 * fit.weighted_rms, ..fit });
    lies.fit.1 = little;
    out.push(("a lower cost stated", lies));
    out
}

fn identifier(name: &str, settings: &[(&str, &str)]) -> Box<dyn Identifier> {
    let mut identifier = registry::find(name).unwrap();
    settings.iter().for_each(|(key, value)| identifier.set(key, value).unwrap());
    identifier
}

fn problem(name: &str) -> ProblemFile {
    let places = DataPlaces { data_dir: None, shared: "no such folder".into() };
    read_problem(&support::file(&format!("problems/{name}.json")), &places).unwrap()
}

/// Runs the campaign on a share of it: right ones that are rejected and wrong ones that are verified.
fn campaign(machines: &[&str], seeds: u64, take: impl Fn(usize, usize, u64) -> bool) -> [Counted; 2] {
    let (mut right, mut wrong) = (Counted::default(), Counted::default());
    for (m, name) in machines.iter().enumerate() {
        let problem = problem(name);
        for seed in 1..=seeds {
            let of_seed = |seed| draw(&problem, Source::Simulated, 1.0, 0.0, seed).unwrap();
            let drawn = of_seed(seed);
            let judges = judges(&drawn);
            let minimal = identifier("minimal", &[]);
            let run = |drawn: &Drawn, by: &dyn Identifier, stop: &Stop| {
                identify_from(&problem.mechanism, &drawn.samples, by, stop, &drawn.from).ok()
            };
            let other = run(&of_seed(seed + 100), minimal.as_ref(), &Stop::default());
            for (k, (solver, settings)) in IDENTIFIERS.iter().enumerate() {
                // It minimises an approximation on closed loops (docs/compare.md).
                if !take(m, k, seed) || (*solver == "limbwise" && !problem.mechanism.is_open_chain()) {
                    continue;
                }
                let label = format!("{solver} {settings:?}");
                let by = identifier(solver, settings);
                let Some(found) = run(&drawn, by.as_ref(), &Stop::default()) else { continue };
                if !found.report.outcome.converged() {
                    eprintln!("{name} {seed} {label}: {}", found.report.outcome);
                    continue;
                }
                let early = Stop { iterations: 2, ..Stop::default() };
                let stopped =
                    run(&drawn, by.as_ref(), &early).filter(|found| !found.report.outcome.converged());
                let all = planted(&found, other.as_ref(), stopped.as_ref(), 1000 * seed + k as u64);
                let differs = |what: &str, wrong: &Identification| {
                    what == "another assembly mode"
                        || apart(&found.start, &drawn.samples, &found.geometry, &wrong.geometry) > 3.0
                };
                let all: Vec<_> = all.into_iter().filter(|(what, wrong)| differs(what, wrong)).collect();
                for judge in &judges {
                    let (verified, why) = judge.verified(&found, by.form());
                    right.add(&format!("{label}, {}", judge.label), !verified);
                    if !verified {
                        eprintln!("REJECTED {name} {seed} {label} {}: {why}", judge.label);
                    }
                    for (what, planted) in &all {
                        let (verified, why) = judge.verified(planted, by.form());
                        wrong.add(&format!("{what}, {}", judge.label), verified);
                        if verified {
                            let far = apart(&found.start, &drawn.samples, &found.geometry, &planted.geometry);
                            eprintln!(
                                "VERIFIED {name} {seed} {label} {}: {what} {far:.1}: {why}",
                                judge.label
                            );
                        }
                    }
                }
            }
        }
    }
    for (title, counted) in [("right, rejected", &right), ("wrong, verified", &wrong)] {
        eprintln!("{title}:");
        counted.0.iter().for_each(|(what, (all, bad))| eprintln!("  {what}: {bad} of {all}"));
    }
    [right, wrong]
}

/// A share of the campaign: each identifier on two machines that are quick.
#[test]
fn a_wrong_result_is_not_verified_and_a_right_one_is() {
    let [right, wrong] = campaign(&["serial-scara", "tripod-3rps"], 1, |_, _, _| true);
    let ((rights, rejected), (wrongs, verified)) = (right.sum(), wrong.sum());
    assert!(rights >= 60 && wrongs >= 300, "{rights} {wrongs}");
    assert_eq!((rejected, verified), (0, 0));
}

/// The whole: every machine, seeds and identifiers.
#[test]
#[ignore = "minutes"]
fn all_machines() {
    let number = |name: &str, usual: &str| std::env::var(name).unwrap_or_else(|_| usual.into());
    let seeds = number("GOUGH_SEEDS", "3").parse().unwrap();
    let only = number("GOUGH_MACHINES", "");
    let machines: Vec<&str> =
        MACHINES.into_iter().filter(|name| only.is_empty() || only.contains(name)).collect();
    let [right, wrong] =
        campaign(&machines, seeds, |m, k, seed| seed == 1 || (m + k + seed as usize) % 3 == 0);
    let ((rights, rejected), (wrongs, verified)) = (right.sum(), wrong.sum());
    eprintln!("{rejected} of {rights} right rejected, {verified} of {wrongs} wrong verified");
    assert_eq!(verified, 0);
    assert!(100 * rejected <= rights);
}
