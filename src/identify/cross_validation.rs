//! Prediction error of postures that took no part, each in turn (docs/theory.md (10.6)-(10.8)).

use super::covariance::weight;
use super::run::{Identification, IdentifyError, identify_from};
use super::score::{Fit, score_each};
use crate::calibration::postures::by_posture;
use crate::calibration::{ByPosture, Calibration, Sample};
use crate::linalg;
use crate::model::Geometry;
use crate::problem::{EvalError, Form, Problem};
use crate::solve::{Estimate, Identifier, Stop};
use faer::Mat;
use faer::linalg::solvers::Solve;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// Eigenvalue of a fold's block of the influence matrix above which the other postures do not determine what the fold
/// shows: the prior's weights would change, and the fold is refitted.
const DEPENDENT: f64 = 0.9;

/// How the postures are divided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Folds {
    /// One posture at a time.
    LeaveOneOut,
    /// So many parts of equal size, drawn by seed.
    Parts {
        /// Number of parts, at least 2.
        count: usize,
        /// Of the division.
        seed: u64,
    },
}

/// Errors of postures predicted without them.
#[derive(Clone, Copy, Debug)]
pub struct CrossValidation {
    /// Number of folds.
    pub folds: usize,
    /// Folds whose machine was identified again; the others follow from the influence matrix.
    pub refitted: usize,
    /// Prediction errors over all left out postures.
    pub fit: Fit,
}

impl Folds {
    /// Indices of the postures of each fold, ascending.
    pub fn divide(self, postures: usize) -> Vec<Vec<usize>> {
        match self {
            Folds::LeaveOneOut => (0..postures).map(|i| vec![i]).collect(),
            Folds::Parts { count, seed } => {
                let mut order: Vec<usize> = (0..postures).collect();
                order.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
                let count = count.min(postures).max(1);
                let mut folds = vec![Vec::new(); count];
                order.into_iter().enumerate().for_each(|(k, i)| folds[k % count].push(i));
                folds.iter_mut().for_each(|fold| fold.sort_unstable());
                folds
            }
        }
    }
}

/// Cross-validates a finished identification: by the influence matrix where the estimate is linear about its solution,
/// by identifying again elsewhere. `None` where nothing can be left out or no left out posture closes.
pub fn cross_validate(
    found: &Identification,
    samples: &[Sample],
    folds: Folds,
    identifier: &dyn Identifier,
    stop: &Stop,
) -> Result<Option<CrossValidation>, IdentifyError> {
    let taking = found.taking_part(samples);
    let postures = ByPosture::of(&taking);
    let folds = folds.divide(postures.count());
    if folds.len() < 2 {
        return Ok(None);
    }
    let linear = match found.report.estimate {
        Estimate::Other | Estimate::Decoupled { .. } => None,
        _ => Influence::new(found, &taking).ok(),
    };
    let each: Vec<Result<(Geometry, bool), IdentifyError>> = folds
        .par_iter()
        .map(|fold| match linear.as_ref().and_then(|influence| influence.without(fold)) {
            Some(geometry) => Ok((geometry, false)),
            None => Ok((refit(found, &taking, &postures.samples_of(fold), identifier, stop)?, true)),
        })
        .collect();
    let each = each.into_iter().collect::<Result<Vec<_>, _>>()?;
    let together = by_posture(&taking);
    let mut pairs = Vec::with_capacity(together.len());
    for (fold, (geometry, _)) in folds.iter().zip(&each) {
        pairs.extend(fold.iter().map(|&posture| (geometry, &together[posture])));
    }
    let fit = score_each(&found.start, &pairs);
    let refitted = each.iter().filter(|(_, refitted)| *refitted).count();
    Ok(fit.map(|fit| CrossValidation { folds: folds.len(), refitted, fit }))
}

/// The machine identified from all samples but those of the fold, indices of samples.
pub fn refit(
    found: &Identification,
    samples: &[Sample],
    fold: &[usize],
    identifier: &dyn Identifier,
    stop: &Stop,
) -> Result<Geometry, IdentifyError> {
    let mut held = vec![false; samples.len()];
    fold.iter().for_each(|i| held[*i] = true);
    let rest = samples.iter().zip(held).filter(|(_, held)| !held).map(|(sample, _)| sample.clone());
    let rest: Vec<Sample> = rest.collect();
    // The same start and the same free ends: what is left out is the fold and nothing else.
    let zeros = vec![0.0; found.supported.component_count()];
    Ok(identify_from(&found.supported, &rest, identifier, stop, &zeros)?.geometry)
}

/// What the estimate does where readings change.
pub(super) struct Influence<'a> {
    found: &'a Identification,
    problem: Calibration<'a>,
    x: Vec<f64>,
    /// `(J'J + W)^-1`, n x n.
    inverse: Mat<f64>,
    /// Step to the estimate of all limbs together, n x 1: zero where the estimate is that.
    offset: Mat<f64>,
}

