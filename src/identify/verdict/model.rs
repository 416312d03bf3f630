//! Errors that the model does not have: such as follow a joint's reading, and such as neighbouring postures share
//! (docs/theory.md (10.13)).

use super::linear::{Linear, Residual};
use super::order::resemblance;
use super::pattern::{Fit, Pattern};
use crate::calibration::{Calibration, Sample};
use crate::identify::run::Identification;
use crate::model::{Mechanism, Prior, Tolerance};
use crate::problem::{Form, Problem};
use faer::Mat;
use std::f64::consts::PI;

/// Probability with which any joint is blamed where none is to blame.
const FALSE_ALARM: f64 = 1e-3;
/// Correlation of neighbouring postures, in its standard deviations, that noise does not have.
const RESEMBLING: f64 = 4.0;
/// The same, as a number: below it nothing is said however many postures there are.
const FAINT: f64 = 0.05;
/// Postures below which, and from which, neighbours are not sought.
const FEW: usize = 12;
const MANY: usize = 2000;
/// Part of what a joint's errors explain that a scale must explain to be said.
const SCALE: f64 = 0.8;

/// The machine does what the model does not.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelFinding {
    /// The actuated joint whose reading the errors follow, where there is one.
    pub joint: Option<String>,
    /// Scale of its reading that explains them, where one does.
    pub scale: Option<f64>,
    /// Correlation of neighbouring postures, where it was that what told.
    pub correlation: Option<f64>,
    /// Log likelihood that it gains.
    pub gain: f64,
}

impl ModelFinding {
    /// What was found, without a full stop.
    pub fn sentence(&self) -> String {
        let missing = "the machine has errors that the model does not have";
        match (&self.joint, self.scale, self.correlation) {
            (Some(joint), Some(scale), _) => {
                format!(
                    "errors follow the reading of {joint} as if it moved {scale:.6} times as far as it reads: {missing}"
                )
            }
            (Some(joint), None, _) => format!(
                "errors follow the reading of {joint}, as of a bent, eccentric or badly scaled joint: {missing}"
            ),
            (None, _, correlation) => format!(
                "neighbouring postures err alike: {missing} (correlation {:.2})",
                correlation.unwrap_or(0.0)
            ),
        }
    }
}

/// Errors of the link before an actuated joint that vary with the joint's reading.
pub(super) struct JointPattern {
    /// `limb.joint`.
    pub name: String,
    /// All of them.
    pub pattern: Pattern,
    /// The column that a scale of the reading has, and how much scale one unit of it is.
    pub scale: (usize, f64),
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
            let reading = |k: usize| first(k).actuators.get(own).copied().unwrap_or(0.0);
            let all = (0..linear.spans.len()).filter(|&k| linear.active[k]).map(reading);
            let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
            let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
            actuator += 1;
            if half <= 0.0 || !half.is_finite() {
                continue;
            }
            let wide = joint.motion.is_angular() && half > 0.5 * PI;
            let shape = |q: f64, which: usize| {
                let part = (q - middle) / half;
                match (which, wide) {
                    (0, _) => part,
                    (1, true) => q.cos(),
                    (2, true) => q.sin(),
                    (1, false) => part * part,
                    _ => part * part * part,
                }
            };
            let column = coordinates.offset + 6 * j;
            let mut columns = Mat::zeros(linear.r.len(), 18);
            for (k, span) in linear.spans.iter().enumerate() {
                if first(k).measurement.second().is_some() {
                    continue;
                }
                let shapes = [0, 1, 2].map(|which| shape(reading(k), which));
                for i in span.clone() {
                    for c in 0..18 {
                        columns[(i, c)] = jac[(i, column + c % 6)] * shapes[c / 6];
                    }
                }
            }
            let along = if joint.motion.is_angular() { 2 } else { 5 };
            out.push(JointPattern {
                name: format!("{}.{}", limb.name, joint.name),
                pattern: Pattern { columns },
                scale: (along, 1.0 / half),
            });
        }
    }
    Some(out)
}

/// The joint whose reading errors follow beyond chance, which of the patterns it is, and how they fit.
pub(super) fn joint(
    linear: &Linear,
    residual: &Residual,
    patterns: &[JointPattern],
) -> Option<(ModelFinding, usize, Fit)> {
    let fits = patterns.iter().enumerate().filter_map(|(k, p)| Some((k, p.pattern.fit(linear, residual)?)));
    let level = FALSE_ALARM / patterns.len().max(1) as f64;
    let (k, fit) =
        fits.filter(|(_, fit)| fit.probability < level).max_by(|a, b| a.1.gain.total_cmp(&b.1.gain))?;
    let (column, unit) = patterns[k].scale;
    let own = patterns[k].pattern.columns.col(column);
    let alone = Pattern { columns: Mat::from_fn(own.nrows(), 1, |i, _| own[i]) }.fit(linear, residual);
    let scale =
        alone.filter(|alone| alone.gain > SCALE * fit.gain).map(|alone| 1.0 - alone.amounts[0] * unit);
    let gain = fit.gain - (patterns.len() as f64).ln();
    let finding = ModelFinding { joint: Some(patterns[k].name.clone()), scale, correlation: None, gain };
    Some((finding, k, fit))
}

/// Whether residuals of postures that are neighbours resemble each other, such as follow each other in the file left out.
pub(super) fn neighbours(
    mechanism: &Mechanism,
    linear: &Linear,
    residual: &Residual,
    samples: &[Sample],
    before: &[Option<usize>],
) -> Option<ModelFinding> {
    let some: Vec<usize> = (0..linear.spans.len()).filter(|&k| linear.active[k]).take(MANY).collect();
    if some.len() < FEW {
        return None;
    }
    let length = mechanism.characteristic_length();
    let joints = mechanism.limbs.iter().flat_map(|limb| &limb.joints).filter(|joint| joint.actuated);
    let unit: Vec<f64> = joints.map(|joint| if joint.motion.is_angular() { 1.0 } else { length }).collect();
    let apart = |a: usize, b: usize| -> f64 {
        let (a, b) = (&samples[linear.members[a][0]].actuators, &samples[linear.members[b][0]].actuators);
        a.iter().zip(b).zip(&unit).map(|((a, b), unit)| ((a - b) / unit).powi(2)).sum()
    };
    let cells = |k: usize| &linear.cell[linear.spans[k].clone()];
    let mut pairs = Vec::with_capacity(some.len());
    for &k in &some {
        let follows = |a: usize, b: usize| before[a] == Some(b) || before[b] == Some(a);
        let others = some.iter().copied().filter(|&o| o != k && !follows(o, k) && cells(o) == cells(k));
        let distances = others.map(|o| (o, apart(k, o))).filter(|(_, d)| *d > 0.0);
        let Some((nearest, _)) = distances.min_by(|a, b| a.1.total_cmp(&b.1)) else { continue };
        pairs.push((k.min(nearest), k.max(nearest)));
    }
    // Neighbours are often mutual, which would count a pair twice.
    pairs.sort_unstable();
    pairs.dedup();
    let (correlation, z) = resemblance(linear, residual, &pairs)?;
    (z > RESEMBLING && correlation > FAINT).then_some(ModelFinding {
        joint: None,
        scale: None,
        correlation: Some(correlation),
        gain: 0.5 * z * z,
    })
}
