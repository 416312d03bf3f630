//! Mistakes planted in simulated data of machines of many kinds, and what a search makes of them.

mod spoil;

use gough::check::correction::{actuated, applied};
use gough::check::{Correction, Finding, Reading, Verdict, expected, search};
use gough::files::{DataPlaces, read_problem};
use gough::identify::registration::FreeEnds;
use gough::lie::{Se3, so3};
use gough::measure::Point;
use gough::model::{Mechanism, Prior};
use gough::simulate::{Plan, simulate};
use nalgebra::{Matrix3, Matrix6, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use spoil::{kinds, spoiled};
use std::ops::{Range, RangeInclusive};
use std::time::Instant;

const MACHINES: [&str; 12] = [
    "serial-puma560",
    "serial-kuka-lbr",
    "serial-ur10",
    "serial-stanford",
    "hexapod-6ups",
    "hexapod-6pus",
    "hexapod-6rus",
    "tripod-3prs",
    "tripod-3rps",
    "tripod-3rrs",
    "tripod-3upu",
    "delta-3puu",
];

/// What to plant: a run a machine and seed and number of mistakes.
pub struct Planting {
    pub seeds: Range<u64>,
    pub mistakes: RangeInclusive<usize>,
}

/// What came of it.
#[derive(Debug, Default)]
pub struct Outcome {
    /// Stories that put the planted numbers right.
    pub named: usize,
    /// Mistakes that noise and tolerances, or free ends, explain.
    pub unseen: usize,
    /// No story though the data do not fit.
    pub unknown: Vec<String>,
    /// Stories of what was not planted.
    pub falsely: Vec<String>,
    /// Longest search, s.
    pub longest: f64,
}

fn normal(rng: &mut ChaCha8Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| StandardNormal.sample(rng))
}

/// A set-up: the machine as drawn with its ends, and readings without mistakes.
struct SetUp {
    what: String,
    mechanism: Mechanism,
    clean: Vec<Reading>,
    stated: bool,
}

fn set_up(machine: &str, seed: u64) -> SetUp {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("problems/{machine}.json"));
    let problem = read_problem(&path, &DataPlaces::from_environment(None)).unwrap();
    let mut mechanism = problem.mechanism.clone();
    let mut rng = ChaCha8Rng::seed_from_u64(1000 + seed);
    let (free, targets) = (rng.random::<f64>() < 0.5, [0, 1, 3][rng.random_range(0..3)]);
    let rows = match rng.random_range(0..10) {
        0 => 15,
        9 => 300 + rng.random_range(0..700),
        _ => 20 + rng.random_range(0..60),
    };
    let rows = if targets == 1 { rows.max(25) } else { rows };
    let covariance = problem.data.noise.unwrap_or_else(|| Matrix6::identity() * 1e-10);
    let plan = Plan { poses: rows, holdout: 0, seed, noise: 0.0, distance: 1.0 };
    let drawn = simulate(&mechanism, &covariance, &plan).unwrap().samples;
    let length = mechanism.characteristic_length();
    let (mut base, mut tool) = (Se3::identity(), Se3::identity());
    if free {
        base = Se3 { r: so3::exp(&(normal(&mut rng) * 1.5)), p: normal(&mut rng) * 2.0 * length };
        tool = Se3 { r: so3::exp(&(normal(&mut rng) * 1.0)), p: normal(&mut rng) * 0.1 * length };
        for limb in &mut mechanism.limbs {
            let last = limb.links.len() - 1;
            for link in [0, last] {
                limb.links[link].tolerance.angle = Prior::Free;
                limb.links[link].tolerance.length = Prior::Free;
            }
        }
    }
    let sigma = [covariance[(0, 0)].sqrt(), covariance[(3, 3)].sqrt()];
    let corners =
        [Vector3::new(0.15, 0.0, 0.02), Vector3::new(-0.06, 0.12, 0.0), Vector3::new(-0.07, -0.11, 0.03)];
    let written = rng.random::<f64>() < 0.3;
    let mut clean = Vec::new();
    for (k, (variables, pose)) in drawn.iter().enumerate() {
        let joints = actuated(&mechanism);
        let actuators: Vec<f64> = variables.iter().zip(&joints).map(|(q, joint)| q + joint.home).collect();
        let pose = base * *pose * tool;
        let reading = Reading {
            name: format!("sample {}", k + 1),
            actuators,
            position: Vector3::zeros(),
            rotation: None,
            vector: None,
            quaternion: false,
            target: Point::default(),
            noise: Box::new(covariance),
        };
        if targets == 0 {
            let r: Matrix3<f64> = so3::exp(&(normal(&mut rng) * sigma[0])) * pose.r;
            let position = pose.p + normal(&mut rng) * sigma[1];
            let vector = (!written).then(|| so3::log(&r));
            let rotation = Some(r);
            clean.push(Reading { position, rotation, vector, quaternion: written, ..reading.clone() });
        }
        for corner in corners.iter().take(targets) {
            let at = corner * length;
            let position = pose.r * at + pose.p + normal(&mut rng) * sigma[1];
            clean.push(Reading { position, target: Point::known(at), ..reading.clone() });
        }
    }
    let ends = if free { "free" } else { "drawn" };
    let what = format!("{machine} seed {seed}, ends {ends}, {targets} targets, {rows} postures");
    SetUp { what, mechanism, clean, stated: problem.data.has_noise() }
}

