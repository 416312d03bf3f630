//! How far a result is from a stationary point of what its identifier minimises, judged by the problem.

use crate::calibration::{Calibration, Sample};
use crate::identify::Identification;
use crate::identify::covariance::weight;
use crate::linalg;
use crate::measure::Weights;
use crate::problem::{Form, Problem};
use crate::solve::Estimate;

/// Singular values at most this, relative to the largest, are zero.
const ROUNDING: f64 = 1e-8;

/// Relative offset of Bates and Watts (Technometrics 23(2), 1981), with the prior's rows among the residuals
/// (docs/theory.md (13.1)): the length of the Gauss-Newton step in units of the uncertainty of the estimate.
///
/// `None` for constrained, sparse and robust estimates, which are stationary points of something else
/// ([`super::objective`]), and where the result cannot be evaluated.
pub fn relative_offset(found: &Identification, samples: &[Sample], form: Form) -> Option<f64> {
    let estimate = found.report.estimate;
    if estimate == Estimate::Other {
        return None;
    }
    let at = found.geometry.deviations_from(&found.start.nominal());
    // Without penalties and limits the redundancy has no say.
    let form = match (form, estimate) {
        (Form::Complete, Estimate::Split { .. }) => Form::Minimal,
        (form, _) => form,
    };
    let in_form: Vec<Sample> = match form {
        Form::Plain => samples
            .iter()
            .map(|s| Sample { measurement: s.measurement.reweighted(Weights::SpatialTwist), ..s.clone() })
            .collect(),
        Form::Minimal | Form::Complete => samples.to_vec(),
    };
    let problem = Calibration::new(&found.start, &in_form, form, &at);
    let x = problem.coordinates().nearest(&at);
    let here = problem.compress(&x).ok()?;
    let svd = linalg::svd(here.jac.as_ref())?;
    let along = linalg::mul_transpose(svd.u.as_ref(), &here.r);
    let deviation = linalg::mul_transpose(svd.v.as_ref(), &x);
    let largest = svd.s.first().copied().unwrap_or(0.0);
    let (mut decrement, mut square) = (0.0, 2.0 * here.cost);
    let (mut free, mut rows) = (0.0, problem.rows() as f64);
    for (k, x) in deviation.iter().enumerate() {
        let (s, r) = (svd.s.get(k).copied().unwrap_or(0.0), along.get(k).copied().unwrap_or(0.0));
        let prior = match estimate {
            Estimate::LeastSquares => 0.0,
            _ => weight(estimate, s)?,
        };
        if s <= ROUNDING * largest && prior == 0.0 {
            continue;
        }
        decrement += (s * r + prior * x).powi(2) / (s * s + prior);
        square += prior * x * x;
        free += 1.0;
        rows += f64::from(u8::from(prior > 0.0));
    }
    let variance = (square - decrement).max(0.0) / f64::max(rows - free, 1.0);
    // The noise is stated: residuals that are smaller, as those of exact data, leave no less uncertainty.
    let variance = if form == Form::Plain { variance } else { variance.max(1.0) };
    let offset = (decrement / f64::max(free, 1.0) / variance.max(f64::MIN_POSITIVE)).sqrt();
    offset.is_finite().then_some(offset)
}
