//! What a set of postures can reveal of a machine at one geometry (docs/identifiability.md).

use super::counts::{Counts, Visibility, expected, visibility_of};
use super::directions::{Direction, Likeness, Naming};
use super::singularities::{NearSingular, singularities};
use super::sparse::{Search, Support};
use crate::calibration::postures::posture_name;
use crate::calibration::{Calibration, Sample, SetAside};
use crate::linalg::{self, Svd};
use crate::model::Mechanism;
use crate::problem::{EvalError, Form, Problem};
use crate::statistics::median;
use faer::{Mat, MatRef};
use rayon::prelude::*;

/// Information, relative to the median posture's, below which a posture adds next to nothing.
const NOTHING: f64 = 0.1;
/// Change of all readings together up to which a combination of few components may stand for a weak direction, provided
/// that it moves every single pose by less than its noise.
const FAINT: f64 = 2.0;
/// Part of a combination that must lie in the weak directions, or in those without effect.
const WITHIN: (f64, f64) = (0.5, 0.1);
/// Postures whose rows are multiplied at a time.
const CHUNK: usize = 256;

/// What one posture adds to the others.
#[derive(Clone, Debug, PartialEq)]
pub struct PostureInformation {
    /// The sample.
    pub name: String,
    /// Trace of its block of the influence matrix: readings' worth of parameters that lean on it.
    pub leverage: f64,
    /// By how much the information of all falls where it is left out, `-1/2 log2 det(I - H_kk)` bits.
    pub bits: f64,
}

/// What postures can reveal.
#[derive(Clone, Debug)]
pub struct Analysis {
    /// The three counts, all at the same geometry.
    pub counts: Counts,
    /// Whitened singular values at that geometry, descending.
    pub singular_values: Vec<f64>,
    /// Directions without first-order effect there, one by one.
    pub unseen: Vec<Direction>,
    /// Combinations that stand for the directions of singular value 1 and below: by one tolerance along them every
    /// single pose moves by less than its noise.
    pub weak: Vec<Direction>,
    /// Strong directions of which every single posture shows less than its noise at one tolerance: only many postures
    /// together tell.
    pub by_many: usize,
    /// Every posture's information, in the order of the samples that take part.
    pub postures: Vec<PostureInformation>,
    /// Postures near a singularity.
    pub near_singular: Vec<NearSingular>,
    /// Samples that take no part.
    pub set_aside: Vec<SetAside>,
}

impl Analysis {
    /// Directions without first-order effect, in words.
    pub fn unseen_words(&self, mechanism: &Mechanism) -> Vec<Likeness> {
        Naming::new(mechanism).grouped(&self.unseen)
    }

    /// Weak directions, in words.
    pub fn weak_words(&self, mechanism: &Mechanism) -> Vec<Likeness> {
        Naming::new(mechanism).grouped(&self.weak)
    }

    /// Postures by information, most first.
    pub fn ranked(&self) -> Vec<&PostureInformation> {
        let mut ranked: Vec<&PostureInformation> = self.postures.iter().collect();
        ranked.sort_by(|a, b| b.bits.total_cmp(&a.bits).then_with(|| a.name.cmp(&b.name)));
        ranked
    }

    /// Postures whose information is less than a tenth of the median one's.
    pub fn idle(&self) -> Vec<&PostureInformation> {
        let ranked = self.ranked();
        let least = NOTHING * median(ranked.iter().map(|posture| posture.bits)).unwrap_or(0.0);
        ranked.into_iter().rev().take_while(|posture| posture.bits < least).collect()
    }
}

/// Analyses the samples at link deviations `at` (rad, m; six per link), every instrument taken to read what that geometry
/// predicts.
pub fn analyze(mechanism: &Mechanism, samples: &[Sample], at: &[f64]) -> Result<Analysis, EvalError> {
    let (expected, set_aside) = expected(mechanism, samples, at);
    if let (true, Some(first)) = (expected.is_empty(), set_aside.first()) {
        return Err(EvalError(format!("no posture closes; {}: {}", first.name, first.reason.unitless())));
    }
    let seen = visibility_of(mechanism, &expected, at)?;
    let (unseen, weak) = directions(mechanism, &expected, at, &seen)?;
    let problem = Calibration::new(mechanism, &expected, Form::Minimal, at);
    let x = problem.coordinates().nearest(at);
    let near_singular = singularities(mechanism, &mechanism.deviated(at), &expected);
    let strong = seen.directions.get(.., ..seen.counts.practical);
    let by_many = strongest_change(&problem, &x, strong)?.into_iter().filter(|change| *change < 1.0).count();
    let postures = information(&problem, &x)?;
    let (counts, singular_values) = (seen.counts, seen.structural_values().to_vec());
    Ok(Analysis { counts, singular_values, unseen, weak, by_many, postures, near_singular, set_aside })
}

