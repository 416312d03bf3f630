//! How well a geometry predicts measured postures.

use crate::calibration::{Postures, Sample};
use crate::measure::{Errors, Evaluation};
use crate::model::{Geometry, Mechanism};
use rayon::prelude::*;

/// Whitened residual, in units of noise and of the median posture's, above which a posture stands out.
const OUTLYING: f64 = 5.0;

/// Size of a set of errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Root mean square.
    pub rms: f64,
    /// Largest.
    pub max: f64,
}

impl Spread {
    /// Of the values, if there are any.
    pub fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let (mut count, mut square, mut max) = (0.0, 0.0, 0.0_f64);
        for value in values {
            count += 1.0;
            square += value * value;
            max = max.max(value);
        }
        (count > 0.0).then(|| Self { rms: f64::sqrt(square / count), max })
    }
}

/// Prediction errors over the samples whose loops close.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// Displacements of the tool point or targets, m; `None` where no position was measured.
    pub position: Option<Spread>,
    /// Rotation angles, rad; `None` where no rotation was measured.
    pub rotation: Option<Spread>,
    /// Of distances, m; `None` where none was measured.
    pub distance: Option<Spread>,
    /// Of heights above planes, m; `None` where none was measured.
    pub plane: Option<Spread>,
    /// Of passive joints' angles, rad; `None` where none was measured.
    pub joint_angle: Option<Spread>,
    /// Of passive joints' lengths, m; `None` where none was measured.
    pub joint_length: Option<Spread>,
    /// Root mean square of the whitened residuals: 1 where errors are as large as the stated noise.
    pub weighted_rms: f64,
    /// Samples that took part.
    pub samples: usize,
}

/// A posture whose prediction stands out.
#[derive(Clone, Debug, PartialEq)]
pub struct Outlier {
    /// The sample.
    pub name: String,
    /// Root mean square of its whitened residuals.
    pub weighted_rms: f64,
}

/// Postures whose whitened residual is above 5, and above 5 times the median one: worst first.
pub fn outliers(mechanism: &Mechanism, geometry: &Geometry, samples: &[Sample]) -> Vec<Outlier> {
    let mut found: Vec<Outlier> = samples
        .par_iter()
        .filter_map(|sample| {
            let fit = score(mechanism, geometry, std::slice::from_ref(sample))?;
            Some(Outlier { name: sample.name.clone(), weighted_rms: fit.weighted_rms })
        })
        .collect();
    found.sort_by(|a, b| b.weighted_rms.total_cmp(&a.weighted_rms).then_with(|| a.name.cmp(&b.name)));
    let median = found.get(found.len() / 2).map_or(0.0, |outlier| outlier.weighted_rms);
    found.retain(|outlier| outlier.weighted_rms > OUTLYING * median.max(1.0));
    found
}

/// Scores the geometry; `None` where no sample closes.
pub fn score(mechanism: &Mechanism, geometry: &Geometry, samples: &[Sample]) -> Option<Fit> {
    let scored: Vec<Option<(Errors, f64, usize)>> = samples
        .par_iter()
        .map_init(
            || (Postures::new(mechanism), Evaluation::default()),
            |(postures, evaluation), sample| {
                sample.close_all(mechanism, geometry, postures).ok()?;
                let view = postures.view(sample, geometry);
                evaluation.clear();
                sample.measurement.evaluate(&view, evaluation);
                let square = evaluation.square();
                let rows = evaluation.rows.len();
                square.is_finite().then(|| (sample.measurement.error(&view), square, rows))
            },
        )
        .collect();
    let scored: Vec<_> = scored.into_iter().flatten().collect();
    if scored.is_empty() {
        return None;
    }
    let square: f64 = scored.iter().map(|(_, square, _)| square).sum();
    let rows: usize = scored.iter().map(|(_, _, rows)| rows).sum();
    let spread = |of: fn(&Errors) -> Option<f64>| Spread::of(scored.iter().filter_map(|(e, _, _)| of(e)));
    Some(Fit {
        position: spread(|e| e.position),
        rotation: spread(|e| e.rotation),
        distance: spread(|e| e.distance),
        plane: spread(|e| e.plane),
        joint_angle: spread(|e| e.joint_angle),
        joint_length: spread(|e| e.joint_length),
        weighted_rms: (square / rows.max(1) as f64).sqrt(),
        samples: scored.len(),
    })
}
