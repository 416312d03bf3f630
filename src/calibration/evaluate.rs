//! All that was measured at one closed posture, whitened together.

use super::sample::{Postures, Sample};
use crate::measure::Evaluation;
use crate::model::Geometry;
use crate::problem::EvalError;

/// Evaluates postures one after the other; holds what it needs from one to the next.
#[derive(Debug, Default)]
pub struct PostureRows {
    all: Evaluation,
    /// Of one sample among several.
    one: Evaluation,
}

impl PostureRows {
    /// Residuals, with their derivatives, of all `samples` of a posture that is closed: whitened by their noise and by
    /// what the posture's samples have in common. Sample by sample where they have nothing in common. An error where the
    /// samples state different sizes of it.
    pub fn evaluate<'s>(
        &mut self,
        samples: impl Iterator<Item = &'s Sample>,
        postures: &Postures,
        geometry: &Geometry,
    ) -> Result<&Evaluation, EvalError> {
        self.whitened(samples, postures, geometry)?;
        Ok(&self.all)
    }

    /// The same with the logarithm of the determinant of the covariance that the rows have after their own noise was
    /// whitened: 0 where nothing is common.
    pub fn with_log_det<'s>(
        &mut self,
        samples: impl Iterator<Item = &'s Sample>,
        postures: &Postures,
        geometry: &Geometry,
    ) -> Result<(&Evaluation, f64), EvalError> {
        let log_det = self.whitened(samples, postures, geometry)?;
        Ok((&self.all, log_det))
    }

    fn whitened<'s>(
        &mut self,
        samples: impl Iterator<Item = &'s Sample>,
        postures: &Postures,
        geometry: &Geometry,
    ) -> Result<f64, EvalError> {
        self.all.clear();
        let mut common = None;
        for (k, sample) in samples.enumerate() {
            let view = postures.view(sample, geometry);
            let rows = if k == 0 {
                common = sample.measurement.posture_noise();
                &mut self.all
            } else {
                // One error is of one size: were it not, nobody could say which rows it joins.
                if sample.measurement.posture_noise() != common {
                    return Err(EvalError(format!(
                        "{}: what is common to the samples of its posture is stated otherwise for another of them",
                        sample.name
                    )));
                }
                self.one.clear();
                &mut self.one
            };
            sample.measurement.evaluate(&view, rows);
            if rows.rows.iter().any(|row| !row.r.is_finite()) {
                return Err(EvalError(format!("{}: residual is not finite", sample.name)));
            }
            if k > 0 {
                self.all.append(&self.one);
            }
        }
        Ok(common.map_or(0.0, |noise| noise.whiten(&mut self.all)))
    }
}
