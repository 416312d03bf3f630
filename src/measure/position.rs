//! The position of a target on the tool, as a laser tracker or a camera measures it.

use super::measurement::{Clue, Errors, Evaluation, Measurement, View, Weights};
use super::point::{Point, push_target_row};
use super::pose::{NotPositive, Weighting};
use nalgebra::{Matrix6, Vector3};
use std::sync::Arc;

/// Position of a target in {S}, or some of its coordinates.
#[derive(Clone, Debug)]
pub struct Position {
    measured: Vector3<f64>,
    seen: [bool; 3],
    target: Point,
    weighting: Weighting,
}

impl Position {
    /// A measured position (m, {S}) of a target; of the covariance (6 x 6, rotation first, m, {S} axes) the last three
    /// rows and columns count. Coordinates not in `seen` are placeholders.
    pub fn new(
        measured: Vector3<f64>,
        seen: [bool; 3],
        target: Point,
        covariance: &Matrix6<f64>,
    ) -> Result<Self, NotPositive> {
        let weighting = Weighting::whitening(covariance, Self::components(seen))?;
        Ok(Self { measured, seen, target, weighting })
    }

    fn components([x, y, z]: [bool; 3]) -> [bool; 6] {
        [false, false, false, x, y, z]
    }

    fn predicted(&self, view: &View<'_>) -> Vector3<f64> {
        view.tool.p + view.tool.r * self.target.at(view.instrument)
    }
}

impl Measurement for Position {
    fn rows(&self) -> usize {
        self.weighting.rows().len()
    }

    /// (8.3)
    fn evaluate(&self, view: &View<'_>, out: &mut Evaluation) {
        let error = self.predicted(view) - self.measured;
        for k in self.weighting.rows() {
            let by = Vector3::new(k[3], k[4], k[5]);
            push_target_row(by.dot(&error), &by, &self.target, &view.tool, view.instrument, out);
        }
    }

    fn clue(&self) -> Clue {
        match self.seen {
            [true, true, true] => Clue::Position { target: self.target, at: self.measured },
            _ => Clue::None,
        }
    }

    fn readings(&self) -> Vec<f64> {
        self.measured.iter().copied().collect()
    }

    fn error(&self, view: &View<'_>) -> Errors {
        let error = self.predicted(view) - self.measured;
        let square: f64 = error.iter().zip(self.seen).filter(|(_, seen)| *seen).map(|(v, _)| v * v).sum();
        Errors { position: self.seen.contains(&true).then(|| square.sqrt()), ..Errors::default() }
    }

    fn expected(&self, view: &View<'_>) -> Arc<dyn Measurement> {
        Arc::new(Self { measured: self.predicted(view), ..self.clone() })
    }

    fn perturbed(&self, normal: &mut dyn FnMut() -> f64) -> Arc<dyn Measurement> {
        let error = self.weighting.draw(normal);
        let measured = self.measured + Vector3::new(error[3], error[4], error[5]);
        Arc::new(Self { measured, ..self.clone() })
    }

    fn reweighted(&self, weights: Weights) -> Arc<dyn Measurement> {
        let weighting = match weights {
            Weights::Scaled(factor) => self.weighting.scaled(factor),
            _ => Weighting::isotropic(Self::components(self.seen), 1.0, weights.sigma(false, 1.0)),
        };
        Arc::new(Self { weighting, ..self.clone() })
    }
}
