//! Postures that predictions miss, because the path from home does not lead to them (docs/theory.md section 7).
//!
//! The sign of `det Jr` does not tell: a parallel machine has many assembly modes of either sign, and drawn joints have
//! branches within a mode. What tells is the posture to which the path leads.

use super::run::placed;
use crate::calibration::sample::explained;
use crate::calibration::{Calibration, Postures, Sample, are_apart};
use crate::lie::Se3;
use crate::model::inverse::{close_along, close_by_path};
use crate::model::mechanism::pose_difference;
use crate::model::{Geometry, Mechanism, Posture};
use crate::problem::Form;
use rayon::prelude::*;

/// Distance of two poses (rad and machine sizes) that are one, to what closing the loops leaves. Near singularities it leaves
/// more: what tells postures apart are the joints.
const SAME: f64 = 1e-7;
/// Distance from the measured pose, in what the tolerances explain of an ordinary posture, of one that may be the measured
/// one: those of other modes are often nearer to singularities.
const NEARLY: f64 = 3.0;
/// The same of one that is another than the measured one.
const ANOTHER: f64 = 10.0;

/// A posture, or the one that it is compared with, that was measured elsewhere than the path from home leads.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredElsewhere {
    /// The sample.
    pub name: String,
    /// How far from it the path ends, rad and m; `None` where it ends before the readings are reached.
    pub apart: Option<(f64, f64)>,
}

/// Those of the samples that close, from where they were closed, elsewhere than predictions close them.
pub fn measured_elsewhere(
    mechanism: &Mechanism,
    geometry: &Geometry,
    samples: &[Sample],
) -> Vec<MeasuredElsewhere> {
    if mechanism.is_open_chain() {
        return Vec::new();
    }
    let one = |(here, path): &mut (Postures, Posture), sample: &Sample| {
        sample.close_all(mechanism, geometry, here).ok()?;
        let second = sample.measurement.second().map(|actuators| (&here.second, actuators));
        let mut visited = std::iter::once((&here.first, sample.actuators.as_slice())).chain(second);
        visited.find_map(|(here, actuators)| {
            let reached = close_by_path(mechanism, geometry, actuators, path).is_ok();
            let (w, v) = pose_difference(&here.tool(), &path.tool());
            let apart = reached.then(|| (w.norm(), v.norm()));
            let same = apart.is_some_and(|(w, v)| {
                w.hypot(v / path.length()) <= SAME
                    || !are_apart(mechanism, path.length(), here.turns(), path.turns())
            });
            (!same).then(|| MeasuredElsewhere { name: sample.name.clone(), apart })
        })
    };
    let room = || (Postures::new(mechanism), Posture::new(mechanism));
    samples.par_iter().map_init(room, one).collect::<Vec<_>>().into_iter().flatten().collect()
}

/// The same by the drawing, for whole poses: those that it puts about where they were measured, while the path from home
/// ends far from there.
pub fn drawn_elsewhere(drawn: &Mechanism, samples: &[Sample]) -> Vec<MeasuredElsewhere> {
    let Some(placed) = placed(drawn, samples).filter(|_| !drawn.is_open_chain()) else { return Vec::new() };
    let (mechanism, geometry) = (&placed.machine, placed.machine.nominal());
    let zeros = vec![0.0; mechanism.component_count()];
    let problem = Calibration::new(mechanism, samples, Form::Minimal, &zeros);
    let (limit, length) = (explained(mechanism), mechanism.characteristic_length());
    let mut postures = Postures::new(mechanism);
    let mut within = |sample: &Sample| {
        let Some(pose) = sample.measurement.pose() else { return false };
        let closes = sample.close_all(mechanism, &geometry, &mut postures).is_ok();
        let (w, v) = pose_difference(pose, &postures.first.tool());
        closes && w.norm().hypot(v.norm() / length) <= NEARLY * limit
    };
    let closed: Vec<Sample> = problem.closed(samples).into_iter().filter(|sample| within(sample)).collect();
    let mut elsewhere = measured_elsewhere(mechanism, &geometry, &closed);
    elsewhere.retain(|of| of.apart.is_none_or(|(w, v)| w.hypot(v / length) > ANOTHER * limit));
    elsewhere
}

/// Pose of the tool in {S} at home, in the mode in which the samples were measured; `None` where no path leads there.
pub fn home_as_measured(mechanism: &Mechanism, geometry: &Geometry, samples: &[Sample]) -> Option<Se3> {
    let home = vec![0.0; mechanism.actuator_count()];
    let mut postures = Postures::new(mechanism);
    samples.iter().find_map(|sample| {
        sample.close_all(mechanism, geometry, &mut postures).ok()?;
        close_along(mechanism, geometry, &mut postures.first, &home).ok()?;
        Some(postures.first.tool())
    })
}
