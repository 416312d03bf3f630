//! Seeded synthetic measurements of a machine whose truth is known.

pub mod readings;

pub use readings::{SimulatedSet, at_each_posture, read, simulate_sets, simulate_sets_truth, touch};

use crate::lie::{
    Se3,
    se3::{self, Twist},
    so3,
};
use crate::model::inverse::close_by_path;
use crate::model::mobility::{NearSingularHome, near_singular_home};
use crate::model::{Geometry, Joint, Mechanism, NotClosed, Posture, Prior, Tolerance};
use nalgebra::{Matrix6, Vector6};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Half of the range of an angular joint that states none, rad.
const ANGULAR_RANGE: f64 = 0.5;
/// Half of the range of a prismatic joint that states none, machine sizes.
const LINEAR_RANGE: f64 = 0.1;
/// Postures tried for each one that is wanted.
const TRIES: usize = 200;
/// Postures in advance of which as many are tried: where next to none close, the end is near.
const ADVANCE: usize = 10;
/// Smallest singular value of the wrench matrix, relative to the largest, of a posture that is taken.
const REGULAR: f64 = 1e-3;

/// Why nothing could be simulated.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SimulateError {
    /// Too few random postures close.
    #[error(
        "only {found} of {wanted} postures close within the actuators' ranges; the last that did not: {last}; \
         state narrower \"range\" on the actuated joints"
    )]
    Workspace {
        /// Postures found.
        found: usize,
        /// Postures wanted.
        wanted: usize,
        /// Why the last one failed.
        last: NotClosed,
    },
    /// Too few random postures close, because home is next to a singularity.
    #[error("only {found} of {wanted} postures close within the actuators' ranges: {home}")]
    SingularHome {
        /// Postures found.
        found: usize,
        /// Postures wanted.
        wanted: usize,
        /// What is wrong with home.
        home: NearSingularHome,
    },
    /// Too few postures touch.
    #[error(
        "only {found} of {wanted} postures touch within the actuators' ranges; move the plane, or state wider \"range\" \
         on the actuated joints"
    )]
    Contact {
        /// Postures found.
        found: usize,
        /// Postures wanted.
        wanted: usize,
    },
    /// The covariance has no square root.
    #[error("the noise covariance is not positive definite")]
    Noise,
}

/// What to simulate.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// Measured postures.
    pub poses: usize,
    /// Further postures with their true poses.
    pub holdout: usize,
    /// Of everything random. Truth, postures and noise have streams of their own.
    pub seed: u64,
    /// Factor on the noise.
    pub noise: f64,
    /// Factor on the tolerances from which the truth is drawn.
    pub distance: f64,
}

/// A true machine and what was measured of it.
#[derive(Clone, Debug)]
pub struct Simulated {
    /// The true links.
    pub truth: Geometry,
    /// Actuator variables (rad, m) and measured pose of each posture.
    pub samples: Vec<(Vec<f64>, Se3)>,
    /// Actuator variables and true pose of each hold-out posture.
    pub holdout: Vec<(Vec<f64>, Se3)>,
}

fn stream(seed: u64, number: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(number);
    rng
}

/// Deviations of links (rad, m) and of the instrument's constants drawn from `distance` times the tolerances, those of
/// placement and tool mounting included; what is free or held stays as drawn.
pub fn draw_deviations(mechanism: &Mechanism, seed: u64, distance: f64) -> Vec<f64> {
    let mut rng = stream(seed, 0);
    let mut deviations = Vec::with_capacity(mechanism.component_count());
    for link in mechanism.limbs.iter().flat_map(|limb| &limb.links) {
        deviations.extend_from_slice(twist(link.tolerance, distance, &mut rng).as_slice());
    }
    for constant in &mechanism.instrument {
        deviations.push(drawn(constant.prior, distance, &mut rng));
    }
    // A stream of their own: links are the same with and without.
    let mut rng = stream(seed, 4);
    let mut motion = |stated: Option<Tolerance>| stated.map(|t| se3::exp(&twist(t, distance, &mut rng)));
    let (placement, mounting) = (motion(mechanism.ends.placement), motion(mechanism.ends.tool_mounting));
    let mut first = 0;
    for limb in &mechanism.limbs {
        let last = first + 6 * limb.links.len();
        if let (Some(x), Some(link)) = (placement, limb.links.first()) {
            // X N exp(d) = N exp(d')
            moved(&mut deviations[first..first + 6], |g| link.nominal.inverse() * (x * (link.nominal * g)));
        }
        if let (Some(y), Some(_)) = (mounting, limb.links.last()) {
            moved(&mut deviations[last - 6..last], |g| g * y);
        }
        first = last;
    }
    deviations
}

/// A value drawn from a prior; zero where it is free or held.
fn drawn(prior: Prior, distance: f64, rng: &mut ChaCha8Rng) -> f64 {
    let normal: f64 = StandardNormal.sample(rng);
    match prior {
        Prior::Sigma(sigma) => normal * sigma * distance,
        Prior::Held | Prior::Free => 0.0,
    }
}

