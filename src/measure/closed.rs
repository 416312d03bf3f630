//! A measurement whose posture was closed before.

use super::measurement::{Clue, Errors, Evaluation, Measurement, View, Weights};
use std::sync::Arc;

/// Joint variables (machine order, rad and m) at which a sample's loops were closed.
#[derive(Clone, Debug, PartialEq)]
pub struct ClosedAt {
    /// Of its posture.
    pub first: Vec<f64>,
    /// Of the posture that it is compared with; empty where there is none.
    pub second: Vec<f64>,
}

/// Any measurement with the joint variables at which its posture was closed: later closures start there, so that the
/// posture stays the one that was identified from.
#[derive(Clone, Debug)]
pub struct Closed {
    inner: Arc<dyn Measurement>,
    at: Arc<ClosedAt>,
}

impl Closed {
    /// The measurement, closed at these joint variables; what it knew of that before is forgotten.
    pub fn at(inner: &Arc<dyn Measurement>, at: ClosedAt) -> Arc<dyn Measurement> {
        Arc::new(Self { inner: inner.clone(), at: Arc::new(at) })
    }

    fn again(&self, inner: Arc<dyn Measurement>) -> Arc<dyn Measurement> {
        Arc::new(Self { inner, at: self.at.clone() })
    }
}

impl Measurement for Closed {
    fn inner(&self) -> Option<&dyn Measurement> {
        Some(self.inner.as_ref())
    }

    fn rows(&self) -> usize {
        self.inner.rows()
    }

    fn evaluate(&self, view: &View<'_>, out: &mut Evaluation) {
        self.inner.evaluate(view, out);
    }

    fn closed_at(&self) -> Option<&ClosedAt> {
        Some(&self.at)
    }

    fn alone(&self) -> Option<Arc<dyn Measurement>> {
        Some(self.again(self.inner.alone()?))
    }

    fn clue(&self) -> Clue {
        self.inner.clue()
    }

    fn readings(&self) -> Vec<f64> {
        self.inner.readings()
    }

    fn error(&self, view: &View<'_>) -> Errors {
        self.inner.error(view)
    }

    fn expected(&self, view: &View<'_>) -> Arc<dyn Measurement> {
        self.again(self.inner.expected(view))
    }

    fn perturbed(&self, normal: &mut dyn FnMut() -> f64) -> Arc<dyn Measurement> {
        self.again(self.inner.perturbed(normal))
    }

    /// Another second posture was not closed.
    fn with_second(&self, actuators: &[f64]) -> Option<Arc<dyn Measurement>> {
        self.inner.with_second(actuators)
    }

    fn reweighted(&self, weights: Weights) -> Arc<dyn Measurement> {
        self.again(self.inner.reweighted(weights))
    }
}
