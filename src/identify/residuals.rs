//! What each posture was read to be, against what a geometry predicts.

use crate::calibration::Sample;
use crate::measure::{PoseError, Row, Weights};
use crate::model::{Geometry, Mechanism, Posture};
use rayon::prelude::*;

/// Predicted minus measured, of one sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Residual {
    /// The sample.
    pub name: String,
    /// Angle and displacement between the poses.
    pub error: PoseError,
    /// Components, rotation (rad) first, then position (m), in {S} axes; `None` where not measured.
    pub components: [Option<f64>; 6],
    /// The same in standard deviations of the noise, made independent of those before it.
    pub whitened: [Option<f64>; 6],
}

impl Residual {
    /// Root mean square of the whitened components.
    pub fn weighted_rms(&self) -> f64 {
        let (mut square, mut count) = (0.0, 0.0);
        for r in self.whitened.iter().flatten() {
            (square, count) = (square + r * r, count + 1.0);
        }
        (square / f64::max(count, 1.0)).sqrt()
    }
}

/// Residuals of the samples in their order; `None` for those whose loops do not close.
pub fn residuals(mechanism: &Mechanism, geometry: &Geometry, samples: &[Sample]) -> Vec<Option<Residual>> {
    let of = |posture: &mut Posture, sample: &Sample| {
        sample.close(mechanism, geometry, posture).ok()?;
        let tool = posture.tool();
        let rows = |of: &dyn crate::measure::Measurement| {
            let mut rows = vec![Row::default(); of.rows()];
            of.evaluate(&tool, &mut rows);
            rows
        };
        let plain = rows(sample.measurement.reweighted(Weights::Unit).as_ref());
        let weighted = rows(sample.measurement.as_ref());
        let (mut components, mut whitened) = ([None; 6], [None; 6]);
        for (plain, weighted) in plain.iter().zip(&weighted) {
            // An unweighted row is one component: the one that it answers to most.
            let largest = |a: &usize, b: &usize| plain.by_tool[*a].abs().total_cmp(&plain.by_tool[*b].abs());
            let index = (0..6).max_by(largest)?;
            components[index] = Some(plain.r);
            whitened[index] = Some(weighted.r);
        }
        let finite = components.iter().chain(&whitened).flatten().all(|v| v.is_finite());
        let error = sample.measurement.error(&tool);
        finite.then(|| Residual { name: sample.name.clone(), error, components, whitened })
    };
    samples.par_iter().map_init(|| Posture::new(mechanism), of).collect()
}
