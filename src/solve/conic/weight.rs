//! The weight of a penalty: given, or chosen on the linearised problem by what it predicts or leaves over.

use super::here::{Here, complement};
use super::step::Model;
use crate::problem::Problem;
use crate::solve::report::WeightPoint;
use rayon::prelude::*;
use std::ops::Range;

/// How the weight is found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum WeightRule {
    /// As given.
    Given(f64),
    /// The weight that best predicts samples left out.
    CrossValidation,
    /// The largest weight that leaves no more than the stated noise (Morozov 1966).
    Discrepancy,
}

impl std::fmt::Display for WeightRule {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            WeightRule::Given(weight) => write!(f, "{weight}"),
            WeightRule::CrossValidation => write!(f, "cv"),
            WeightRule::Discrepancy => write!(f, "discrepancy"),
        }
    }
}

/// Parts into which the samples are divided, each left out once.
const FOLDS: usize = 5;

/// Weights tried: half decades about 1, where data and tolerance weigh the same.
fn grid() -> impl DoubleEndedIterator<Item = f64> {
    (-8..=8).map(|half_decade| 10f64.powf(0.5 * f64::from(half_decade)))
}

/// The weight that `rule` chooses at `x`, and the curve it was chosen from; `with` is the model for a weight.
pub fn choose<'a>(
    rule: WeightRule,
    problem: &dyn Problem,
    x: &[f64],
    with: impl Fn(f64) -> Model<'a>,
) -> Result<(f64, Vec<WeightPoint>), String> {
    if let WeightRule::Given(weight) = rule {
        return Ok((weight, Vec::new()));
    }
    let rows = Here::at(problem, x, true)?;
    let m = rows.r.len();
    let folds = match rule {
        WeightRule::CrossValidation => folds(&problem.blocks(), m)?,
        _ => Vec::new(),
    };
    let mut near = vec![vec![0.0; x.len()]; FOLDS];
    let mut curve = Vec::new();
    // From the largest weight, under which next to nothing is off nominal: each solution is near the one before.
    for weight in grid().rev() {
        let model = with(weight);
        let score = match rule {
            WeightRule::CrossValidation => left_out(&model, &rows, &folds, &mut near)?,
            _ => left_over(&model, &rows, &mut near[0])?,
        };
        curve.push(WeightPoint { weight, score: score / m as f64 });
    }
    curve.reverse();
    best(rule, &curve).ok_or_else(|| "no weight was tried".into()).map(|weight| (weight, curve))
}

/// The weight that `rule` chooses from a curve of ascending weights; `None` of an empty one.
pub fn best(rule: WeightRule, curve: &[WeightPoint]) -> Option<f64> {
    let point = match rule {
        WeightRule::Given(weight) => return Some(weight),
        WeightRule::CrossValidation => curve.iter().min_by(|a, b| a.score.total_cmp(&b.score)),
        WeightRule::Discrepancy => curve.iter().rev().find(|point| point.score <= 1.0).or(curve.first()),
    };
    point.map(|point| point.weight)
}

/// The rows of every fold: whole blocks, consecutive ones together, in parts as equal as they come.
///
/// The rows of one sample share its noise and its posture: rows left out would be predicted from their own sample.
fn folds(blocks: &[Range<usize>], rows: usize) -> Result<Vec<Vec<usize>>, String> {
    let single: Vec<Range<usize>> = (0..rows).map(|row| row..row + 1).collect();
    let blocks = if blocks.is_empty() { &single } else { blocks };
    let folds = FOLDS.min(blocks.len());
    if folds < 2 {
        return Err("cross-validation needs at least two samples".into());
    }
    let of = |fold: usize| blocks[fold * blocks.len() / folds..(fold + 1) * blocks.len() / folds].iter();
    Ok((0..folds).map(|fold| of(fold).cloned().flatten().collect()).collect())
}

/// Cost of rows that took no part in the fit, twice, so that it is a sum of squares for least squares.
fn left_out(model: &Model, rows: &Here, folds: &[Vec<usize>], near: &mut [Vec<f64>]) -> Result<f64, String> {
    let of_fold = |(held, near): (&Vec<usize>, &mut Vec<f64>)| {
        *near = fit(model, rows, &complement(held, rows.r.len()), near)?;
        let predicted = rows.predict(near);
        let residual: Vec<f64> = held.iter().map(|&i| predicted[i]).collect();
        Ok(2.0 * model.loss.merit(&residual))
    };
    let costs: Result<Vec<f64>, String> = folds.par_iter().zip(near.par_iter_mut()).map(of_fold).collect();
    Ok(costs?.iter().sum())
}

/// Sum of squares of the residual that the fit leaves.
fn left_over(model: &Model, rows: &Here, near: &mut Vec<f64>) -> Result<f64, String> {
    let all: Vec<usize> = (0..rows.r.len()).collect();
    *near = fit(model, rows, &all, near)?;
    Ok(rows.predict(near).iter().map(|v| v * v).sum())
}

fn fit(model: &Model, rows: &Here, chosen: &[usize], near: &[f64]) -> Result<Vec<f64>, String> {
    model.step_near(&part(model, rows, chosen), None, near).map(|step| step.u).map_err(|why| why.0)
}

fn part(model: &Model, rows: &Here, chosen: &[usize]) -> Here {
    let jac = faer::Mat::from_fn(chosen.len(), rows.x.len(), |i, j| rows.jac[(chosen[i], j)]);
    let r: Vec<f64> = chosen.iter().map(|&i| rows.r[i]).collect();
    if model.loss.needs_rows() {
        return Here { x: rows.x.clone(), cost: crate::problem::cost(&r), r, jac };
    }
    let compressed = crate::linalg::compress(&jac, &r);
    Here { x: rows.x.clone(), r: compressed.r, jac: compressed.jac, cost: compressed.cost }
}

#[cfg(test)]
mod tests {
    use super::folds;

    #[test]
    fn folds_take_samples_whole() {
        let blocks: Vec<_> = (0..7).map(|k| 3 * k..3 * k + 3).collect();
        let folds = folds(&blocks, 21).expect("seven samples");
        assert_eq!(folds.iter().map(Vec::len).collect::<Vec<_>>(), [3, 3, 6, 3, 6]);
        assert_eq!(folds.concat(), (0..21).collect::<Vec<usize>>());
        assert!(folds.iter().all(|fold| fold[0] % 3 == 0));
    }

    #[test]
    fn rows_without_blocks_stand_alone_and_one_sample_is_too_few() {
        assert_eq!(folds(&[], 3).expect("three rows"), [[0], [1], [2]]);
        let one: Vec<_> = std::iter::once(0..6).collect();
        assert!(folds(&one, 6).is_err());
    }
}
