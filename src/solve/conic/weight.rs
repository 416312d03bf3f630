//! The weight of a penalty: given, or chosen on the linearised problem by what it predicts or leaves over.

use super::here::{Here, complement};
use super::loss::Loss;
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

/// Newton steps from the solution under a neighbouring weight, each of which may change the active set, before clarabel
/// is asked: it takes as long as dozens of them.
const PATH_PASSES: usize = 150;
/// Half decades above the first weight from which the path of the lasso starts: up there next to nothing is off nominal.
const ABOVE: i32 = 8;
/// Parts into which the samples are divided, each left out once.
const FOLDS: usize = 5;

/// Decades tried first: about 1, where data and tolerance weigh the same.
const DECADES: std::ops::RangeInclusive<i32> = -4..=4;

/// The weight that `rule` chooses at `x`, and the curve it was chosen from; `with` is the model for a weight.
///
/// Decades first, from the largest down until two in a row predict worse than one before them or, for the discrepancy
/// principle, one fits; then the half decades beside the best. Small weights free most coordinates and cost most.
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
    let blocks = problem.blocks();
    let held = match rule {
        WeightRule::CrossValidation => folds(&blocks, m)?,
        _ => vec![Vec::new()],
    };
    let loss = with(1.0).loss;
    let parts: Vec<Part> = held.into_iter().map(|held| Part::without(held, &rows, &blocks, loss)).collect();
    let mut curve: Vec<(WeightPoint, Vec<Vec<f64>>)> = Vec::new();
    let attempt = |weight: f64, half_decades: i32, near: &[Vec<f64>]| {
        // Between neighbouring half decades few coordinates of the lasso come or go: Newton steps from one solution to the
        // next are a tenth of what clarabel costs.
        let above = if with(weight).penalty.lasso > 0.0 { half_decades } else { 0 };
        let path: Vec<Model> =
            (1..=above).rev().map(|k| with(weight * 10f64.powf(0.5 * f64::from(k)))).collect();
        let (score, fits) = score(&with(weight), &path, &rows, &parts, near)?;
        Ok::<_, String>((WeightPoint { weight, score: score / m as f64 }, fits))
    };
    // From the largest weight, under which next to nothing is off nominal: each solution is near the one before.
    let mut near = vec![vec![0.0; x.len()]; parts.len()];
    for decade in DECADES.rev() {
        let above = if curve.is_empty() { ABOVE } else { 1 };
        let tried = attempt(10f64.powi(decade), above, &near)?;
        near.clone_from(&tried.1);
        curve.push(tried);
        if enough(rule, &curve) {
            break;
        }
    }
    let decades = curve.len();
    let points = |curve: &[(WeightPoint, Vec<Vec<f64>>)]| {
        let mut points: Vec<WeightPoint> = curve.iter().map(|(point, _)| *point).collect();
        points.sort_by(|a, b| a.weight.total_cmp(&b.weight));
        points
    };
    let coarse = best(rule, &points(&curve)).ok_or("no weight was tried")?;
    for half_decade in [0.5, -0.5] {
        let weight = coarse * 10f64.powf(half_decade);
        // The nearest larger weight that was tried.
        let from = curve[..decades].iter().rev().find(|(point, _)| point.weight > weight);
        if let Some((_, near)) = from
            && curve.iter().any(|(point, _)| point.weight < weight)
        {
            let near = near.clone();
            curve.push(attempt(weight, 0, &near)?);
        }
    }
    let points = points(&curve);
    best(rule, &points).ok_or_else(|| "no weight was tried".into()).map(|weight| (weight, points))
}

/// Whether smaller weights than the last of a descending curve need not be tried: they fit the noise, or more than the
/// noise asks.
fn enough(rule: WeightRule, curve: &[(WeightPoint, Vec<Vec<f64>>)]) -> bool {
    let scores: Vec<f64> = curve.iter().map(|(point, _)| point.score).collect();
    match (rule, scores.as_slice()) {
        (WeightRule::CrossValidation, [before @ .., a, b]) => {
            let least = before.iter().copied().fold(f64::INFINITY, f64::min);
            *a > least && *b > *a
        }
        (WeightRule::Discrepancy, [.., last]) => *last <= 1.0,
        _ => false,
    }
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

/// What one fit sees, and the rows that it does not see.
struct Part {
    here: Here,
    held: Vec<usize>,
    /// Cost of the rows that it sees, and of the others.
    losses: [Box<dyn Loss>; 2],
}

impl Part {
    fn without(held: Vec<usize>, rows: &Here, blocks: &[Range<usize>], loss: &dyn Loss) -> Self {
        let seen = complement(&held, rows.r.len());
        let x = rows.x.clone();
        let here = if loss.needs_rows() {
            let jac = faer::Mat::from_fn(seen.len(), x.len(), |i, j| rows.jac[(seen[i], j)]);
            let r: Vec<f64> = seen.iter().map(|&i| rows.r[i]).collect();
            Here { x, cost: crate::problem::cost(&r), r, jac }
        } else {
            Here::compressed(x, rows.compress(&seen))
        };
        let losses = [&seen, &held].map(|of| loss.arranged(&renumbered(blocks, of), of.len(), 0));
        Self { here, held, losses }
    }
}

/// The blocks that `rows`, ascending and of whole blocks, consist of, by their places among these.
fn renumbered(blocks: &[Range<usize>], rows: &[usize]) -> Vec<Range<usize>> {
    let mut next = 0;
    let taken = blocks.iter().filter(|block| rows.binary_search(&block.start).is_ok());
    let block = |block: &Range<usize>| {
        next += block.len();
        next - block.len()..next
    };
    taken.map(block).collect()
}

/// The fits of all parts, each from the point near which it may be by way of the solutions of `path`, and what their rows
/// left out cost, twice, so that it is a sum of squares for least squares; where none are left out, the sum of squares
/// that the fit leaves.
fn score(
    model: &Model,
    path: &[Model],
    rows: &Here,
    parts: &[Part],
    near: &[Vec<f64>],
) -> Result<(f64, Vec<Vec<f64>>), String> {
    let of_part = |(part, near): (&Part, &Vec<f64>)| {
        let mut near = near.clone();
        let model = &Model { loss: part.losses[0].as_ref(), ..model.clone() };
        for larger in path {
            let larger = Model { loss: part.losses[0].as_ref(), ..larger.clone() };
            near = larger.solution_near(&part.here, &near, PATH_PASSES).unwrap_or(near);
        }
        let fit = model.step_near(&part.here, None, &near, PATH_PASSES).map_err(|why| why.0)?.u;
        let predicted = rows.predict(&fit);
        let cost = if part.held.is_empty() {
            predicted.iter().map(|v| v * v).sum()
        } else {
            let residual: Vec<f64> = part.held.iter().map(|&i| predicted[i]).collect();
            2.0 * part.losses[1].merit(&residual)
        };
        Ok((cost, fit))
    };
    let fits: Result<Vec<(f64, Vec<f64>)>, String> =
        parts.par_iter().zip(near.par_iter()).map(of_part).collect();
    let (costs, points): (Vec<f64>, Vec<Vec<f64>>) = fits?.into_iter().unzip();
    Ok((costs.iter().sum(), points))
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
