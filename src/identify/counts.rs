//! The three counts of what can be identified (docs/theory.md section 5), at one geometry.

use crate::calibration::{Calibration, Postures, Sample};
use crate::linalg;
use crate::measure::Weights;
use crate::model::Mechanism;
use crate::problem::{EvalError, Form, Problem};

/// Relative size below which a singular value of the Jacobian in m and rad is zero (first-order rank).
const RANK: f64 = 1e-8;

/// How many combinations of link deviations can be seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Counts {
    /// By structure: 4r + 2p + 6 where no link is held and no passive joint is sensed, and the unknown constants of the
    /// instrument.
    pub structural: usize,
    /// By rank of the Jacobian at this geometry over these postures.
    pub first_order: usize,
    /// By data that beats the tolerance: whitened singular values above 1.
    pub practical: usize,
}

/// Counts and singular values at one geometry.
#[derive(Clone, Debug)]
pub struct Visibility {
    /// The three counts.
    pub counts: Counts,
    /// Singular values of the whitened Jacobian in minimal, tolerance-scaled coordinates, descending: one per
    /// structural parameter, zeros where there are fewer rows.
    pub singular_values: Vec<f64>,
    /// Right singular vectors (minimal coordinates), one column per structural parameter.
    pub directions: faer::Mat<f64>,
}

/// What the samples can see at link deviations `at` (rad, m), apart from the values that they happened to read:
/// every instrument is taken to read what the geometry predicts. Samples that do not close are left out.
pub fn visibility(mechanism: &Mechanism, samples: &[Sample], at: &[f64]) -> Result<Visibility, EvalError> {
    let geometry = mechanism.deviated(at);
    let mut postures = Postures::new(mechanism);
    let mut expected = Vec::with_capacity(samples.len());
    for sample in samples {
        if sample.close_all(mechanism, &geometry, &mut postures).is_ok() {
            let measurement = sample.measurement.expected(&postures.view(sample, &geometry));
            expected.push(Sample { measurement, ..sample.clone() });
        }
    }
    let problem = Calibration::new(mechanism, &expected, Form::Minimal, at);
    let structural = problem.coordinates().slice_count();
    let here = problem.compress(&problem.coordinates().nearest(at))?;
    let svd = linalg::svd(here.jac.as_ref())
        .ok_or_else(|| EvalError("the whitened Jacobian is not finite".into()))?;
    let mut singular_values = svd.s;
    singular_values.resize(structural, 0.0);
    let practical = singular_values.iter().filter(|s| **s > 1.0).count();
    let first_order = first_order(mechanism, &expected, at)?;
    Ok(Visibility {
        counts: Counts { structural, first_order, practical },
        singular_values,
        directions: svd.v,
    })
}

fn first_order(mechanism: &Mechanism, expected: &[Sample], at: &[f64]) -> Result<usize, EvalError> {
    let unit: Vec<Sample> = expected
        .iter()
        .map(|s| Sample { measurement: s.measurement.reweighted(Weights::Unit), ..s.clone() })
        .collect();
    let plain = Calibration::new(mechanism, &unit, Form::Plain, at);
    let here = plain.compress(&plain.coordinates().nearest(at))?;
    let s = linalg::singular_values(here.jac.as_ref())
        .ok_or_else(|| EvalError("the Jacobian is not finite".into()))?;
    Ok(s.iter().filter(|v| **v > RANK * s[0]).count())
}