/// Plants and searches.
pub fn campaign(planting: &Planting) -> Outcome {
    let mut outcome = Outcome::default();
    for seed in planting.seeds.clone() {
        for (m, machine) in MACHINES.iter().enumerate() {
            let set_up = set_up(machine, 100 * seed + m as u64);
            for mistakes in planting.mistakes.clone() {
                one(&set_up, mistakes, 1000 * seed + 10 * m as u64 + mistakes as u64, &mut outcome);
            }
        }
    }
    outcome
}

fn one(set_up: &SetUp, mistakes: usize, seed: u64, outcome: &mut Outcome) {
    let mechanism = &set_up.mechanism;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let planted = kinds(mechanism, &set_up.clean, mistakes, &mut rng);
    let Some(data) = spoiled(mechanism, &set_up.clean, &planted, &mut rng) else { return };
    let only_positions = data.iter().all(|reading| reading.rotation.is_none());
    let limit = expected(mechanism, Some(&data[0].noise), only_positions).median;
    let start = Instant::now();
    let found = search(mechanism, &data, limit, set_up.stated);
    let took = start.elapsed().as_secs_f64();
    outcome.longest = outcome.longest.max(took);
    let told = format!(
        "{}: planted {planted:?}, told {:?} {:?}, or {:?}, sizes {:?}, {took:.1} s",
        set_up.what,
        found.verdict,
        found.corrections,
        found.alternatives,
        found.fits.map(|fit| fit.map(|fit| (fit.size(), fit.relative, fit.closed)))
    );
    println!("{told}");
    match found.verdict {
        Verdict::Named if right(mechanism, &set_up.clean, &data, &planted, &found) => outcome.named += 1,
        // Two mistakes may come to what one is: of stories that explain as much, the shorter one is told.
        Verdict::Named if found.corrections.len() < planted.len() && explains(&found) => outcome.unseen += 1,
        Verdict::Named => outcome.falsely.push(told),
        Verdict::Explained if mistakes == 0 => outcome.named += 1,
        Verdict::Explained if found.fits[0].is_some_and(|fit| fit.size() < 1.5) => outcome.unseen += 1,
        _ => outcome.unknown.push(told),
    }
}

/// Whether the story leaves no more than noise and tolerances do.
fn explains(found: &Finding) -> bool {
    found.fits[1].is_some_and(|fit| fit.size() < 1.5)
}

