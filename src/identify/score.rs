//! How well a geometry predicts measured postures.

use crate::calibration::{Postures, Sample, SetAside};
use crate::measure::{Errors, Evaluation};
use crate::model::{Geometry, Mechanism};
use crate::statistics::median;
use rayon::prelude::*;
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Probability with which any posture at all is called an outlier where there is none.
pub const FALSE_ALARM: f64 = 0.01;

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

/// A posture whose prediction stands out.
#[derive(Clone, Debug, PartialEq)]
pub struct Outlier {
    /// The sample.
    pub name: String,
    /// Root mean square of its whitened residuals.
    pub weighted_rms: f64,
    /// Probability that noise alone makes a residual as large as this.
    pub probability: f64,
}

/// Part of the worst residual below which a posture counts as dragged along by worse ones.
const DRAGGED: f64 = 0.2;

/// Postures whose residual noise does not explain, worst first: chi-square tests of each posture, corrected for their
/// number (Holm, *Scand. J. Statistics* 6, 1979), at [`FALSE_ALARM`] for all of them together.
///
/// Where the median posture is worse than the stated noise makes it, its excess counts as noise: a model that misses
/// everywhere by a little has no outliers. A gross error drags its neighbours along: what is small beside the worst is not
/// listed before that is mended.
pub fn outliers(mechanism: &Mechanism, geometry: &Geometry, samples: &[Sample]) -> Vec<Outlier> {
    let mut tested: Vec<(Outlier, ChiSquared)> = samples
        .par_iter()
        .filter_map(|sample| {
            let fit = score(mechanism, geometry, std::slice::from_ref(sample))?;
            let name = sample.name.clone();
            let outlier = Outlier { name, weighted_rms: fit.weighted_rms, probability: 1.0 };
            Some((outlier, ChiSquared::new(sample.measurement.rows() as f64).ok()?))
        })
        .collect();
    let square = |outlier: &Outlier, law: &ChiSquared| outlier.weighted_rms.powi(2) * law.freedom();
    let excess = tested.iter().map(|(outlier, law)| square(outlier, law) / law.inverse_cdf(0.5));
    let noise = median(excess).map_or(1.0, |median| median.max(1.0));
    for (outlier, law) in &mut tested {
        outlier.probability = law.sf(square(outlier, law) / noise);
    }
    tested.sort_by(|(a, _), (b, _)| {
        let worst = b.weighted_rms.total_cmp(&a.weighted_rms);
        a.probability.total_cmp(&b.probability).then(worst).then_with(|| a.name.cmp(&b.name))
    });
    let count = tested.len();
    let significant = |k: usize, p: f64| p <= FALSE_ALARM / (count - k) as f64;
    let worst = tested.iter().map(|(outlier, _)| outlier.weighted_rms).fold(0.0, f64::max);
    let found = tested.into_iter().map(|(outlier, _)| outlier).enumerate();
    let found = found.take_while(|(k, outlier)| significant(*k, outlier.probability));
    found.map(|(_, outlier)| outlier).filter(|outlier| outlier.weighted_rms >= DRAGGED * worst).collect()
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
