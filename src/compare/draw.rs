//! Truth and data of a run.

use super::line::Source;
use crate::calibration::{ByPosture, Sample};
use crate::files::{BenchmarkDrawing, Blank, DataSet, Kind, ProblemFile};
use crate::identify::run::placed;
use crate::identify::{IdentifyError, NoiseEstimate, identify_without_noise};
use crate::lie::{Se3, so3};
use crate::measure::pose::NotPositive;
use crate::measure::{Measurement, OfPosture, Pose, Weights};
use crate::model::{Geometry, Mechanism};
use crate::simulate::readings::Reading;
use crate::simulate::{
    Plan, SimulateError, Simulated, SimulatedSet, at_each_posture, draw_deviations, simulate_sets_truth,
    simulate_truth,
};
use crate::solve::Stop;
use crate::solve::minimal::Minimal;
use nalgebra::{Matrix6, Vector6};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::sync::Arc;

/// Postures drawn where the problem has no data to say how many.
const POSES: usize = 60;
/// Hold-out poses drawn.
const HOLDOUT: usize = 40;
/// Makes the seed of starts another one than that of truths: the golden ratio, as SplitMix64 has it.
const OF_STARTS: u64 = 0x9e37_79b9_7f4a_7c15;

/// Why a run has no data.
#[derive(Clone, Debug, thiserror::Error)]
pub enum DrawError {
    /// Nothing to simulate with.
    #[error("data.noise is not stated: simulation needs to know it; state it, or give --own-data")]
    NoNoise,
    /// Gross errors of readings that take none.
    #[error(
        "benchmark.outliers: gross errors are drawn for measured poses and positions of the tool only; take them out"
    )]
    Outliers,
    /// Postures do not close.
    #[error(transparent)]
    Simulate(#[from] SimulateError),
    /// The noise cannot be whitened.
    #[error(transparent)]
    Noise(#[from] NotPositive),
    /// The noise cannot be estimated.
    #[error("the noise is not stated and cannot be estimated: {0}")]
    Estimate(IdentifyError),
}

/// What every identifier of a run gets.
#[derive(Clone, Debug)]
pub struct Drawn {
    /// Postures to identify from.
    pub samples: Vec<Sample>,
    /// Poses to predict.
    pub holdout: Vec<Sample>,
    /// Whether the problem states the noise of its data.
    pub noise_stated: bool,
    /// The true links, where they are known.
    pub truth: Option<Geometry>,
    /// Link deviations to start from (rad, m).
    pub from: Vec<f64>,
    /// The drawing with its free ends registered; the drawing itself where the samples do not place them.
    pub start: Mechanism,
}

/// Draws truth, postures, noise and start of the given seed.
pub fn draw(
    problem: &ProblemFile,
    source: Source,
    noise: f64,
    start: f64,
    seed: u64,
) -> Result<Drawn, DrawError> {
    let mechanism = &problem.mechanism;
    let from = draw_deviations(mechanism, seed ^ OF_STARTS, start);
    let (samples, holdout, truth) = match source {
        Source::Own => own(problem)?,
        Source::Simulated => {
            let (samples, holdout, truth) = simulated(problem, noise, seed)?;
            (samples, holdout, Some(truth))
        }
    };
    let start = placed(mechanism, &samples).map_or_else(|| mechanism.clone(), |found| found.machine);
    Ok(Drawn { noise_stated: problem.data.has_noise(), start, samples, holdout, truth, from })
}

type Measured = (Vec<Sample>, Vec<Sample>, Option<Geometry>);

/// The problem's own data, weighed by noise from the residual where none is stated.
fn own(problem: &ProblemFile) -> Result<Measured, DrawError> {
    let truth = problem.truth.as_ref().map(Mechanism::nominal);
    let (samples, holdout) = (problem.data.samples.clone(), problem.holdout.samples.clone());
    if problem.data.has_noise() {
        return Ok((samples, holdout, truth));
    }
    let estimate =
        identify_without_noise(&problem.mechanism, &samples, &Minimal::default(), &Stop::default());
    let (_, noise): (_, NoiseEstimate) = estimate.map_err(DrawError::Estimate)?;
    let holdout = if problem.holdout.has_noise() { holdout } else { noise.weigh(&holdout) };
    Ok((noise.weigh(&samples), holdout, truth))
}

fn simulated(
    problem: &ProblemFile,
    noise: f64,
    seed: u64,
) -> Result<(Vec<Sample>, Vec<Sample>, Geometry), DrawError> {
    check_recipe(problem)?;
    let recipe = problem.drawing.benchmark.clone().unwrap_or_default();
    let counts: Vec<usize> = problem
        .data
        .parts()
        .iter()
        .map(|set| recipe.poses.unwrap_or(if set.is_empty() { POSES } else { postures_of(set) }))
        .collect();
    let poses = counts.iter().sum();
    let distance = recipe.distance.unwrap_or(1.0);
    let plan = Plan { poses, holdout: HOLDOUT, seed, noise: 1.0, distance };
    match problem.measures_tool_alone() {
        true => simulated_poses(problem, &recipe, noise, &plan),
        false => simulated_readings(problem, &recipe, noise, &counts, &plan),
    }
}

fn simulated_poses(
    problem: &ProblemFile,
    recipe: &BenchmarkDrawing,
    noise: f64,
    plan: &Plan,
) -> Result<(Vec<Sample>, Vec<Sample>, Geometry), DrawError> {
    let covariance = problem.data.noise.ok_or(DrawError::NoNoise)? * (noise * noise);
    let common = problem.data.posture_noise.unwrap_or_default().scaled(noise);
    // With one sample a posture what is common to its samples is noise like the other.
    let whole = covariance + Matrix6::from_diagonal(&common.variances());
    let drawn = simulate_by(recipe, &problem.mechanism, &whole, plan)?;
    let rotation = problem.data.kind != Kind::Position;
    let seen = [rotation, rotation, rotation, true, true, true];
    type Make = fn(Se3, [bool; 6], &Matrix6<f64>) -> Result<Pose, NotPositive>;
    let measured = |name: &str, make: Make, poses: Vec<(Vec<f64>, Se3)>| {
        let sample = |(k, (actuators, pose)): (usize, (Vec<f64>, Se3))| {
            let measurement = OfPosture::by(Arc::new(make(pose, seen, &covariance)?), common);
            Ok(Sample { name: format!("{name} {}", k + 1), actuators, measurement })
        };
        poses.into_iter().enumerate().map(sample).collect::<Result<Vec<_>, NotPositive>>()
    };
    let samples = measured("sample", Pose::new, drawn.samples)?;
    // Hold-out poses are the true ones, rotations included whatever the instrument sees: in its noise only what it sees.
    let holdout = measured("hold-out", Pose::known, drawn.holdout)?;
    Ok((samples, holdout, drawn.truth))
}

/// Postures of a set that are to be drawn: where each is measured in several ways there are fewer than samples.
fn postures_of(set: &DataSet) -> usize {
    let blanks: Vec<_> = set.blanks.iter().map(|blank| blank.measurement.clone()).collect();
    match at_each_posture(&blanks) {
        1 => set.samples.len(),
        _ => ByPosture::of(&set.samples).count(),
    }
}

/// Readings of the problem's kinds, set by set; those of the hold-out are true ones.
fn simulated_readings(
    problem: &ProblemFile,
    recipe: &BenchmarkDrawing,
    noise: f64,
    counts: &[usize],
    plan: &Plan,
) -> Result<(Vec<Sample>, Vec<Sample>, Geometry), DrawError> {
    let sets = problem.data.parts();
    if sets.iter().any(|set| set.noise.is_none()) {
        return Err(DrawError::NoNoise);
    }
    let weighted = |blank: &Blank| blank.measurement.reweighted(Weights::Scaled(noise));
    let blanks: Vec<Vec<_>> = sets.iter().map(|set| set.blanks.iter().map(weighted).collect()).collect();
    let (truth, drawn) = simulate_sets_by(recipe, &problem.mechanism, &blanks, counts, plan)?;
    let named = |name: &str, of: fn(&SimulatedSet) -> &Vec<Reading>| -> Vec<Sample> {
        let readings = drawn.iter().flat_map(of).cloned().enumerate();
        readings
            .map(|(k, (actuators, measurement))| Sample {
                name: format!("{name} {}", k + 1),
                actuators,
                measurement,
            })
            .collect()
    };
    Ok((named("sample", |set| &set.samples), named("hold-out", |set| &set.holdout), truth))
}

/// Refuses gross errors of readings that are not poses or positions.
pub fn check_recipe(problem: &ProblemFile) -> Result<(), DrawError> {
    let gross = problem.drawing.benchmark.as_ref().is_some_and(|recipe| recipe.outliers.is_some());
    if gross && !problem.measures_tool_alone() { Err(DrawError::Outliers) } else { Ok(()) }
}

fn true_machine(recipe: &BenchmarkDrawing, mechanism: &Mechanism, plan: &Plan) -> Geometry {
    let mut deviations = draw_deviations(mechanism, plan.seed, plan.distance);
    if let Some(count) = recipe.links_off {
        keep_links(&mut deviations[..mechanism.link_component_count()], count, plan.seed);
    }
    mechanism.deviated(&deviations)
}

/// Simulates poses with the sparse truth and the gross errors that the recipe asks for, and else as the plan says.
pub fn simulate_by(
    recipe: &BenchmarkDrawing,
    mechanism: &Mechanism,
    covariance: &Matrix6<f64>,
    plan: &Plan,
) -> Result<Simulated, SimulateError> {
    let truth = true_machine(recipe, mechanism, plan);
    let mut drawn = simulate_truth(mechanism, truth, covariance, plan)?;
    if let Some(gross) = recipe.outliers {
        spoil(&mut drawn.samples, covariance, gross.share, gross.factor, plan.seed);
    }
    Ok(drawn)
}

/// Simulates readings of any kind with the sparse truth that the recipe asks for, without gross errors, as
/// [`crate::simulate::simulate_sets`] does.
pub fn simulate_sets_by(
    recipe: &BenchmarkDrawing,
    mechanism: &Mechanism,
    blanks: &[Vec<Arc<dyn Measurement>>],
    counts: &[usize],
    plan: &Plan,
) -> Result<(Geometry, Vec<SimulatedSet>), SimulateError> {
    let truth = true_machine(recipe, mechanism, plan);
    let sets = simulate_sets_truth(mechanism, &truth, blanks, counts, plan)?;
    Ok((truth, sets))
}

fn stream(seed: u64, number: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(number);
    rng
}

/// Leaves the deviations of `count` links as they are and sets the others to zero. Links that are held do not count.
fn keep_links(deviations: &mut [f64], count: usize, seed: u64) {
    let links = deviations.chunks_exact_mut(6);
    let mut order: Vec<&mut [f64]> = links.filter(|link| link.iter().any(|v| *v != 0.0)).collect();
    order.shuffle(&mut stream(seed, 3));
    order.into_iter().skip(count).for_each(|link| link.fill(0.0));
}

/// Adds to a share of the poses, one at least, an error of `factor` times the noise.
fn spoil(samples: &mut [(Vec<f64>, Se3)], covariance: &Matrix6<f64>, share: f64, factor: f64, seed: u64) {
    let Some(root) = covariance.cholesky().map(|cholesky| cholesky.l()) else { return };
    let mut rng = stream(seed, 4);
    let count = ((share * samples.len() as f64).round() as usize).max(1);
    let mut order: Vec<usize> = (0..samples.len()).collect();
    order.shuffle(&mut rng);
    for index in order.into_iter().take(count) {
        let normal = Vector6::from_fn(|_, _| StandardNormal.sample(&mut rng));
        let error: Vector6<f64> = root * normal * factor;
        let pose = &mut samples[index].1;
        pose.r = so3::exp(&error.fixed_rows::<3>(0).into_owned()) * pose.r;
        pose.p += error.fixed_rows::<3>(3);
    }
}