/// Whether the story, or one that it names beside it, gives the numbers back that were there before.
fn right(
    mechanism: &Mechanism,
    clean: &[Reading],
    data: &[Reading],
    planted: &[Correction],
    found: &Finding,
) -> bool {
    let ends = |all: &[Correction]| -> Vec<FreeEnds> {
        let of = |c: &Correction| if let Correction::Elsewhere(ends) = c { Some(*ends) } else { None };
        all.iter().filter_map(of).collect()
    };
    let free = FreeEnds::of(mechanism).base;
    let undoes = |story: &[Correction]| {
        ends(story) == ends(planted)
            && applied(mechanism, data, story).is_some_and(|mended| alike(mechanism, clean, &mended, free))
    };
    // What noise, tolerances and free ends explain besides is no part of a story.
    let part =
        |story: &[Correction]| explains(found) && story.iter().all(|correction| planted.contains(correction));
    let told = |story: &[Correction]| undoes(story) || part(story);
    told(&found.corrections) || found.alternatives.iter().any(|story| told(story))
}

/// Equal numbers; readings as far as homes can be found from a machine that deviates.
///
/// Where the base is `free`, positions count up to one motion.
fn alike(mechanism: &Mechanism, clean: &[Reading], mended: &[Reading], free: bool) -> bool {
    let length = mechanism.characteristic_length();
    let joints = actuated(mechanism);
    // Where base or tool stand elsewhere, poses moved: they are compared by how far they are apart.
    let apart = |data: &[Reading]| -> Vec<f64> {
        let from = data[0].position;
        data.iter().map(|r| (r.position - from).norm()).collect()
    };
    let moved = apart(clean).iter().zip(apart(mended)).all(|(a, b)| (a - b).abs() < 0.5 * length);
    let turned = clean.iter().zip(mended).all(|(a, b)| match (a.rotation, b.rotation) {
        (Some(a), Some(b)) => so3::log(&(a.transpose() * b)).norm() < 1e-6,
        _ => true,
    });
    let placed = clean.iter().zip(mended).all(|(a, b)| (a.position - b.position).norm() < 1e-6 * length);
    let read = clean.iter().zip(mended).all(|(a, b)| {
        a.actuators.iter().zip(&b.actuators).zip(&joints).all(|((a, b), joint)| {
            let by = if joint.motion.is_angular() {
                so3::log(&so3::exp(&Vector3::new(0.0, 0.0, a - b))).norm()
            } else {
                (a - b).abs() / length
            };
            by < 0.03
        })
    });
    let elsewhere = || mended_elsewhere(clean, mended) || free && turned_as_one(clean, mended, 1e-6 * length);
    read && moved && (turned && placed || clean.len() == mended.len() && elsewhere())
}

/// Whether positions, measured without rotations, differ by one rotation and one translation.
fn turned_as_one(clean: &[Reading], mended: &[Reading], within: f64) -> bool {
    if clean.iter().any(|reading| reading.rotation.is_some()) {
        return false;
    }
    let mean = |all: &[Reading]| all.iter().map(|r| r.position).sum::<Vector3<f64>>() / all.len() as f64;
    let (from, to) = (mean(clean), mean(mended));
    let pairs = || clean.iter().zip(mended).map(|(a, b)| (a.position - from, b.position - to));
    let sum: Matrix3<f64> = pairs().map(|(a, b)| b * a.transpose()).sum();
    let svd = sum.svd(true, true);
    let turn = svd.u.unwrap() * svd.v_t.unwrap();
    turn.determinant() > 0.0 && pairs().all(|(a, b)| (turn * a - b).norm() < within)
}

/// Whether the poses differ by one motion on the left or on the right.
fn mended_elsewhere(clean: &[Reading], mended: &[Reading]) -> bool {
    let poses = |data: &[Reading]| -> Option<Vec<Se3>> { data.iter().map(Reading::pose).collect() };
    let (Some(a), Some(b)) = (poses(clean), poses(mended)) else { return false };
    let same =
        |x: &Se3, y: &Se3| so3::log(&(x.r.transpose() * y.r)).norm() < 1e-6 && (x.p - y.p).norm() < 1e-6;
    let left = (0..a.len()).all(|k| same(&(b[k] * a[k].inverse()), &(b[0] * a[0].inverse())));
    let right = (0..a.len()).all(|k| same(&(a[k].inverse() * b[k]), &(a[0].inverse() * b[0])));
    left || right
}
