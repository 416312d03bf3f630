//! What errors are held against: the Cramer-Rao bound at the truth, with the tolerances as prior. It is a reference
//! and no bound at that truth (docs/theory.md (13.3)).

use super::draw::Drawn;
use super::line::Prediction;
use crate::calibration::representative::representative;
use crate::calibration::{Calibration, Coordinates, Sample};
use crate::linalg;
use crate::measure::Weights;
use crate::problem::{Form, Problem};
use faer::Mat;

/// Rows of a whole pose: three of rotation, then three of position.
const WHOLE: usize = 6;

/// The truth in minimal coordinates, and what the postures tell of it.
#[derive(Clone, Debug)]
pub struct Bound {
    /// The truth, in tolerances.
    pub truth: Vec<f64>,
    /// Whitened singular values at the truth, one per structural parameter.
    pub singular_values: Vec<f64>,
    /// Directions that go with them, by columns.
    pub directions: Mat<f64>,
    /// Bound on the error of the predicted hold-out, by rotation and position where it consists of whole poses; `None`
    /// where there is none that closes.
    pub holdout: Option<Prediction>,
}

/// `(J'J + I)^-1` in tolerances at the truth that was drawn, carried to the hold-out (docs/theory.md (13.3)); `None` where
/// the truth is not known or cannot be evaluated.
///
/// Van Trees's bound has the mean of `J'J` over truths in its place and bounds the mean error over truths. Where `J` hardly
/// changes over the tolerances both are one number.
pub fn bound(drawn: &Drawn) -> Option<Bound> {
    let mechanism = &drawn.start;
    let truth = representative(mechanism, drawn.truth.as_ref()?);
    let at = Coordinates::new(mechanism, Form::Minimal).deviations(&truth);
    let training = Calibration::new(mechanism, &drawn.samples, Form::Minimal, &at);
    let svd = linalg::svd(training.compress(&truth).ok()?.jac.as_ref())?;
    let mut singular_values = svd.s;
    singular_values.resize(truth.len(), 0.0);
    let spread = |k: usize| 1.0 / (1.0 + singular_values[k] * singular_values[k]).sqrt();
    let root = Mat::from_fn(truth.len(), truth.len(), |i, k| svd.v[(i, k)] * spread(k));
    let holdout = predicted(drawn, &at, &truth, &root);
    Some(Bound { truth, singular_values, directions: svd.v, holdout })
}

/// Errors of the predicted hold-out for errors of covariance `root root'`.
fn predicted(drawn: &Drawn, at: &[f64], truth: &[f64], root: &Mat<f64>) -> Option<Prediction> {
    let count = drawn.holdout.len();
    // Squares of all rows, by their place in a pose where they are those of poses; and the number of rows.
    let squares = |holdout: &[Sample]| -> Option<([f64; WHOLE], usize)> {
        let samples = Calibration::new(&drawn.start, holdout, Form::Minimal, at);
        if count == 0 || samples.sample_count() != count {
            return None;
        }
        let errors = samples.linearize(truth).ok()?.jac * root;
        let mut sums = [0.0; WHOLE];
        for column in errors.col_iter() {
            column.iter().enumerate().for_each(|(row, v)| sums[row % WHOLE] += v * v);
        }
        Some((sums, errors.nrows()))
    };
    let rms = |squares: &[f64], by: usize| Some((squares.iter().sum::<f64>() / by as f64).sqrt());
    let (whitened, rows) = squares(&drawn.holdout)?;
    let in_noise = Prediction { in_noise: rms(&whitened, rows), poses: count, ..Prediction::default() };
    if drawn.holdout.iter().any(|s| s.measurement.pose().is_none()) {
        return Some(in_noise);
    }
    let unit = |s: &Sample| Sample { measurement: s.measurement.reweighted(Weights::Unit), ..s.clone() };
    let (plain, _) = squares(&drawn.holdout.iter().map(unit).collect::<Vec<_>>())?;
    Some(Prediction { rotation: rms(&plain[..3], count), position: rms(&plain[3..], count), ..in_noise })
}
