//! Noise of measured poses as files write it.

use super::error::FileError;
use super::fault::Fault;
use super::place::Place;
use super::units::Units;
use crate::measure::PostureNoise;
use crate::measure::pose::Weighting;
use crate::model::Mechanism;
use nalgebra::{Matrix6, Vector6};
use serde::{Deserialize, Serialize};

/// A covariance, rotation first, displacement of the tool point second, in {S} axes and units of the file.
pub type CovarianceDrawing = Box<[[f64; 6]; 6]>;

/// Largest relative difference between entries that symmetry makes equal.
const ASYMMETRY: f64 = 1e-6;
/// Standard deviation of angles that stands in for a noise that is not stated, rad.
const ASSUMED_ANGLE: f64 = 1e-4;

/// Isotropic noise of a measured pose, or its covariance.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoiseDrawing {
    /// Standard deviation of each rotation component, angle of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub angle: Option<f64>,
    /// Standard deviation of each position component, length of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub length: Option<f64>,
    /// Instead of both.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub covariance: Option<CovarianceDrawing>,
}

/// What all samples of one posture have in common: standard deviations of a tool twist at the tool point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PostureNoiseDrawing {
    /// Of each rotation component, angle of the file; none where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub angle: Option<f64>,
    /// Of each displacement, length of the file; none where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub length: Option<f64>,
}

impl PostureNoiseDrawing {
    /// As a file writes it; what is zero is left out.
    pub fn of(noise: PostureNoise, units: Units) -> Self {
        let stated = |v: f64| (v > 0.0).then_some(v);
        Self {
            angle: stated(units.from_radians(noise.angle)),
            length: stated(units.from_metres(noise.length)),
        }
    }

    /// In rad and m.
    pub fn read(&self, units: Units, at: &Place<'_>) -> Result<PostureNoise, FileError> {
        let (angle, length) = (self.angle.unwrap_or(0.0), self.length.unwrap_or(0.0));
        let (angle_at, length_at) = (at.key("angle"), at.key("length"));
        for (value, at) in [(angle, &angle_at), (length, &length_at)] {
            if value.is_nan() || value < 0.0 {
                return Err(at.error(Fault::PostureNoise(value)));
            }
        }
        Ok(PostureNoise { angle: units.angle(angle, &angle_at)?, length: units.length(length, &length_at)? })
    }
}

/// What the samples of a posture have in common, as it was estimated.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PostureNoiseEntry {
    /// Of each rotation component, angle of the file; none where left out, as in `data.posture_noise`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub angle: Option<f64>,
    /// Of each displacement of the tool point, length of the file; none where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub length: Option<f64>,
    /// Probability that samples without anything in common look as if they had it.
    pub probability: f64,
}

/// What must be stated of the noise of a kind of measurement.
#[derive(Clone, Copy, Debug)]
pub(super) struct NoiseNeeds {
    /// Name of the kind.
    pub kind: &'static str,
    pub angle: bool,
    pub length: bool,
    /// Whether every reading is a number by itself.
    pub number: bool,
}

/// The covariance (rad and m) that stands in where no noise is stated: the same relative to the machine's size.
pub fn assumed_noise(mechanism: &Mechanism) -> Matrix6<f64> {
    isotropic(ASSUMED_ANGLE, ASSUMED_ANGLE * mechanism.characteristic_length())
}

fn isotropic(angle: f64, length: f64) -> Matrix6<f64> {
    let (a, l) = (angle * angle, length * length);
    Matrix6::from_diagonal(&Vector6::new(a, a, a, l, l, l))
}

/// The covariance in rad and m that `noise` and `covariance` at one level of a file state, if they do.
pub(super) fn read_noise(
    noise: Option<&NoiseDrawing>,
    covariance: Option<&CovarianceDrawing>,
    needs: NoiseNeeds,
    units: Units,
    at: &Place<'_>,
) -> Result<Option<Matrix6<f64>>, FileError> {
    if needs.number && (covariance.is_some() || noise.is_some_and(|noise| noise.covariance.is_some())) {
        return Err(at.error(Fault::CovarianceOfNumber(needs.kind)));
    }
    let here = at.key("noise");
    match (noise, covariance) {
        (None, None) => Ok(None),
        (Some(_), Some(_)) => Err(at.key("covariance").error(Fault::TwoNoises)),
        (None, Some(covariance)) => read_covariance(covariance, units, &at.key("covariance")).map(Some),
        (Some(NoiseDrawing { angle: None, length: None, covariance: Some(covariance) }), None) => {
            read_covariance(covariance, units, &here.key("covariance")).map(Some)
        }
        (Some(NoiseDrawing { covariance: Some(_), .. }), None) => Err(here.error(Fault::TwoNoises)),
        (Some(NoiseDrawing { angle, length, covariance: None }), None) => {
            let missing = |key| here.error(Fault::NoiseMissing { kind: needs.kind, key });
            // What is not measured has no noise that has a part in anything.
            let length = match length {
                Some(length) => {
                    let at = here.key("length");
                    large_enough(units.length(positive(*length, &at)?, &at)?, "m", &at)?
                }
                None if needs.length => return Err(missing("length")),
                None => 1.0,
            };
            let angle = match angle {
                Some(angle) => {
                    let at = here.key("angle");
                    large_enough(units.angle(positive(*angle, &at)?, &at)?, "rad", &at)?
                }
                None if needs.angle => return Err(missing("angle")),
                None => 1.0,
            };
            Ok(Some(isotropic(angle, length)))
        }
    }
}

/// Smallest standard deviation, rad or m: below the rounding of a pose of 1 m.
const LEAST: f64 = 1e-18;

fn large_enough(value: f64, unit: &'static str, at: &Place<'_>) -> Result<f64, FileError> {
    if value >= LEAST { Ok(value) } else { Err(at.error(Fault::SmallNoise { value, least: LEAST, unit })) }
}

fn positive(sigma: f64, at: &Place<'_>) -> Result<f64, FileError> {
    if sigma > 0.0 { Ok(sigma) } else { Err(at.error(Fault::Noise(sigma))) }
}

fn read_covariance(
    stated: &CovarianceDrawing,
    units: Units,
    at: &Place<'_>,
) -> Result<Matrix6<f64>, FileError> {
    let mut covariance = Matrix6::zeros();
    let angle = |v, at: &Place<'_>| units.angle(v, at);
    let length = |v, at: &Place<'_>| units.length(v, at);
    for (i, row) in stated.iter().enumerate() {
        let row_at = at.index(i);
        for (j, value) in row.iter().enumerate() {
            let here = row_at.index(j);
            let half = if i < 3 { angle(*value, &here)? } else { length(*value, &here)? };
            covariance[(i, j)] = if j < 3 { angle(half, &here)? } else { length(half, &here)? };
        }
    }
    let c = covariance;
    for i in 0..6 {
        for j in 0..i {
            let size = (c[(i, i)] * c[(j, j)]).abs().sqrt();
            if (c[(i, j)] - c[(j, i)]).abs() > ASYMMETRY * size {
                return Err(at.error(Fault::Asymmetric(i, j)));
            }
        }
    }
    let symmetric = (c + c.transpose()) * 0.5;
    match Weighting::whitening(&symmetric, [true; 6]) {
        Ok(_) => Ok(symmetric),
        Err(_) => Err(at.error(Fault::NotPositive)),
    }
}
