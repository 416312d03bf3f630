//! A measurement that counts more, or less, than its noise says.

use super::measurement::{Clue, Errors, Evaluation, Measurement, View, Weights};
use std::sync::Arc;

/// Any measurement with a factor on its information: one reading of weight `w` is worth `w` of weight 1, so all of its
/// whitened rows are multiplied by `sqrt(w)` (docs/theory.md (8.10)). What is common to its posture stays as it is, however
/// many readings it stands for.
#[derive(Clone, Debug)]
pub struct Weighted {
    inner: Arc<dyn Measurement>,
    weight: f64,
}

impl Weighted {
    /// The measurement with this weight, which is positive; itself where the weight is 1.
    pub fn by(inner: Arc<dyn Measurement>, weight: f64) -> Arc<dyn Measurement> {
        if weight == 1.0 { inner } else { Arc::new(Self { inner, weight }) }
    }

    fn again(&self, inner: Arc<dyn Measurement>) -> Arc<dyn Measurement> {
        Arc::new(Self { inner, weight: self.weight })
    }
}

impl Measurement for Weighted {
    fn inner(&self) -> Option<&dyn Measurement> {
        Some(self.inner.as_ref())
    }

    fn rows(&self) -> usize {
        self.inner.rows()
    }

    fn evaluate(&self, view: &View<'_>, out: &mut Evaluation) {
        self.inner.evaluate(view, out);
        let root = self.weight.sqrt();
        for row in &mut out.rows {
            row.r *= root;
            row.by_tool.iter_mut().for_each(|v| *v *= root);
        }
        out.by_second.as_flattened_mut().iter_mut().for_each(|v| *v *= root);
        out.by_limb.iter_mut().flat_map(|by| &mut by.by_twist).for_each(|v| *v *= root);
        out.by_constant.iter_mut().for_each(|by| by.value *= root);
    }

    fn weight(&self) -> f64 {
        self.weight
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

    /// Noise as small as the weight makes it: that of the mean of so many readings.
    fn perturbed(&self, normal: &mut dyn FnMut() -> f64) -> Arc<dyn Measurement> {
        let root = self.weight.sqrt();
        self.again(self.inner.perturbed(&mut || normal() / root))
    }

    fn with_second(&self, actuators: &[f64]) -> Option<Arc<dyn Measurement>> {
        Some(self.again(self.inner.with_second(actuators)?))
    }

    fn reweighted(&self, weights: Weights) -> Arc<dyn Measurement> {
        self.again(self.inner.reweighted(weights))
    }
}
