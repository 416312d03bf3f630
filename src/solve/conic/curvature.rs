//! Curvature of the residual that a linear model does not see, on the face of the limits where it matters.
//!
//! Along what is redundant the cost is constant, but that way is curved: with limits active it leads away from them or
//! through them, and to first order nothing tells where it is best. Where limits keep the residual large, directions that the
//! data see weakly are bent by more than the linear model has.

use super::limits::Limits;
use super::loss::Loss;
use super::penalty::Penalty;
use crate::linalg;
use crate::problem::{Group, Problem};
use faer::{Mat, Side};
use rayon::prelude::*;

/// Half the distance, in units of `x`, over which a derivative is differenced: far above rounding, far below the radius of
/// curvature of a machine, which is some thousand tolerances.
const STEP: f64 = 0.05;
/// Part of the largest component of the gradient above which a squared singular value is left to the linear model:
/// machines are bent by a thousandth a tolerance.
const BENT: f64 = 1e-2;
/// Way, in units of `x`, over which a curvature is kept.
const KEPT: f64 = 0.02;
/// Part of a direction that a limit must see to hold it.
const SEEN: f64 = 1e-9;

/// Rows `C` with `|C du|^2 / 2` the curvature of the residual along the directions where it matters.
#[derive(Clone, Debug)]
pub struct Curvature {
    /// The rows.
    pub rows: Mat<f64>,
    at: Vec<f64>,
    held: Mat<f64>,
}

/// What is minimised within what.
pub struct Bent<'a> {
    /// The problem.
    pub problem: &'a dyn Problem,
    /// Cost of residuals in force.
    pub loss: &'a dyn Loss,
    /// Cost of deviations.
    pub penalty: &'a Penalty,
    /// Limits of deviations.
    pub limits: &'a Limits,
}

impl Bent<'_> {
    /// The curvature at `x`, that of `before` where it still holds; `None` where no limit is reached or it cannot be
    /// evaluated.
    pub fn at(&self, x: &[f64], before: Option<Curvature>) -> Option<Curvature> {
        let held = held(self.penalty, self.limits, self.problem.groups(), x);
        if held.nrows() == 0 {
            return None;
        }
        if let Some(before) = before
            && before.held.shape() == held.shape()
            && (&before.held - &held).norm_max() <= KEPT
            && before.at.iter().zip(x).all(|(a, b)| (a - b).abs() <= KEPT)
        {
            return Some(before);
        }
        let rows = self.rows(x, &held)?;
        Some(Curvature { rows, at: x.to_vec(), held })
    }

    fn rows(&self, x: &[f64], held: &Mat<f64>) -> Option<Mat<f64>> {
        let here = self.problem.linearize(x).ok()?;
        let influence = self.loss.influence(&here.r);
        let of_influence = |at: &[f64]| {
            let there = self.problem.linearize(at).ok()?;
            Some(linalg::mul_transpose(there.jac.as_ref(), &influence))
        };
        let gradient = linalg::mul_transpose(here.jac.as_ref(), &influence);
        let steepest = gradient.iter().fold(0.0f64, |a, g| a.max(g.abs()));
        let of_limits = linalg::svd(held.as_ref())?;
        let rank = of_limits.s.iter().filter(|s| **s > SEEN).count();
        let face = of_limits.v.get(.., rank..).to_owned();
        let seen = linalg::compress(&(&here.jac * &face), &here.r);
        let svd = linalg::svd(seen.jac.as_ref())?;
        let strong = svd.s.iter().filter(|s| **s * **s > BENT * steepest).count();
        let weak = &face * svd.v.get(.., strong..);
        if weak.ncols() == 0 {
            return None;
        }
        let difference = |j: usize| {
            let along: Vec<f64> = weak.col(j).iter().copied().collect();
            let moved = |way: f64| x.iter().zip(&along).map(|(x, d)| x + way * d).collect::<Vec<f64>>();
            let (ahead, behind) = (of_influence(&moved(STEP))?, of_influence(&moved(-STEP))?);
            Some(ahead.iter().zip(behind).map(|(a, b)| (a - b) / (2.0 * STEP)).collect::<Vec<f64>>())
        };
        let bent: Option<Vec<Vec<f64>>> = (0..weak.ncols()).into_par_iter().map(difference).collect();
        let bent = bent?;
        let products = weak.transpose() * Mat::from_fn(x.len(), bent.len(), |i, j| bent[j][i]);
        let symmetric = (&products + products.transpose()) * 0.5;
        if !symmetric.is_all_finite() {
            return None;
        }
        let eigen = symmetric.self_adjoint_eigen(Side::Lower).ok()?;
        let squares: Vec<f64> =
            (0..weak.ncols()).map(|k| svd.s.get(strong + k).map_or(0.0, |s| s * s)).collect();
        let sizes = eigen.S().column_vector().iter().enumerate().map(|(k, bend)| {
            let linear: f64 = eigen.U().col(k).iter().zip(&squares).map(|(u, s)| u * u * s).sum();
            // Where all in all the merit bends down a step is as long as if it bent up: limits end it. Where it bends down
            // by less than the linear model up, that model is on the safe side.
            if *bend < 0.0 && linear + bend >= 0.0 { 0.0 } else { bend.abs().sqrt() }
        });
        let sizes: Vec<f64> = sizes.collect();
        let directions = &weak * eigen.U();
        Some(Mat::from_fn(sizes.len(), x.len(), |i, j| sizes[i] * directions[(j, i)]))
    }
}

/// One row, of unit length, a limit reached or a coordinate held at the zero of a penalty: its derivative.
fn held(penalty: &Penalty, limits: &Limits, groups: &[Group], x: &[f64]) -> Mat<f64> {
    let at_bound = |i: usize| x[i] >= limits.upper[i] || x[i] <= limits.lower[i];
    let mut single: Vec<bool> =
        (0..x.len()).map(|i| at_bound(i) || (penalty.lasso > 0.0 && x[i] == 0.0)).collect();
    let mut rows: Vec<Vec<(usize, f64)>> = Vec::new();
    for group in groups {
        let length = group.length(x);
        if penalty.group > 0.0 && length == 0.0 {
            group.members.iter().for_each(|&i| single[i] = true);
        } else if length > 0.0 && limits.reaches_cone(length) {
            rows.push(group.members.iter().map(|&i| (i, x[i] / length)).collect());
        }
    }
    rows.extend((0..x.len()).filter(|&i| single[i]).map(|i| vec![(i, 1.0)]));
    let mut out = Mat::zeros(rows.len(), x.len());
    for (k, row) in rows.iter().enumerate() {
        row.iter().for_each(|&(i, value)| out[(k, i)] = value);
    }
    out
}
