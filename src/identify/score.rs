//! How well a geometry predicts measured postures.

use crate::calibration::postures::{by_posture, telling};
use crate::calibration::{PostureRows, Postures, Sample, SetAside};
use crate::measure::Errors;
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
    /// Postures that took part.
    pub postures: usize,
}

/// A posture's samples.
pub(super) type Together<'s> = Vec<&'s Sample>;

/// One posture's part of a [`Fit`].
pub(super) struct Scored {
    /// Of each sample that was read there, behind its weight.
    errors: Vec<(f64, Errors)>,
    /// Of its whitened residuals.
    pub square: f64,
    /// Their number.
    pub rows: usize,
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
    let postures = by_posture(samples);
    gathered(postures.par_iter().map_init(room(mechanism), scoring(mechanism, geometry)).collect())
}

/// Scores each posture by a geometry of its own; `None` where none closes.
pub(super) fn score_each(mechanism: &Mechanism, pairs: &[(&Geometry, &Together<'_>)]) -> Option<Fit> {
    let one = |room: &mut Room, (geometry, samples): &(&Geometry, &Together<'_>)| {
        scoring(mechanism, geometry)(room, samples)
    };
    gathered(pairs.par_iter().map_init(room(mechanism), one).collect())
}

/// Scores posture by posture; `None` for those that do not close.
pub(super) fn scores(
    mechanism: &Mechanism,
    geometry: &Geometry,
    postures: &[Together<'_>],
) -> Vec<Option<Scored>> {
    postures.par_iter().map_init(room(mechanism), scoring(mechanism, geometry)).collect()
}

/// Memory that one posture leaves to the next.
type Room = (Postures, PostureRows);

fn room(mechanism: &Mechanism) -> impl Fn() -> Room + Sync + Send {
    || (Postures::new(mechanism), PostureRows::default())
}

fn scoring(
    mechanism: &Mechanism,
    geometry: &Geometry,
) -> impl Fn(&mut Room, &Together<'_>) -> Option<Scored> + Sync + Send {
    move |(postures, rows), samples| {
        let all = || samples.iter().copied();
        telling(all())?.close_all(mechanism, geometry, postures).ok()?;
        let rows = rows.evaluate(all(), postures, geometry).ok()?;
        let error = |s: &Sample| (s.measurement.weight(), s.measurement.error(&postures.view(s, geometry)));
        let square = rows.square();
        let scored = || Scored { errors: all().map(error).collect(), square, rows: rows.rows.len() };
        square.is_finite().then(scored)
    }
}

fn gathered(scored: Vec<Option<Scored>>) -> Option<Fit> {
    let scored: Vec<Scored> = scored.into_iter().flatten().collect();
    if scored.is_empty() {
        return None;
    }
    let square: f64 = scored.iter().map(|s| s.square).sum();
    let rows: usize = scored.iter().map(|s| s.rows).sum();
    let errors = || scored.iter().flat_map(|s| &s.errors);
    let spread = |of: fn(&Errors) -> Option<f64>| {
        Spread::of(errors().filter_map(|(weight, e)| Some((*weight, of(e)?))))
    };
    Some(Fit {
        position: spread(|e| e.position),
        rotation: spread(|e| e.rotation),
        distance: spread(|e| e.distance),
        plane: spread(|e| e.plane),
        joint_angle: spread(|e| e.joint_angle),
        joint_length: spread(|e| e.joint_length),
        weighted_rms: (square / rows.max(1) as f64).sqrt(),
        samples: errors().count(),
        postures: scored.len(),
    })
}
