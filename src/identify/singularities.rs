//! Postures near singularities.

use crate::calibration::{Postures, Sample};
use crate::model::{Geometry, Mechanism, Posture};

/// Ratio of the extreme singular values of the wrench matrix below which a posture is reported.
pub const NEAR_SINGULAR: f64 = 1e-2;

/// A posture near a singularity.
#[derive(Clone, Debug, PartialEq)]
pub struct NearSingular {
    /// The sample.
    pub name: String,
    /// Singular values of its wrench matrix, descending (lengths in machine sizes).
    pub singular_values: [f64; 6],
}

/// Postures whose wrench matrix is close to losing rank.
pub(super) fn singularities(
    mechanism: &Mechanism,
    geometry: &Geometry,
    samples: &[Sample],
) -> Vec<NearSingular> {
    let mut postures = Postures::new(mechanism);
    if mechanism.is_open_chain() {
        return Vec::new();
    }
    let mut near = Vec::new();
    for sample in samples {
        if sample.close_all(mechanism, geometry, &mut postures).is_err() {
            continue;
        }
        let second = sample.measurement.second().map(|_| &postures.second);
        let both = [Some(&postures.first), second].into_iter().flatten();
        let values = both.map(Posture::wrench_singular_values);
        let worst = values.min_by(|a, b| (a[5] / a[0]).total_cmp(&(b[5] / b[0])));
        if let Some(singular_values) = worst.filter(|s| s[5] < NEAR_SINGULAR * s[0]) {
            near.push(NearSingular { name: sample.name.clone(), singular_values });
        }
    }
    near
}