/// Sparse directions without first-order effect, and weak ones.
fn directions(
    mechanism: &Mechanism,
    expected: &[Sample],
    at: &[f64],
    seen: &Visibility,
) -> Result<(Vec<Direction>, Vec<Direction>), EvalError> {
    let Counts { structural, first_order, practical } = seen.counts;
    let problem = Calibration::new(mechanism, expected, Form::Complete, at);
    let x = problem.coordinates().nearest(at);
    let jac = problem.compress(&x)?.jac;
    let not_finite = || EvalError("the Jacobian is not finite".into());
    let Svd { s, v, .. } = linalg::svd(jac.as_ref()).ok_or_else(not_finite)?;
    let value = |k: usize| s.get(k).copied().unwrap_or(0.0);
    let supports = Naming::new(mechanism).supports(problem.coordinates());
    let told = |u: Vec<f64>| {
        let change = linalg::norm(&linalg::mul(jac.as_ref(), &u));
        let mut deviations = vec![0.0; at.len()];
        let mut start = 0;
        for limb in &problem.coordinates().limbs {
            for (place, &component) in limb.free.iter().enumerate() {
                deviations[start + component] = u[limb.offset + place];
            }
            start += limb.sigma.len();
        }
        Direction { deviations, change }
    };
    let run = |search: Search<'_>, supports: &[Support]| -> Vec<Direction> {
        let mut found: Vec<Direction> = search.run(supports).into_iter().map(told).collect();
        found.iter_mut().for_each(|d| d.change = if d.change < 1e-9 * value(0) { 0.0 } else { d.change });
        found
    };
    let null = v.get(.., first_order.min(v.ncols())..);
    let redundant = problem.redundant(&x);
    let unseen = match structural - first_order {
        0 => Vec::new(),
        count => {
            // What is left of the null space beside all that no machine shows which respects what is held.
            let hidden = null * (null.transpose() * hidden(&problem, mechanism, at, &redundant));
            let hidden = hidden.qr().compute_thin_Q();
            let beside = null - &hidden * (hidden.transpose() * null);
            let target = linalg::svd(beside.as_ref()).ok_or_else(not_finite)?.u;
            let target = target.get(.., ..count.min(target.ncols())).to_owned();
            let rounding = 1e-13 * value(0);
            let most = (value(first_order.max(1) - 1) * value(first_order).max(rounding)).sqrt();
            let (faint, independent) = (&|_: &[f64]| true, WITHIN.1);
            run(Search { jac: jac.as_ref(), seen: hidden, target, most, faint, independent }, &supports)
        }
    };
    let target = v.get(.., practical..first_order).to_owned();
    let whole = problem.linearize(&x)?.jac;
    let rows: Vec<usize> = problem.rows_of_postures().collect();
    let faint = |u: &[f64]| {
        let change = linalg::mul(whole.as_ref(), u);
        let mut first = 0;
        rows.iter().all(|count| {
            first += count;
            linalg::norm(&change[first - count..first]) < 1.0
        })
    };
    let (seen, independent) = (null.to_owned(), WITHIN.0);
    let search = Search { jac: jac.as_ref(), seen, target, most: FAINT, faint: &faint, independent };
    Ok((unseen, run(search, &supports)))
}

/// Orthonormal basis of what no pose tells apart near the machine at deviations `at`: the redundancy, and what held
/// links hide besides.
fn hidden(problem: &Calibration<'_>, mechanism: &Mechanism, at: &[f64], redundant: &Mat<f64>) -> Mat<f64> {
    let coordinates = problem.coordinates();
    match coordinates.structural_count(mechanism) < coordinates.slice_count() {
        true => coordinates.structural_null(mechanism, &mechanism.deviated(at)),
        false => redundant.clone(),
    }
}

/// For each direction of `x` (a column each), the largest change of one posture's readings in standard deviations.
fn strongest_change(
    problem: &Calibration<'_>,
    x: &[f64],
    directions: MatRef<'_, f64>,
) -> Result<Vec<f64>, EvalError> {
    let mut largest = vec![0.0_f64; directions.ncols()];
    let count = problem.posture_count();
    for first in (0..count).step_by(CHUNK) {
        let part = problem.only(first..(first + CHUNK).min(count));
        let change = part.linearize(x)?.jac * directions;
        let mut row = 0;
        for rows in part.rows_of_postures() {
            for (j, largest) in largest.iter_mut().enumerate() {
                let square: f64 = (row..row + rows).map(|i| change[(i, j)].powi(2)).sum();
                *largest = largest.max(square.sqrt());
            }
            row += rows;
        }
    }
    Ok(largest)
}

/// Leverage and information of every posture under the unit prior of the tolerances.
fn information(problem: &Calibration<'_>, x: &[f64]) -> Result<Vec<PostureInformation>, EvalError> {
    let n = x.len();
    let jac = problem.compress(x)?.jac;
    let mut rows = Mat::<f64>::zeros(jac.nrows() + n, n);
    rows.as_mut().subrows_mut(0, jac.nrows()).copy_from(&jac);
    for i in 0..n {
        rows[(jac.nrows() + i, i)] = 1.0;
    }
    let factor = linalg::upper_factor(rows.as_mut());
    let lower = factor.transpose().to_owned();
    let one = |(k, names): (usize, &Vec<&str>)| {
        let own = problem.only(k..k + 1).linearize(x)?.jac;
        let mut spread = own.transpose().to_owned();
        lower.solve_lower_triangular_in_place(spread.as_mut());
        let block = spread.transpose() * &spread;
        let rest = Mat::<f64>::identity(block.nrows(), block.nrows()) - &block;
        let eigenvalues = linalg::singular_values(rest.as_ref()).unwrap_or_default();
        let leverage = (0..block.nrows()).map(|i| block[(i, i)]).sum();
        let bits = -0.5 * eigenvalues.iter().map(|v| v.log2()).sum::<f64>();
        Ok(PostureInformation { name: posture_name(names), leverage, bits: bits.max(0.0) })
    };
    let names: Vec<Vec<&str>> = problem.names_of_postures().collect();
    names.par_iter().enumerate().map(one).collect()
}
