//! Noise from the residual, where none is stated.

use super::run::{Identification, IdentifyError, identify};
use crate::calibration::Sample;
use crate::measure::{Row, Weights};
use crate::model::{Mechanism, Posture};
use crate::solve::{Identifier, Stop};

/// Rounds of identification and estimate; the weights hardly change after the second.
const ROUNDS: usize = 3;
/// Noise assumed at first, rad and machine sizes.
const FIRST: f64 = 1e-4;

/// Standard deviations estimated from the residual.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseEstimate {
    /// Of each rotation component, rad.
    pub angle: f64,
    /// Of each length, m.
    pub length: f64,
}

/// Identifies with weights that come from the residual: assumed, then estimated, until they agree.
pub fn identify_without_noise(
    drawn: &Mechanism,
    samples: &[Sample],
    identifier: &dyn Identifier,
    stop: &Stop,
) -> Result<(Identification, NoiseEstimate), IdentifyError> {
    let mut noise = NoiseEstimate { angle: FIRST, length: FIRST * drawn.characteristic_length() };
    let mut round = 0;
    loop {
        let weights = Weights::Isotropic { angle: noise.angle, length: noise.length };
        let weighted: Vec<Sample> = samples
            .iter()
            .map(|s| Sample { measurement: s.measurement.reweighted(weights), ..s.clone() })
            .collect();
        let found = identify(drawn, &weighted, identifier, stop)?;
        round += 1;
        if round == ROUNDS {
            return Ok((found, noise));
        }
        noise = estimate(&found, samples).unwrap_or(noise);
    }
}

/// Root mean square residual of rotations and of lengths, corrected for the parameters fitted.
fn estimate(found: &Identification, samples: &[Sample]) -> Option<NoiseEstimate> {
    let mut posture = Posture::new(&found.start);
    let (mut angles, mut lengths) = ((0.0, 0.0), (0.0, 0.0));
    for sample in samples {
        if sample.close(&found.start, &found.geometry, &mut posture).is_err() {
            continue;
        }
        let unit = sample.measurement.reweighted(Weights::Unit);
        let mut rows = vec![Row::default(); unit.rows()];
        unit.evaluate(&posture.tool(), &mut rows);
        for row in rows {
            let sum = if row.by_tool[..3].iter().any(|v| *v != 0.0) { &mut angles } else { &mut lengths };
            *sum = (sum.0 + row.r * row.r, sum.1 + 1.0);
        }
    }
    let (_, freedom) = found.chi_square()?;
    let correction = (found.rows as f64 / freedom.max(1.0)).sqrt();
    let sigma = |(square, count): (f64, f64), otherwise: f64| {
        let sigma = (square / f64::max(count, 1.0)).sqrt() * correction;
        if sigma > 0.0 && sigma.is_finite() { sigma } else { otherwise }
    };
    // Exact data leave rounding only; weights must stay finite.
    let least = 1e-9;
    Some(NoiseEstimate {
        angle: sigma(angles, least).max(least),
        length: sigma(lengths, least).max(least * found.start.characteristic_length()),
    })
}
