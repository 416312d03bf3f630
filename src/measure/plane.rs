//! The touch of a plane: a nozzle on a bed, a probe on a surface plate; or the height above it that a dial shows.

use super::measurement::{Clue, Errors, Evaluation, Measurement, View, Weights};
use super::point::{Plane, Point, push_target_row};
use nalgebra::Vector3;
use std::sync::Arc;

/// Height of a target above a plane: none where it touches.
#[derive(Clone, Debug)]
pub struct Touch {
    /// `None` for a touch.
    height: Option<f64>,
    target: Point,
    plane: Plane,
    sigma: f64,
}

impl Touch {
    /// A touch, or a height (m) along the normal, with standard deviation `sigma` (m).
    pub fn new(height: Option<f64>, target: Point, plane: Plane, sigma: f64) -> Self {
        Self { height, target, plane, sigma }
    }

    fn target(&self, view: &View<'_>) -> Vector3<f64> {
        view.tool.p + view.tool.r * self.target.at(view.instrument)
    }

    fn predicted(&self, view: &View<'_>) -> f64 {
        let (normal, offset) = self.plane.at(view.instrument);
        normal.dot(&self.target(view)) - offset
    }

    fn measured(&self) -> f64 {
        self.height.unwrap_or(0.0)
    }
}

impl Measurement for Touch {
    fn rows(&self) -> usize {
        1
    }

    /// (8.6), (8.7)
    fn evaluate(&self, view: &View<'_>, out: &mut Evaluation) {
        let (normal, offset) = self.plane.at(view.instrument);
        let p = self.target(view);
        let r = (normal.dot(&p) - offset - self.measured()) / self.sigma;
        self.plane.derive(out.rows.len(), 1.0 / self.sigma, &p, view.instrument, out);
        push_target_row(r, &(normal / self.sigma), &self.target, &view.tool, view.instrument, out);
    }

    fn clue(&self) -> Clue {
        Clue::Touch { target: self.target, plane: self.plane, height: self.measured() }
    }

    fn is_contact(&self) -> bool {
        self.height.is_none()
    }

    fn readings(&self) -> Vec<f64> {
        self.height.into_iter().collect()
    }

    fn error(&self, view: &View<'_>) -> Errors {
        Errors { plane: Some((self.predicted(view) - self.measured()).abs()), ..Errors::default() }
    }

    fn expected(&self, view: &View<'_>) -> Arc<dyn Measurement> {
        Arc::new(Self { height: Some(self.predicted(view)), ..self.clone() })
    }

    fn perturbed(&self, normal: &mut dyn FnMut() -> f64) -> Arc<dyn Measurement> {
        Arc::new(Self { height: self.height.map(|h| h + self.sigma * normal()), ..self.clone() })
    }

    fn reweighted(&self, weights: Weights) -> Arc<dyn Measurement> {
        Arc::new(Self { sigma: weights.sigma(false, self.sigma), ..self.clone() })
    }
}
