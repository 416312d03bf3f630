//! Actuators that bring the machine to a wanted pose: Newton's method on active and passive joints together, then along
//! the self-motion into the drawn ranges (docs/theory.md section 12).

mod limbs;
mod range;
mod self_motion;
mod velocity;
mod way;

pub use range::{beyond_range, outside_range};

use super::closure::NotClosed;
use super::inverse::close_from_home;
use super::mechanism::{Geometry, Mechanism, pose_difference};
use super::posture::Posture;
use crate::lie::Se3;
use limbs::readings_by_limb;
use nalgebra::{DVector, Vector3, Vector6};
use range::Ranges;
use self_motion::into_ranges;
use way::along;

/// Largest remaining error of the components that are followed, rad and machine sizes.
const REACHED: f64 = 1e-10;
/// Singular values below this part of the largest belong to motions that the tool does not follow.
const NO_MOTION: f64 = 1e-9;
/// Readings that limbs find for themselves, of which predictions are tried before other starts are; the others after.
const FIRST_BY_LIMBS: usize = 192;
/// Further starts, postures with actuators spread over their ranges.
const FURTHER_STARTS: usize = 24;
/// The same for arms and for machines with more drives than components to follow, as long as the pose is reached but not
/// within the ranges: every start leads to another place of the self-motion.
const STARTS_OF_REDUNDANT: usize = 200;

/// Why a pose cannot be commanded.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NotReached {
    /// The machine does not close where the search begins.
    #[error("the posture from which the pose is sought does not close: {0}")]
    Start(NotClosed),
    /// The components to follow cannot be had.
    #[error("out of reach: the closest posture is {rotation:.3e} rad and {translation:.3e} m away")]
    Away {
        /// Rotation that remains, components to follow only, rad.
        rotation: f64,
        /// Distance that remains, components to follow only, m.
        translation: f64,
    },
    /// Reached by a way that predictions do not take.
    #[error("reached only in another assembly mode than that of home")]
    OtherMode,
}

/// Actuators for a wanted pose.
#[derive(Clone, Debug, PartialEq)]
pub struct Commanded {
    /// Actuator variables (reading - home), rad or m.
    pub actuators: Vec<f64>,
    /// The pose that they lead to.
    pub pose: Se3,
    /// From it to the wanted pose, `[w; dp]` in {S} axes, rad and m: what is not followed.
    pub residual: Vector6<f64>,
}

/// Where a search ended: the posture, and the error of the components to follow.
type Found = (Posture, f64);

/// What is sought.
struct Search<'a> {
    mechanism: &'a Mechanism,
    geometry: &'a Geometry,
    start: &'a [f64],
    pose: &'a Se3,
    followed: [bool; 6],
    ranges: Ranges,
}

/// The actuators that bring the tool to `pose` in the components `followed` (rotations first, {S} axes), by the way from
/// `start` (actuator variables, rad or m) or, where that fails, limb by limb and from other postures within the ranges.
///
/// Where more actuators than components are there, every step is the smallest one, and what ends outside the ranges is
/// led into them along the self-motion; where there are fewer, the pose has to be one that the machine can take. Readings
/// outside their ranges ([`beyond_range`]) are the nearest that were found.
pub fn command(
    mechanism: &Mechanism,
    geometry: &Geometry,
    start: &[f64],
    pose: &Se3,
    followed: [bool; 6],
) -> Result<Commanded, NotReached> {
    let search = Search { mechanism, geometry, start, pose, followed, ranges: Ranges::of(mechanism) };
    search.run()
}

