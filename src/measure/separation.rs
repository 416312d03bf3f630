//! The distance between the places of a target in two postures, as a caliper measures it between two features that the
//! machine itself printed, scribed or drilled.

use super::measurement::{Clue, Errors, Evaluation, Measurement, View, Weights};
use super::point::{Gauge, Point, by_twist, distance, push_target_row};
use nalgebra::Vector3;
use std::sync::Arc;

/// Distance between a target in one posture and in another, through a gauge.
#[derive(Clone, Debug)]
pub struct Separation {
    reading: f64,
    second: Vec<f64>,
    target: Point,
    gauge: Gauge,
    sigma: f64,
}

impl Separation {
    /// A reading (m) of a gauge between `target` in the sample's posture and in that of the actuator variables `second`
    /// (rad, m), with standard deviation `sigma` (m).
    pub fn new(reading: f64, second: Vec<f64>, target: Point, gauge: Gauge, sigma: f64) -> Self {
        Self { reading, second, target, gauge, sigma }
    }

    /// Distance (m) and its gradient by the target's first position.
    fn distance(&self, view: &View<'_>) -> (f64, Vector3<f64>) {
        let offset = self.target.at(view.instrument);
        distance(&(view.tool.p + view.tool.r * offset), &(view.second.p + view.second.r * offset))
    }

    fn predicted(&self, view: &View<'_>) -> f64 {
        let (zero, scale) = self.gauge.at(view.instrument);
        scale * self.distance(view).0 + zero
    }
}

impl Measurement for Separation {
    fn rows(&self) -> usize {
        1
    }

    /// (8.4), (8.8)
    fn evaluate(&self, view: &View<'_>, out: &mut Evaluation) {
        let (apart, gradient) = self.distance(view);
        let (zero, scale) = self.gauge.at(view.instrument);
        let by = gradient * (scale / self.sigma);
        let r = (scale * apart + zero - self.reading) / self.sigma;
        let row = out.rows.len();
        let arm = view.second.r * self.target.at(view.instrument);
        self.target.derive(row, &-view.second.r.tr_mul(&by), out);
        self.gauge.derive(row, apart, self.sigma, out);
        out.by_second.push(by_twist(&arm, &-by));
        push_target_row(r, &by, &self.target, &view.tool, view.instrument, out);
    }

    fn second(&self) -> Option<&[f64]> {
        Some(&self.second)
    }

    fn clue(&self) -> Clue {
        Clue::Internal
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

    fn with_second(&self, actuators: &[f64]) -> Option<Arc<dyn Measurement>> {
        Some(Arc::new(Self { second: actuators.to_vec(), ..self.clone() }))
    }

    fn reweighted(&self, weights: Weights) -> Arc<dyn Measurement> {
        Arc::new(Self { sigma: weights.sigma(false, self.sigma), ..self.clone() })
    }
}
