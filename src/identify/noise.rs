//! Noise from the residual, where none is stated.

use super::run::{Identification, IdentifyError};
use super::score::Fit;
use super::tolerances::identify;
use crate::calibration::{Postures, Sample};
use crate::measure::{Evaluation, Weights};
use crate::model::Mechanism;
use crate::solve::{Failure, Identifier, Outcome, Stop};

/// Most rounds of identification and estimate.
const ROUNDS: usize = 20;
/// Relative change of the estimate at which weights and residual agree.
const AGREED: f64 = 0.02;
/// Part of the error before that must go for something to be gained.
const GAINED: f64 = 0.9;
/// Estimated noise, in units of what the tolerances make of the readings, that is beyond belief: where nothing was
/// gained, and where something was.
const BEYOND: (f64, f64) = (3.0, 10.0);
/// Error of postures that took no part, in units of the estimated noise, that is far from those of the training.
const FAR: f64 = 3.0;
/// Noise assumed at first, rad and machine sizes.
const FIRST: f64 = 1e-4;

/// Standard deviations estimated from the residual; `None` for what was not measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseEstimate {
    /// Of each rotation component, rad.
    pub angle: Option<f64>,
    /// Of each length, m.
    pub length: Option<f64>,
}

impl NoiseEstimate {
    /// The samples with this noise in place of their own.
    pub fn weigh(&self, samples: &[Sample]) -> Vec<Sample> {
        let weights =
            Weights::Isotropic { angle: self.angle.unwrap_or(1.0), length: self.length.unwrap_or(1.0) };
        let weighted = |s: &Sample| Sample { measurement: s.measurement.reweighted(weights), ..s.clone() };
        samples.iter().map(weighted).collect()
    }

    /// Largest relative change to another estimate.
    fn change(&self, other: &NoiseEstimate) -> f64 {
        let change = |a: Option<f64>, b: Option<f64>| match (a, b) {
            (Some(a), Some(b)) => (a / b - 1.0).abs(),
            _ => 0.0,
        };
        change(self.angle, other.angle).max(change(self.length, other.length))
    }
}

/// Identifies with weights that come from the residual: assumed, then estimated, until they agree.
pub fn identify_without_noise(
    drawn: &Mechanism,
    samples: &[Sample],
    identifier: &dyn Identifier,
    stop: &Stop,
) -> Result<(Identification, NoiseEstimate), IdentifyError> {
    let mut noise = NoiseEstimate { angle: Some(FIRST), length: Some(FIRST * drawn.characteristic_length()) };
    let mut round = 0;
    loop {
        let found = identify(drawn, &noise.weigh(samples), identifier, stop)?;
        round += 1;
        let Some(next) = estimate(&found, samples) else { return Ok((found, noise)) };
        if round == ROUNDS || next.change(&noise) < AGREED {
            return Ok((believed(found, (None, None)), next));
        }
        noise = next;
    }
}

/// The identification, as one that tells nothing of the machine where the noise that its residual leaves shows that.
/// Noise that is estimated makes any residual seem explained: readings of another actuator become noise of half a metre.
/// `holdout` has the errors of postures that took no part, before and after.
pub fn believed(mut found: Identification, holdout: (Option<Fit>, Option<Fit>)) -> Identification {
    if found.report.outcome.converged()
        && let Some(why) = meaningless(&found, holdout)
    {
        let why = format!(
            "{why}; look for mistakes of units, home, signs and actuator order (gough check), or state the noise"
        );
        found.report.outcome = Outcome::Failed(Failure::Meaningless(why));
    }
    found
}

fn meaningless(found: &Identification, holdout: (Option<Fit>, Option<Fit>)) -> Option<String> {
    let seen = found.visibility.as_ref()?;
    let square: f64 = seen.singular_values.iter().map(|s| s * s).sum();
    // What tolerances make of the readings, in units of the noise.
    let made = (square / found.rows.max(1) as f64).sqrt();
    let gained = |(before, after): (Option<Fit>, Option<Fit>)| match (before, after) {
        (Some(before), Some(after)) => after.weighted_rms < GAINED * before.weighted_rms,
        _ => true,
    };
    if seen.counts.practical == 0 {
        return Some(format!(
            "no direction is known better than its tolerance, because the noise that the residual leaves is {} times \
             what the tolerances make of the readings",
            digits(1.0 / made)
        ));
    }
    let limit = if gained(found.fit) { BEYOND.1 } else { BEYOND.0 };
    if made * limit < 1.0 {
        return Some(format!(
            "the noise that the residual leaves is {} times what the tolerances make of the readings",
            digits(1.0 / made)
        ));
    }
    let off = holdout.1.map_or(0.0, |fit| fit.weighted_rms);
    (off > FAR && !gained(holdout)).then(|| {
        format!(
            "postures that took no part are off by {} times the noise that the residual leaves, no less than by the \
             drawing",
            digits(off)
        )
    })
}

fn digits(value: f64) -> String {
    if value < 1000.0 { format!("{value:.1}") } else { format!("{value:.1e}") }
}

/// Root mean square residual of rotations and of lengths, corrected for the parameters fitted.
fn estimate(found: &Identification, samples: &[Sample]) -> Option<NoiseEstimate> {
    let mut postures = Postures::new(&found.start);
    let mut evaluation = Evaluation::default();
    let (mut angles, mut lengths) = ((0.0, 0.0), (0.0, 0.0));
    for sample in &found.taking_part(samples) {
        if sample.close_all(&found.start, &found.geometry, &mut postures).is_err() {
            continue;
        }
        let unit = sample.measurement.reweighted(Weights::Unit);
        evaluation.clear();
        unit.evaluate(&postures.view(sample, &found.geometry), &mut evaluation);
        let common = sample.measurement.posture_noise().unwrap_or_default().variances();
        for (k, row) in evaluation.rows.iter().enumerate() {
            let sum = if unit.is_angle(k) { &mut angles } else { &mut lengths };
            // What is stated to be common is no noise of the reading.
            let shared: f64 = row.by_tool.iter().zip(common.iter()).map(|(by, v)| by * by * v).sum();
            *sum = (sum.0 + row.r * row.r - shared, sum.1 + 1.0);
        }
    }
    // Where linear theory does not say what was fitted, as with bounds, the practical count stands in.
    let rows = found.rows as f64;
    let fitted = || Some(rows - found.counts()?.practical as f64);
    let freedom = found.chi_square().map(|(_, freedom)| freedom).or_else(fitted)?;
    let correction = (rows / freedom.max(1.0)).sqrt();
    let sigma = |(square, count): (f64, f64), least: f64| {
        let sigma = (square.max(0.0) / f64::max(count, 1.0)).sqrt() * correction;
        (count > 0.0 && sigma.is_finite()).then_some(sigma.max(least))
    };
    // Exact data leave rounding only; weights must stay finite.
    let least = 1e-12;
    Some(NoiseEstimate {
        angle: sigma(angles, least),
        length: sigma(lengths, least * found.start.characteristic_length()),
    })
}