impl<'a> Influence<'a> {
    /// About the solution, with the prior's weights there. For an estimate of each limb by itself it is that of all limbs
    /// together, one step away.
    pub(super) fn new(found: &'a Identification, samples: &'a [Sample]) -> Result<Self, EvalError> {
        if found.covariance.is_none() {
            return Err(EvalError("linear theory does not describe the estimate".into()));
        }
        let at = found.geometry.deviations_from(&found.supported.nominal());
        let problem = Calibration::new(&found.supported, samples, Form::Minimal, &at);
        if problem.sample_count() != samples.len() {
            return Err(EvalError("not every posture closes".into()));
        }
        let x = problem.coordinates().nearest(&at);
        let not_finite = || EvalError("the Jacobian is not finite".into());
        let rows = problem.compress(&x)?;
        let svd = linalg::svd(rows.jac.as_ref()).ok_or_else(not_finite)?;
        let n = x.len();
        let mut root = svd.v;
        // J'r + W z, zero at an estimate of all limbs together.
        let mut gradient = linalg::mul_transpose(rows.jac.as_ref(), &rows.r);
        for k in 0..n {
            let s = svd.s.get(k).copied().unwrap_or(0.0);
            let w = weight(found.report.estimate, s).ok_or_else(not_finite)?;
            let v: Vec<f64> = root.col(k).iter().copied().collect();
            let along = w * linalg::dot(&v, &x);
            gradient.iter_mut().zip(&v).for_each(|(g, v)| *g += along * v);
            let scale = 1.0 / (s * s + w).sqrt();
            root.as_mut().col_mut(k).iter_mut().for_each(|v| *v *= scale);
        }
        let inverse = &root * root.transpose();
        let offset = match found.report.estimate {
            Estimate::Decoupled { .. } => &inverse * Mat::from_fn(n, 1, |i, _| -gradient[i]),
            _ => Mat::zeros(n, 1),
        };
        Ok(Self { found, problem, x, inverse, offset })
    }

    /// The machine as the postures without those of `fold` would give it, the prior's weights unchanged; `None` where
    /// these leave too much open for that.
    pub(super) fn without(&self, fold: &[usize]) -> Option<Geometry> {
        let (mut jac, mut r) = (Vec::new(), Vec::new());
        for &i in fold {
            let one = self.problem.only(i..i + 1).linearize(&self.x).ok()?;
            jac.push(one.jac);
            r.extend(one.r);
        }
        let n = self.x.len();
        let mut stacked = Mat::zeros(r.len(), n);
        let mut first = 0;
        for block in jac {
            stacked.as_mut().subrows_mut(first, block.nrows()).copy_from(&block);
            first += block.nrows();
        }
        // More rows than coordinates say no more than their factor does.
        let fold = linalg::compress(&stacked, &r);
        let gain = &self.inverse * fold.jac.transpose();
        let own = &fold.jac * &gain;
        let largest = linalg::singular_values(own.as_ref())?.first().copied().unwrap_or(0.0);
        if largest > DEPENDENT {
            return None;
        }
        let k = fold.r.len();
        let rest = Mat::<f64>::identity(k, k) - own;
        let rhs = Mat::from_fn(k, 1, |i, _| fold.r[i]) + &fold.jac * &self.offset;
        let e = rest.partial_piv_lu().solve(&rhs);
        let step = &gain * e + &self.offset;
        let x: Vec<f64> = self.x.iter().zip(step.col(0).iter()).map(|(x, dx)| x + dx).collect();
        let d = self.problem.coordinates().deviations(&x);
        d.iter().all(|v| v.is_finite()).then(|| self.found.supported.deviated(&d))
    }

    /// Largest eigenvalue of a posture's block of the influence matrix.
    pub(super) fn leverage(&self, posture: usize) -> Option<f64> {
        let own = self.problem.only(posture..posture + 1).linearize(&self.x).ok()?;
        let block = &own.jac * (&self.inverse * own.jac.transpose());
        linalg::singular_values(block.as_ref())?.first().copied()
    }

    /// Loss of the merit (7.3) where posture `index` has the rows that it has in `other`, by the linear model, and the estimate
    /// there: with `U` both blocks of rows, `r` their residuals at the estimate of all limbs together and `D` -1 for those
    /// taken out and 1 for those put in, `r' (D + U H^-1 U')^-1 r / 2` and `-H^-1 U' (D + U H^-1 U')^-1 r` from there.
    pub(super) fn replaced(&self, index: usize, other: &Calibration<'_>) -> Option<(f64, Vec<f64>)> {
        let out = self.problem.only(index..index + 1).linearize(&self.x).ok()?;
        let into = other.only(index..index + 1).linearize(&self.x).ok()?;
        let (k, n) = (out.r.len(), self.x.len());
        let rows = k + into.r.len();
        let mut stacked = Mat::zeros(rows, n);
        stacked.as_mut().subrows_mut(0, k).copy_from(&out.jac);
        stacked.as_mut().subrows_mut(k, rows - k).copy_from(&into.jac);
        let r = Mat::from_fn(rows, 1, |i, _| if i < k { out.r[i] } else { into.r[i - k] });
        let r = r + &stacked * &self.offset;
        let gain = &self.inverse * stacked.transpose();
        let mut middle = &stacked * &gain;
        (0..rows).for_each(|i| middle[(i, i)] += if i < k { -1.0 } else { 1.0 });
        let e = middle.partial_piv_lu().solve(&r);
        let step = &self.offset - &gain * &e;
        let loss = 0.5 * r.col(0).iter().zip(e.col(0).iter()).map(|(r, e)| r * e).sum::<f64>();
        let x: Vec<f64> = self.x.iter().zip(step.col(0).iter()).map(|(x, dx)| x + dx).collect();
        (loss.is_finite() && x.iter().all(|v| v.is_finite())).then_some((loss, x))
    }
}
