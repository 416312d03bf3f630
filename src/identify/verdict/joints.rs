//! Errors that follow the reading of a joint: the columns that they have in the readings (docs/theory.md (10.13)).

use super::linear::Linear;
use super::pattern::Pattern;
use crate::calibration::postures::telling;
use crate::calibration::{Calibration, PostureRows, Postures, Sample};
use crate::identify::run::Identification;
use crate::model::{Mechanism, Motion, Prior, Tolerance};
use crate::problem::{Form, Problem};
use faer::Mat;
use std::f64::consts::PI;

/// Step of difference quotients, rad or machine sizes.
const DIFFERENCE: f64 = 1e-6;

/// Errors of the link before an actuated joint that vary with the joint's reading.
pub(super) struct JointPattern {
    /// `limb.joint`.
    pub name: String,
    /// All components of the link, where one posture was read: they vary with the reading three ways.
    pub whole: Pattern,
    /// Along the joint's own motion. The first column is that of a scale of its reading.
    pub own: Pattern,
    /// How much scale one unit of that column is.
    pub unit: f64,
}

impl JointPattern {
    /// A scale of the reading alone.
    pub fn scale(&self) -> Pattern {
        let own = &self.own.columns;
        Pattern { columns: Mat::from_fn(own.nrows(), 1, |i, _| own[(i, 0)]) }
    }

    /// All columns, to be changed as the rows are.
    pub fn columns(&mut self) -> [&mut Mat<f64>; 2] {
        [&mut self.whole.columns, &mut self.own.columns]
    }
}

/// How errors vary with a reading.
struct Shapes {
    middle: f64,
    half: f64,
    /// Whether the joint turns so far that sine and cosine are told from powers.
    wide: bool,
}

impl Shapes {
    fn part(&self, q: f64) -> f64 {
        (q - self.middle) / self.half
    }

    /// Of a link's components.
    fn link(&self, q: f64) -> [f64; 3] {
        let part = self.part(q);
        if self.wide { [part, q.cos(), q.sin()] } else { [part, part * part, part.powi(3)] }
    }

    /// Along the joint's motion: scale, bend, then two more.
    fn own(&self, q: f64) -> [f64; 4] {
        let part = self.part(q);
        let rest = if self.wide { [q.cos(), q.sin()] } else { [part.powi(3), 0.0] };
        [part, part * part, rest[0], rest[1]]
    }
}

/// The patterns of all actuated joints, in rows turned as those of the model.
pub(super) fn joint_patterns(
    found: &Identification,
    linear: &Linear,
    samples: &[Sample],
) -> Option<Vec<JointPattern>> {
    // Every component of every link, those held included.
    let one = Tolerance { angle: Prior::Sigma(1.0), length: Prior::Sigma(1.0) };
    let mut open: Mechanism = found.supported.clone();
    open.limbs.iter_mut().flat_map(|limb| &mut limb.links).for_each(|link| link.tolerance = one);
    let at = found.geometry.deviations_from(&found.supported.nominal());
    let closing: Vec<Sample> = linear.closing.iter().map(|&k| samples[k].clone()).collect();
    let first = |k: usize| &samples[linear.members[k][0]];
    let problem = Calibration::new(&open, &closing, Form::Complete, &at);
    let mut jac = problem.linearize(&problem.coordinates().nearest(&at)).ok()?.jac;
    (jac.nrows() == linear.r.len()).then_some(())?;
    linear.turn(&mut jac);
    let mut out = Vec::new();
    let mut actuator = 0;
    for (limb, coordinates) in open.limbs.iter().zip(&problem.coordinates().limbs) {
        for (j, joint) in limb.joints.iter().enumerate().filter(|(_, joint)| joint.actuated) {
            let own = actuator;
            actuator += 1;
            let reading = |k: usize| first(k).actuators.get(own).copied().unwrap_or(0.0);
            let other = |k: usize| first(k).measurement.second().and_then(|second| second.get(own)).copied();
            let all = (0..linear.spans.len()).filter(|&k| linear.active[k]);
            let all = all.flat_map(|k| std::iter::once(reading(k)).chain(other(k)));
            let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
            let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
            if half <= 0.0 || !half.is_finite() {
                continue;
            }
            let angular = joint.motion.is_angular();
            let shapes = Shapes { middle, half, wide: angular && half > 0.5 * PI };
            let column = coordinates.offset + 6 * j;
            let mut whole = Mat::zeros(linear.r.len(), 18);
            let mut by_motion = Mat::zeros(linear.r.len(), 4);
            let step = DIFFERENCE * if angular { 1.0 } else { open.characteristic_length() };
            for (k, span) in linear.spans.iter().enumerate() {
                let both = |i: usize| match joint.motion {
                    Motion::Prismatic => jac[(i, column + 5)],
                    Motion::Revolute => jac[(i, column + 2)],
                    Motion::Helical { advance } => jac[(i, column + 2)] + advance * jac[(i, column + 5)],
                };
                let here = shapes.own(reading(k));
                if let Some(other) = other(k) {
                    // The machine errs in either posture by what that posture's reading makes it.
                    let there = shapes.own(other);
                    let first_alone = by_first(found, samples, &linear.members[k], (own, step));
                    let Some(by_first) = first_alone else { continue };
                    for (i, by_first) in span.clone().zip(by_first) {
                        for c in 0..4 {
                            by_motion[(i, c)] = by_first * here[c] + (both(i) - by_first) * there[c];
                        }
                    }
                    continue;
                }
                let link = shapes.link(reading(k));
                for i in span.clone() {
                    (0..4).for_each(|c| by_motion[(i, c)] = both(i) * here[c]);
                    (0..18).for_each(|c| whole[(i, c)] = jac[(i, column + c % 6)] * link[c / 6]);
                }
            }
            out.push(JointPattern {
                name: format!("{}.{}", limb.name, joint.name),
                whole: Pattern { columns: whole },
                own: Pattern { columns: by_motion },
                unit: 1.0 / half,
            });
        }
    }
    Some(out)
}

/// Derivatives of the rows of samples that compare two postures by the reading `actuator` of the first one alone.
fn by_first(
    found: &Identification,
    samples: &[Sample],
    members: &[usize],
    (actuator, step): (usize, f64),
) -> Option<Vec<f64>> {
    let mut postures = Postures::new(&found.supported);
    let mut rows = PostureRows::default();
    let mut at = |by: f64| -> Option<Vec<f64>> {
        let moved: Vec<Sample> = members.iter().map(|&i| samples[i].clone()).collect();
        let moved: Vec<Sample> = (moved.into_iter())
            .map(|mut sample| {
                sample.actuators.get_mut(actuator).into_iter().for_each(|q| *q += by);
                sample
            })
            .collect();
        telling(moved.iter())?.close_all(&found.supported, &found.geometry, &mut postures).ok()?;
        let all = rows.evaluate(moved.iter(), &postures, &found.geometry).ok()?;
        Some(all.rows.iter().map(|row| row.r).collect())
    };
    let (ahead, behind) = (at(step)?, at(-step)?);
    Some(ahead.iter().zip(&behind).map(|(a, b)| (a - b) / (2.0 * step)).collect())
}