impl Search<'_> {
    fn run(&self) -> Result<Commanded, NotReached> {
        let mut closest: Option<Found> = None;
        let mut outside: Option<Commanded> = None;
        let mut failure = None;
        let mut reached = false;
        let mut by_limbs = Vec::new();
        let components = self.followed.iter().filter(|f| **f).count();
        let redundant = self.ranges.open || self.mechanism.actuator_count() > components;
        let most = if redundant { STARTS_OF_REDUNDANT } else { FURTHER_STARTS };
        for attempt in 0..=most {
            if attempt > FURTHER_STARTS && !reached {
                break;
            }
            if attempt == 1 {
                by_limbs = self.by_limbs();
                let later = by_limbs.split_off(by_limbs.len().min(FIRST_BY_LIMBS));
                if let Some(commanded) = self.first_predicted(by_limbs) {
                    return Ok(commanded);
                }
                by_limbs = later;
            }
            let from = if attempt == 0 { self.start.to_vec() } else { self.ranges.start(attempt) };
            let (found, left) = match at(self.mechanism, self.geometry, &from) {
                Ok(posture) => along(self.mechanism, self.geometry, posture, self.pose, self.followed),
                Err(why) => {
                    failure.get_or_insert(NotReached::Start(why));
                    continue;
                }
            };
            if left > REACHED {
                if closest.as_ref().is_none_or(|best| left < best.1) {
                    closest = Some((found, left));
                }
                continue;
            }
            reached = true;
            let first = self.confirmed(&found);
            if let Some(commanded) = first.as_ref().filter(|c| self.ranges.hold(&c.actuators)) {
                return Ok(commanded.clone());
            }
            let (mechanism, geometry) = (self.mechanism, self.geometry);
            let moved = into_ranges(mechanism, geometry, &self.ranges, found, self.pose, self.followed);
            let moved = self.confirmed(&moved);
            if first.is_none() && moved.is_none() {
                failure = Some(NotReached::OtherMode);
            }
            for commanded in [moved, first].into_iter().flatten() {
                if self.ranges.hold(&commanded.actuators) {
                    return Ok(commanded);
                }
                let excess = self.ranges.excess(&commanded.actuators);
                if outside.as_ref().is_none_or(|best| excess < self.ranges.excess(&best.actuators)) {
                    outside = Some(commanded);
                }
            }
        }
        if let Some(commanded) = self.first_predicted(by_limbs).or(outside) {
            return Ok(commanded);
        }
        if let (Some((posture, _)), false) = (closest, matches!(failure, Some(NotReached::OtherMode))) {
            let (w, dp) = pose_difference(self.pose, &posture.tool());
            let part = |v: &Vector3<f64>, first: usize| {
                (0..3).filter(|i| self.followed[first + i]).map(|i| v[i] * v[i]).sum::<f64>().sqrt()
            };
            return Err(NotReached::Away { rotation: part(&w, 0), translation: part(&dp, 3) });
        }
        Err(failure.unwrap_or(NotReached::OtherMode))
    }

    /// Readings within the ranges from what each limb finds for itself; for whole poses of machines with loops.
    fn by_limbs(&self) -> Vec<Vec<f64>> {
        if self.ranges.open || self.followed != [true; 6] {
            return Vec::new();
        }
        let home = vec![0.0; self.start.len()];
        let near = at(self.mechanism, self.geometry, self.start);
        match near.or_else(|_| at(self.mechanism, self.geometry, &home)) {
            Ok(near) => readings_by_limb(self.mechanism, self.geometry, &near, self.pose),
            Err(_) => Vec::new(),
        }
    }

    /// The first of the readings from which predictions lead to the pose.
    fn first_predicted(&self, all: Vec<Vec<f64>>) -> Option<Commanded> {
        all.into_iter().find_map(|readings| self.predicted(readings))
    }

    /// The readings of a posture at the pose, if predictions from them lead there: by whole turns within the ranges.
    fn confirmed(&self, posture: &Posture) -> Option<Commanded> {
        let found = active(self.mechanism, posture);
        let turned = self.ranges.turned(&found, self.start);
        // Where loops close, whole turns of a drive may lead elsewhere.
        let either = if self.ranges.open || turned == found { vec![turned] } else { vec![turned, found] };
        let there: Vec<Commanded> = either.into_iter().filter_map(|a| self.predicted(a)).collect();
        let excess = |c: &Commanded| self.ranges.excess(&c.actuators);
        there.into_iter().min_by(|a, b| excess(a).total_cmp(&excess(b)))
    }

    /// The readings with the pose that they lead to, if it is the one wanted.
    fn predicted(&self, actuators: Vec<f64>) -> Option<Commanded> {
        let there = at(self.mechanism, self.geometry, &actuators).ok()?;
        if error_to(self.pose, &there, self.followed).norm() > REACHED {
            return None;
        }
        let reached = there.tool();
        let (w, dp) = pose_difference(self.pose, &reached);
        let residual = Vector6::new(w.x, w.y, w.z, dp.x, dp.y, dp.z);
        Some(Commanded { actuators, pose: reached, residual })
    }
}

/// The posture at these actuators, on home's branch.
fn at(mechanism: &Mechanism, geometry: &Geometry, actuators: &[f64]) -> Result<Posture, NotClosed> {
    let mut posture = Posture::new(mechanism);
    posture.close(mechanism, geometry)?;
    close_from_home(mechanism, geometry, &mut posture, actuators)?;
    Ok(posture)
}

/// Variables of the actuators, rad or m.
fn active(mechanism: &Mechanism, posture: &Posture) -> Vec<f64> {
    let joints = mechanism.limbs.iter().flat_map(|limb| &limb.joints);
    posture.q.iter().zip(joints).filter(|(_, joint)| joint.actuated).map(|(q, _)| *q).collect()
}

/// From the posture to the target, components to follow only: rad and machine sizes.
fn error_to(target: &Se3, posture: &Posture, followed: [bool; 6]) -> DVector<f64> {
    let (w, dp) = pose_difference(target, &posture.tool());
    let dp = dp / posture.length();
    let all = [w.x, w.y, w.z, dp.x, dp.y, dp.z];
    DVector::from_iterator(
        followed.iter().filter(|f| **f).count(),
        (0..6).filter(|&i| followed[i]).map(|i| all[i]),
    )
}
