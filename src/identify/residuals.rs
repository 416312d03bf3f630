//! What each posture was read to be, against what a geometry predicts.

use crate::calibration::{Postures, Sample};
use crate::measure::{Errors, Evaluation, Weights};
use crate::model::{Geometry, Mechanism};
use rayon::prelude::*;

/// Predicted minus measured, of one sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Residual {
    /// The sample.
    pub name: String,
    /// Predicted against measured, of whatever was measured.
    pub error: Errors,
    /// Components of a pose, rotation (rad) first, then position (m), in {S} axes; `None` where not measured, as in all
    /// kinds of measurement but poses and positions.
    pub components: [Option<f64>; 6],
    /// The same in standard deviations of the noise, made independent of those before it.
    pub whitened: [Option<f64>; 6],
    /// All residuals of the sample, of whatever kind, in standard deviations of the noise; what is common to its posture
    /// counts as noise of its own.
    pub rows: Vec<f64>,
}

impl Residual {
    /// Root mean square of all whitened residuals.
    pub fn weighted_rms(&self) -> f64 {
        let square: f64 = self.rows.iter().map(|r| r * r).sum();
        (square / f64::max(self.rows.len() as f64, 1.0)).sqrt()
    }
}

/// Residuals of the samples in their order; `None` for those whose loops do not close.
pub fn residuals(mechanism: &Mechanism, geometry: &Geometry, samples: &[Sample]) -> Vec<Option<Residual>> {
    let of = |postures: &mut Postures, sample: &Sample| {
        sample.close_all(mechanism, geometry, postures).ok()?;
        let view = postures.view(sample, geometry);
        let rows = |of: &dyn crate::measure::Measurement| {
            let mut out = Evaluation::default();
            of.evaluate(&view, &mut out);
            if let Some(common) = of.posture_noise() {
                common.whiten(&mut out);
            }
            out.rows
        };
        let weighted = rows(sample.measurement.as_ref());
        let error = sample.measurement.error(&view);
        let (mut components, mut whitened) = ([None; 6], [None; 6]);
        if error.rotation.is_some() || error.position.is_some() {
            let plain = rows(sample.measurement.reweighted(Weights::Unit).as_ref());
            for (plain, weighted) in plain.iter().zip(&weighted) {
                // An unweighted row is one component: the one that it answers to most. A target's position answers to
                // rotations too.
                let largest =
                    |a: &usize, b: &usize| plain.by_tool[*a].abs().total_cmp(&plain.by_tool[*b].abs());
                let moves = plain.by_tool[3..].iter().any(|v| *v != 0.0);
                let index = if moves { 3..6 } else { 0..3 }.max_by(largest)?;
                components[index] = Some(plain.r / sample.measurement.weight().sqrt());
                whitened[index] = Some(weighted.r);
            }
        }
        let rows: Vec<f64> = weighted.iter().map(|row| row.r).collect();
        let finite = components.iter().flatten().chain(&rows).all(|v| v.is_finite());
        finite.then(|| Residual { name: sample.name.clone(), error, components, whitened, rows })
    };
    samples.par_iter().map_init(|| Postures::new(mechanism), of).collect()
}
