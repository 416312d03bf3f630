//! Errors that the model does not have: such as follow a joint's reading, and such as neighbouring postures share
//! (docs/theory.md (10.13)).

use super::joints::JointPattern;
use super::linear::{Linear, Residual};
use super::order::resemblance;
use super::pattern::Fit;
use crate::calibration::Sample;
use crate::model::Mechanism;

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
/// Log likelihood by which one joint must be likelier than another to be told from it: 20 to 1.
const EQUAL: f64 = 3.0;

/// The machine does what the model does not.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelFinding {
    /// The actuated joint whose reading the errors follow, where there is one.
    pub joint: Option<String>,
    /// Others that the data do not tell from it.
    pub or: Vec<String>,
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
        let joint = self.joint.as_ref().map(|joint| match self.or.is_empty() {
            true => joint.clone(),
            false => format!(
                "one of these joints, which the data do not tell apart: {joint}, {}",
                self.or.join(", ")
            ),
        });
        match (joint, self.scale, self.correlation) {
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

/// Joints whose reading the errors follow beyond chance, the likeliest said, and how it fits. Of each joint three patterns
/// are tried: that its reading is badly scaled, that it moves otherwise than it reads, and that all of the link before it
/// varies with its reading. Few columns find small errors, many find errors across the joint.
pub(super) fn joint(
    linear: &Linear,
    residual: &Residual,
    patterns: &[JointPattern],
) -> Option<(ModelFinding, usize, Fit)> {
    let tried = (3 * patterns.len().max(1)) as f64;
    let level = FALSE_ALARM / tried;
    let likeliest = |pattern: &JointPattern| {
        let alone = pattern.scale().fit(linear, residual);
        let scaled = alone.as_ref().map(|alone| (alone.gain, 1.0 - alone.amounts[0] * pattern.unit));
        let fits = [alone, pattern.own.fit(linear, residual), pattern.whole.fit(linear, residual)];
        let beyond_chance = fits.into_iter().flatten().filter(|fit| fit.probability < level);
        let fit = beyond_chance.max_by(|a, b| a.gain.total_cmp(&b.gain))?;
        let scale = scaled.filter(|(gain, _)| *gain > SCALE * fit.gain).map(|(_, scale)| scale);
        Some((fit, scale))
    };
    let mut found: Vec<_> = patterns
        .iter()
        .enumerate()
        .filter_map(|(k, p)| likeliest(p).map(|(fit, scale)| (k, fit, scale)))
        .collect();
    found.sort_by(|a, b| b.1.gain.total_cmp(&a.1.gain));
    let most = found.first()?.1.gain;
    let equal: Vec<String> = (found.iter().skip(1))
        .filter(|(_, fit, _)| fit.gain > most - EQUAL)
        .map(|(k, ..)| patterns[*k].name.clone())
        .collect();
    let (k, fit, scale) = found.swap_remove(0);
    let scale = scale.filter(|_| equal.is_empty());
    let gain = fit.gain - tried.ln();
    let joint = Some(patterns[k].name.clone());
    Some((ModelFinding { joint, or: equal, scale, correlation: None, gain }, k, fit))
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
        or: Vec::new(),
        scale: None,
        correlation: Some(correlation),
        gain: 0.5 * z * z,
    })
}
