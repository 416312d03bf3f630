//! The three counts of what can be identified (docs/theory.md section 5), at one geometry.

use crate::calibration::{Calibration, Postures, Sample, SetAside};
use crate::linalg;
use crate::measure::Weights;
use crate::model::Mechanism;
use crate::problem::{EvalError, Form, Problem};

/// Relative size below which a singular value is rounding.
const ROUNDING: f64 = 1e-13;
/// Relative size below which a singular value may belong to a drawing that was rounded to some decimals.
const SMALL: f64 = 1e-6;
/// Ratio of neighbouring singular values that separates what is there from what rounding of the drawing left.
const GAP: f64 = 1e3;

/// How many combinations of link deviations can be seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Counts {
    /// By structure: 4r + 2p + 6 where no link is held and no passive joint is sensed, and the unknown constants of the
    /// instrument. Where links are held, the rank that deviations which respect them can reach.
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
    /// coordinate, zeros where there are fewer rows. Those beyond the structural count are rounding.
    pub singular_values: Vec<f64>,
    /// Right singular vectors (minimal coordinates), one column per coordinate.
    pub directions: faer::Mat<f64>,
}

impl Visibility {
    /// The singular values of the structural parameters: those beyond are rounding.
    pub fn structural_values(&self) -> &[f64] {
        self.singular_values.get(..self.counts.structural).unwrap_or(&self.singular_values)
    }
}

/// What the samples can see at link deviations `at` (rad, m), apart from the values that they happened to read:
/// every instrument is taken to read what the geometry predicts. Samples that do not close are left out.
pub fn visibility(mechanism: &Mechanism, samples: &[Sample], at: &[f64]) -> Result<Visibility, EvalError> {
    visibility_of(mechanism, &expected(mechanism, samples, at).0, at)
}

/// Samples with the readings that the geometry at deviations `at` predicts, and those that do not close.
pub(super) fn expected(
    mechanism: &Mechanism,
    samples: &[Sample],
    at: &[f64],
) -> (Vec<Sample>, Vec<SetAside>) {
    let geometry = mechanism.deviated(at);
    let mut postures = Postures::new(mechanism);
    let (mut expected, mut apart) = (Vec::with_capacity(samples.len()), Vec::new());
    for (index, sample) in samples.iter().enumerate() {
        match sample.close_all(mechanism, &geometry, &mut postures) {
            Ok(()) => {
                let measurement = sample.measurement.expected(&postures.view(sample, &geometry));
                expected.push(Sample { measurement, ..sample.clone() });
            }
            Err(reason) => apart.push(SetAside { sample: index, name: sample.name.clone(), reason }),
        }
    }
    (expected, apart)
}

/// What samples see whose readings are those expected at deviations `at`.
pub(super) fn visibility_of(
    mechanism: &Mechanism,
    expected: &[Sample],
    at: &[f64],
) -> Result<Visibility, EvalError> {
    let problem = Calibration::new(mechanism, expected, Form::Minimal, at);
    let structural = problem.coordinates().structural_count(mechanism);
    let here = problem.compress(&problem.coordinates().nearest(at))?;
    let svd = linalg::svd(here.jac.as_ref())
        .ok_or_else(|| EvalError("the whitened Jacobian is not finite".into()))?;
    let mut singular_values = svd.s;
    singular_values.resize(problem.coordinates().count(), 0.0);
    let first_order = first_order(mechanism, expected, at)?.min(structural);
    // What has no effect to first order is not known however little noise there is: its value is rounding.
    let practical = singular_values.iter().filter(|s| **s > 1.0).count().min(first_order);
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
    Ok(rank(&s))
}

/// Numerical rank by descending singular values (5.1): those above rounding, but only those before the widest gap where
/// small values lie beyond a wide one. A drawing rounded to six decimals is not square to rounding.
fn rank(s: &[f64]) -> usize {
    let Some(&largest) = s.first() else { return 0 };
    let above = s.iter().filter(|v| **v > ROUNDING * largest).count();
    let gaps = (1..above).filter(|&k| s[k] < SMALL * largest).map(|k| (k, s[k - 1] / s[k]));
    match gaps.max_by(|a, b| a.1.total_cmp(&b.1)) {
        Some((k, ratio)) if ratio > GAP => k,
        _ => above,
    }
}
