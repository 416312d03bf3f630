//! Whether the hold-out is predicted as well as the training says (docs/theory.md (10.15)).

use crate::calibration::{Calibration, Sample};
use crate::identify::run::Identification;
use crate::linalg;
use crate::problem::{Form, Problem};
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use statrs::distribution::{ContinuousCDF, FisherSnedecor};

/// Probability below which the hold-out contradicts the training.
const CONTRADICTS: f64 = 1e-3;

/// Errors of the hold-out beside what noise and standard errors make them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HoldoutTest {
    /// Sum of squares of its residuals, whitened by noise and covariance of the predictions.
    pub value: f64,
    /// Its readings.
    pub degrees_of_freedom: f64,
    /// Errors in units of what noise and standard errors make them, the noise being what the training shows.
    pub ratio: f64,
    /// Probability of errors as large, or larger (F test).
    pub probability: f64,
}

impl HoldoutTest {
    /// Tests hold-out samples at the result; `None` where linear theory does not apply or none closes.
    pub fn new(found: &Identification, holdout: &[Sample]) -> Option<Self> {
        let covariance = found.covariance.as_ref()?;
        let (value, freedom) = found.chi_square()?;
        if freedom < 3.0 || holdout.is_empty() {
            return None;
        }
        let at = found.geometry.deviations_from(&found.supported.nominal());
        let problem = Calibration::new(&found.supported, holdout, Form::Minimal, &at);
        let lin = problem.linearize(&problem.coordinates().nearest(&at)).ok()?;
        let (m, k) = (lin.r.len(), covariance.root.ncols());
        // The noise is what the training shows; what is weak is as uncertain as the tolerances, whatever the noise.
        let scale = (value / freedom).max(1.0);
        let root = Mat::from_fn(covariance.root.nrows(), k, |i, j| {
            let share = covariance.prior_share[j];
            covariance.root[(i, j)] * (1.0 - share + share / scale).sqrt()
        });
        let by = &lin.jac * root;
        let b = linalg::mul_transpose(by.as_ref(), &lin.r);
        let inner = by.transpose() * &by;
        let inner = Mat::from_fn(k, k, |i, j| inner[(i, j)] + if i == j { 1.0 } else { 0.0 });
        let solved = inner.llt(Side::Lower).ok()?.solve(&Mat::from_fn(k, 1, |i, _| b[i]));
        let taken: f64 = (0..k).map(|i| b[i] * solved[(i, 0)]).sum();
        let value = (linalg::dot(&lin.r, &lin.r) - taken).max(0.0);
        let ratio = (value / m as f64 / scale).sqrt();
        let probability = FisherSnedecor::new(m as f64, freedom).ok()?.sf(ratio * ratio);
        (m > 0 && ratio.is_finite()).then_some(Self {
            value,
            degrees_of_freedom: m as f64,
            ratio,
            probability,
        })
    }

    /// Whether it contradicts the training.
    pub fn contradicts(&self) -> bool {
        self.probability < CONTRADICTS
    }

    /// What follows where it does, without a full stop.
    pub fn sentence(&self) -> String {
        format!(
            "the hold-out errs {:.1} times as much as the training's noise and the standard errors explain \
             (probability {}): its postures lie where the identified machine does not hold, or its readings are of another kind",
            self.ratio,
            super::chi_square::probability(self.probability)
        )
    }
}