/// A twist, rotation first.
fn twist(tolerance: Tolerance, distance: f64, rng: &mut ChaCha8Rng) -> Twist {
    Twist::from_fn(|i, _| drawn(if i < 3 { tolerance.angle } else { tolerance.length }, distance, rng))
}

/// The deviation of a link whose motion behind its nominal is changed.
fn moved(deviation: &mut [f64], by: impl Fn(Se3) -> Se3) {
    let own = se3::exp(&Twist::from_column_slice(deviation));
    deviation.copy_from_slice(se3::log(&by(own)).as_slice());
}

/// Least and greatest variable (reading - home, rad or m) of each actuator: its range as drawn; where none is drawn, half
/// a radian or a tenth of the machine's size to either side of home.
pub fn actuator_ranges(mechanism: &Mechanism) -> Vec<(f64, f64)> {
    let length = mechanism.characteristic_length();
    let joints = mechanism.limbs.iter().flat_map(|limb| &limb.joints).filter(|joint| joint.actuated);
    let range = |joint: &Joint| {
        let half = if joint.motion.is_angular() { ANGULAR_RANGE } else { LINEAR_RANGE * length };
        joint.range.map_or((-half, half), |(low, high)| (low - joint.home, high - joint.home))
    };
    joints.map(range).collect()
}

/// Random postures inside the actuators' ranges that close, on home's branch, with every one of `geometries`.
pub fn draw_postures(
    mechanism: &Mechanism,
    geometries: &[&Geometry],
    count: usize,
    seed: u64,
) -> Result<Vec<Vec<f64>>, SimulateError> {
    let mut rng = stream(seed, 1);
    let ranges = actuator_ranges(mechanism);
    let mut postures = Vec::with_capacity(count);
    let mut last = NotClosed::NotFinite;
    for tried in 0..TRIES * count {
        if postures.len() == count || tried >= TRIES * (postures.len() + ADVANCE) {
            break;
        }
        let actuators: Vec<f64> =
            ranges.iter().map(|(low, high)| low + rng.random::<f64>() * (high - low)).collect();
        let closes = geometries.iter().try_for_each(|geometry| {
            let posture = close(mechanism, geometry, &actuators)?;
            let s = posture.wrench_singular_values();
            if s[5] < REGULAR * s[0] { Err(NotClosed::Singular { smallest: s[5] / s[0] }) } else { Ok(()) }
        });
        match closes {
            Ok(()) => postures.push(actuators),
            Err(why) => last = why,
        }
    }
    if postures.len() < count {
        let (found, wanted) = (postures.len(), count);
        let home = near_singular_home(mechanism, &mechanism.nominal());
        return Err(match home {
            Some(home) => SimulateError::SingularHome { found, wanted, home },
            None => SimulateError::Workspace { found, wanted, last },
        });
    }
    Ok(postures)
}

/// The posture at these actuator variables, on home's branch.
pub fn close(mechanism: &Mechanism, geometry: &Geometry, actuators: &[f64]) -> Result<Posture, NotClosed> {
    let mut posture = Posture::new(mechanism);
    close_by_path(mechanism, geometry, actuators, &mut posture)?;
    Ok(posture)
}

/// Draws a true machine from the tolerances and measures it with noise of the covariance (rotation first, rad
/// and m).
pub fn simulate(
    mechanism: &Mechanism,
    covariance: &Matrix6<f64>,
    plan: &Plan,
) -> Result<Simulated, SimulateError> {
    let truth = mechanism.deviated(&draw_deviations(mechanism, plan.seed, plan.distance));
    simulate_truth(mechanism, truth, covariance, plan)
}

/// Measures a given true machine with noise of the covariance (rotation first, rad and m); `plan.distance` is not
/// looked at.
pub fn simulate_truth(
    mechanism: &Mechanism,
    truth: Geometry,
    covariance: &Matrix6<f64>,
    plan: &Plan,
) -> Result<Simulated, SimulateError> {
    let root = covariance.cholesky().ok_or(SimulateError::Noise)?.l();
    let nominal = mechanism.nominal();
    let postures = draw_postures(mechanism, &[&nominal, &truth], plan.poses + plan.holdout, plan.seed)?;
    let mut rng = stream(plan.seed, 2);
    let (mut samples, mut holdout) = (Vec::new(), Vec::new());
    for (k, actuators) in postures.into_iter().enumerate() {
        let pose = match close(mechanism, &truth, &actuators) {
            Ok(posture) => posture.tool(),
            Err(last) => {
                return Err(SimulateError::Workspace { found: k, wanted: plan.poses + plan.holdout, last });
            }
        };
        if k < plan.poses {
            let normal = Vector6::from_fn(|_, _| StandardNormal.sample(&mut rng));
            let error: Vector6<f64> = root * normal * plan.noise;
            let r = so3::exp(&error.fixed_rows::<3>(0).into_owned()) * pose.r;
            samples.push((actuators, Se3 { r, p: pose.p + error.fixed_rows::<3>(3) }));
        } else {
            holdout.push((actuators, pose));
        }
    }
    Ok(Simulated { truth, samples, holdout })
}
