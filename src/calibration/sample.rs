//! Measured postures, and how the machine is brought into them.

use crate::lie::Se3;
use crate::measure::{Closed, ClosedAt, Measurement, View};
use crate::model::inverse::{NEAR, close_at_pose, close_by_path};
use crate::model::mechanism::pose_difference;
use crate::model::{Geometry, Mechanism, NotClosed, Posture, Prior, Turn};
use std::sync::Arc;

/// Distance of a measured pose (rad and machine sizes) that is no sign of another branch however small the tolerances.
const LEAST: f64 = 1e-4;
/// Distance beyond which a posture has nothing to do with a measured pose, however large the tolerances.
const FARTHEST: f64 = 0.2;

/// One measured posture.
#[derive(Clone, Debug)]
pub struct Sample {
    /// Where it stands in its source, for messages: `sample 12`, `data.csv line 14`.
    pub name: String,
    /// Actuator variables (reading - home) in actuator order, rad or m.
    pub actuators: Vec<f64>,
    /// What was measured.
    pub measurement: Arc<dyn Measurement>,
}

/// A sample that takes no part, because its loops do not close on the branch that was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct SetAside {
    /// Index of the sample.
    pub sample: usize,
    /// Its name.
    pub name: String,
    /// Why.
    pub reason: NotClosed,
}

/// The posture of a sample and, where it compares two, the other one; reused from one sample to the next.
#[derive(Clone, Debug)]
pub struct Postures {
    /// The sample's own.
    pub first: Posture,
    /// The one that it is compared with.
    pub second: Posture,
}

impl Postures {
    /// Home postures, not closed.
    pub fn new(mechanism: &Mechanism) -> Self {
        let home = Posture::new(mechanism);
        Self { first: home.clone(), second: home }
    }

    /// What the instrument of a closed sample sees.
    pub fn view<'a>(&'a self, sample: &Sample, geometry: &'a Geometry) -> View<'a> {
        let tool = self.first.tool();
        let second = if sample.measurement.second().is_some() { self.second.tool() } else { tool };
        View { tool, posture: Some(&self.first), second, instrument: &geometry.instrument }
    }
}

impl Sample {
    /// Closes the posture with the given links and leaves it in `posture`: from where it was closed before; else by
    /// [`close_at`], on the branch that was measured.
    pub fn close(
        &self,
        mechanism: &Mechanism,
        geometry: &Geometry,
        posture: &mut Posture,
    ) -> Result<(), NotClosed> {
        let known = self.measurement.closed_at().map(|at| at.first.as_slice());
        if known.is_some_and(|q| close_near(mechanism, geometry, (q, &self.actuators), posture)) {
            return Ok(());
        }
        close_at(mechanism, geometry, &self.actuators, self.measurement.pose(), posture)
    }

    /// Closes the posture, and the second one where two are compared.
    pub fn close_all(
        &self,
        mechanism: &Mechanism,
        geometry: &Geometry,
        postures: &mut Postures,
    ) -> Result<(), NotClosed> {
        self.close(mechanism, geometry, &mut postures.first)?;
        let Some(actuators) = self.measurement.second() else { return Ok(()) };
        let known = self.measurement.closed_at().map(|at| at.second.as_slice());
        if known.is_some_and(|q| close_near(mechanism, geometry, (q, actuators), &mut postures.second)) {
            return Ok(());
        }
        close_at(mechanism, geometry, actuators, None, &mut postures.second)
    }

    /// The same, to be closed from these joint variables from now on.
    pub fn closed_at(&self, at: ClosedAt) -> Self {
        Self { measurement: Closed::at(&self.measurement, at), ..self.clone() }
    }
}

/// Whether the posture closes at these actuator variables from joint variables `q` (rad, m) near which it then is.
fn close_near(
    mechanism: &Mechanism,
    geometry: &Geometry,
    (q, actuators): (&[f64], &[f64]),
    posture: &mut Posture,
) -> bool {
    if q.len() != posture.q.len() {
        return false;
    }
    posture.q.copy_from_slice(q);
    let passive = posture.passive(mechanism);
    posture.set_joints(mechanism, actuators, &passive);
    posture.close(mechanism, geometry).is_ok() && posture.moved_from(mechanism, q) < NEAR
}

/// The same from those of another closure, whose sines are at hand.
pub(super) fn close_again(
    mechanism: &Mechanism,
    geometry: &Geometry,
    turns: &[Turn],
    posture: &mut Posture,
) -> bool {
    posture.set_turns(turns);
    let q = posture.q.clone();
    posture.close(mechanism, geometry).is_ok() && posture.moved_from(mechanism, &q) < NEAR
}

/// Closes the posture at these actuator variables (rad, m): on home's branch or, where `pose` was measured and lies
/// farther from that than the tolerances explain, on the branch that comes closest to it.
///
/// Home's branch comes first because drawn joints have branches that no pose tells apart: a ball joint turned over, a
/// screw by a whole turn.
pub fn close_at(
    mechanism: &Mechanism,
    geometry: &Geometry,
    actuators: &[f64],
    pose: Option<&Se3>,
    posture: &mut Posture,
) -> Result<(), NotClosed> {
    if mechanism.is_open_chain() {
        posture.set_joints(mechanism, actuators, &[]);
        return posture.close(mechanism, geometry);
    }
    let by_path = close_by_path(mechanism, geometry, actuators, posture);
    let Some(pose) = pose else { return by_path };
    let length = posture.length();
    let away = |posture: &Posture| {
        let (w, v) = pose_difference(pose, &posture.tool());
        w.norm().hypot(v.norm() / length)
    };
    let explained = explained(mechanism);
    let mut least = if by_path.is_ok() { away(posture) } else { f64::INFINITY };
    if least <= explained {
        return Ok(());
    }
    let (mut outcome, mut other_mode) = (by_path, false);
    let mut other = posture.clone();
    let reached = posture.passive(mechanism);
    for passive in [&reached, &vec![0.0; reached.len()]] {
        match close_at_pose(mechanism, geometry, actuators, passive, pose, &mut other) {
            // Twice as close: more than what tolerances make of one branch.
            Ok(()) if away(&other) < 0.5 * least && away(&other) < FARTHEST => {
                least = away(&other);
                posture.clone_from(&other);
                outcome = Ok(());
            }
            Err(NotClosed::OtherMode) => other_mode = true,
            _ => {}
        }
    }
    match outcome {
        // The measured pose lies across a singularity, and no posture there closes.
        Ok(()) if other_mode && least > FARTHEST => Err(NotClosed::OtherMode),
        outcome => outcome,
    }
}

/// Distance (rad and machine sizes) to which links within their tolerances bring a measured pose from the drawn one.
pub fn explained(mechanism: &Mechanism) -> f64 {
    let length = mechanism.characteristic_length();
    let square = |prior: Prior, size: f64| match prior {
        Prior::Sigma(sigma) => 3.0 * (sigma / size).powi(2),
        Prior::Held | Prior::Free => 0.0,
    };
    let links = mechanism.limbs.iter().flat_map(|limb| &limb.links);
    let sum: f64 = links.map(|l| square(l.tolerance.angle, 1.0) + square(l.tolerance.length, length)).sum();
    (3.0 * (sum / mechanism.limbs.len().max(1) as f64).sqrt()).clamp(LEAST, FARTHEST)
}
