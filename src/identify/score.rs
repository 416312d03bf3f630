//! How well a geometry predicts measured postures.

use crate::calibration::Sample;
use crate::measure::Row;
use crate::model::{Geometry, Mechanism, Posture};
use rayon::prelude::*;

/// Prediction errors over the samples whose loops close.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// Root mean square displacement of the tool point, m; 0 where no position was measured.
    pub position_rms: f64,
    /// Largest displacement, m.
    pub position_max: f64,
    /// Root mean square rotation angle, rad; 0 where no rotation was measured.
    pub rotation_rms: f64,
    /// Largest rotation angle, rad.
    pub rotation_max: f64,
    /// Root mean square of the whitened residuals: 1 where errors are as large as the stated noise.
    pub weighted_rms: f64,
    /// Samples that took part.
    pub samples: usize,
}

/// Scores the geometry; `None` where no sample closes.
pub fn score(mechanism: &Mechanism, geometry: &Geometry, samples: &[Sample]) -> Option<Fit> {
    let scored: Vec<Option<(crate::measure::PoseError, f64, usize)>> = samples
        .par_iter()
        .map_init(
            || Posture::new(mechanism),
            |posture, sample| {
                sample.close(mechanism, geometry, posture).ok()?;
                let tool = posture.tool();
                let mut rows = vec![Row::default(); sample.measurement.rows()];
                sample.measurement.evaluate(&tool, &mut rows);
                let square: f64 = rows.iter().map(|row| row.r * row.r).sum();
                square.is_finite().then(|| (sample.measurement.error(&tool), square, rows.len()))
            },
        )
        .collect();
    let scored: Vec<_> = scored.into_iter().flatten().collect();
    if scored.is_empty() {
        return None;
    }
    let spread = |values: Vec<f64>| -> (f64, f64) {
        let count = values.len().max(1) as f64;
        let square: f64 = values.iter().map(|v| v * v).sum();
        ((square / count).sqrt(), values.into_iter().fold(0.0, f64::max))
    };
    let (position_rms, position_max) = spread(scored.iter().filter_map(|(e, _, _)| e.position).collect());
    let (rotation_rms, rotation_max) = spread(scored.iter().filter_map(|(e, _, _)| e.rotation).collect());
    let square: f64 = scored.iter().map(|(_, square, _)| square).sum();
    let rows: usize = scored.iter().map(|(_, _, rows)| rows).sum();
    Some(Fit {
        position_rms,
        position_max,
        rotation_rms,
        rotation_max,
        weighted_rms: (square / rows.max(1) as f64).sqrt(),
        samples: scored.len(),
    })
}
