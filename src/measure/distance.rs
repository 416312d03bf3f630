//! The distance of a target on the tool from a fixed point, as a ball bar, a draw wire or an interferometer measures it.

use super::measurement::{Clue, Errors, Evaluation, Measurement, View, Weights};
use super::point::{Gauge, Point, distance, push_target_row};
use nalgebra::Vector3;
use std::sync::Arc;

/// Distance between a target and a fixed point, through a gauge.
#[derive(Clone, Debug)]
pub struct Distance {
    reading: f64,
    target: Point,
    point: Point,
    gauge: Gauge,
    sigma: f64,
}

impl Distance {
    /// A reading (m) of a gauge between `target` and `point`, with standard deviation `sigma` (m).
    pub fn new(reading: f64, target: Point, point: Point, gauge: Gauge, sigma: f64) -> Self {
        Self { reading, target, point, gauge, sigma }
    }

    /// Distance (m) and its gradient by the target's position.
    fn distance(&self, view: &View<'_>) -> (f64, Vector3<f64>) {
        let target = view.tool.p + view.tool.r * self.target.at(view.instrument);
        distance(&target, &self.point.at(view.instrument))
    }

    fn predicted(&self, view: &View<'_>) -> f64 {
        let (zero, scale) = self.gauge.at(view.instrument);
        scale * self.distance(view).0 + zero
    }
}

impl Measurement for Distance {
    fn rows(&self) -> usize {
        1
    }

    /// (8.4), (8.5)
    fn evaluate(&self, view: &View<'_>, out: &mut Evaluation) {
        let (apart, gradient) = self.distance(view);
        let (zero, scale) = self.gauge.at(view.instrument);
        let by = gradient * (scale / self.sigma);
        let r = (scale * apart + zero - self.reading) / self.sigma;
        let row = out.rows.len();
        self.point.derive(row, &-by, out);
        self.gauge.derive(row, apart, self.sigma, out);
        push_target_row(r, &by, &self.target, &view.tool, view.instrument, out);
    }

    fn clue(&self) -> Clue {
        Clue::Range { target: self.target, point: self.point, gauge: self.gauge, reading: self.reading }
    }

    fn readings(&self) -> Vec<f64> {
        vec![self.reading]
    }

    fn error(&self, view: &View<'_>) -> Errors {
        Errors { distance: Some((self.predicted(view) - self.reading).abs()), ..Errors::default() }
    }

    fn expected(&self, view: &View<'_>) -> Arc<dyn Measurement> {
        Arc::new(Self { reading: self.predicted(view), ..self.clone() })
    }

    fn perturbed(&self, normal: &mut dyn FnMut() -> f64) -> Arc<dyn Measurement> {
        Arc::new(Self { reading: self.reading + self.sigma * normal(), ..self.clone() })
    }

    fn reweighted(&self, weights: Weights) -> Arc<dyn Measurement> {
        Arc::new(Self { sigma: weights.sigma(false, self.sigma), ..self.clone() })
    }
}
