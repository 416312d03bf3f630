//! How well a geometry predicts measured postures.

use crate::calibration::{Postures, Sample, SetAside};
use crate::measure::{Errors, Evaluation};
use crate::model::{Geometry, Mechanism};
use rayon::prelude::*;

/// Size of a set of errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Root mean square, each sample by its weight.
    pub rms: f64,
    /// Largest.
    pub max: f64,
}

impl Spread {
    /// Of the values, each behind its weight, if there are any.
    pub fn of(values: impl Iterator<Item = (f64, f64)>) -> Option<Self> {
        let (mut count, mut square, mut max) = (0.0, 0.0, 0.0_f64);
        for (weight, value) in values {
            count += weight;
            square += weight * value * value;
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

/// One sample's part of a [`Fit`].
struct Scored {
    errors: Errors,
    /// Of its whitened residuals.
    square: f64,
    rows: usize,
    weight: f64,
}

/// The samples whose loops do not close with the geometry, and why: those that [`score`] leaves out.
pub fn set_aside(mechanism: &Mechanism, geometry: &Geometry, samples: &[Sample]) -> Vec<SetAside> {
    let open = |(index, sample): (usize, &Sample)| {
        let reason = sample.close_all(mechanism, geometry, &mut Postures::new(mechanism)).err()?;
        Some(SetAside { sample: index, name: sample.name.clone(), reason })
    };
    samples.par_iter().enumerate().filter_map(open).collect()
}

/// Scores the geometry; `None` where no sample closes.
pub fn score(mechanism: &Mechanism, geometry: &Geometry, samples: &[Sample]) -> Option<Fit> {
    let pairs: Vec<(&Geometry, &Sample)> = samples.iter().map(|sample| (geometry, sample)).collect();
    score_each(mechanism, &pairs)
}

/// Scores each sample by a geometry of its own; `None` where none closes.
pub fn score_each(mechanism: &Mechanism, pairs: &[(&Geometry, &Sample)]) -> Option<Fit> {
    let scored: Vec<Option<Scored>> = pairs
        .par_iter()
        .map_init(
            || (Postures::new(mechanism), Evaluation::default()),
            |(postures, evaluation), (geometry, sample)| {
                sample.close_all(mechanism, geometry, postures).ok()?;
                let view = postures.view(sample, geometry);
                evaluation.clear();
                sample.measurement.evaluate(&view, evaluation);
                let square = evaluation.square();
                let (rows, weight) = (evaluation.rows.len(), sample.measurement.weight());
                let scored = || Scored { errors: sample.measurement.error(&view), square, rows, weight };
                square.is_finite().then(scored)
            },
        )
        .collect();
    let scored: Vec<_> = scored.into_iter().flatten().collect();
    if scored.is_empty() {
        return None;
    }
    let square: f64 = scored.iter().map(|s| s.square).sum();
    let rows: usize = scored.iter().map(|s| s.rows).sum();
    let spread = |of: fn(&Errors) -> Option<f64>| {
        Spread::of(scored.iter().filter_map(|s| Some((s.weight, of(&s.errors)?))))
    };
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
