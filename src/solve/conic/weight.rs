//! The weight of a penalty: given, or chosen on the linearised problem by what it predicts or leaves over.

use super::here::Here;
use super::huber::complement;
use super::step::Model;
use crate::problem::Problem;
use crate::solve::report::WeightPoint;

/// How the weight is found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum WeightRule {
    /// As given.
    Given(f64),
    /// The weight that best predicts rows left out.
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

/// Blocks of consecutive rows, so that the rows of one pose stay together where poses are many.
const FOLDS: usize = 5;

/// Weights tried: half decades about 1, where data and tolerance weigh the same.
fn grid() -> impl Iterator<Item = f64> {
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
    let mut curve = Vec::new();
    for weight in grid() {
        let model = with(weight);
        let score = match rule {
            WeightRule::CrossValidation => left_out(&model, &rows)?,
            _ => left_over(&model, &rows)?,
        };
        curve.push(WeightPoint { weight, score });
    }
    let best = match rule {
        WeightRule::CrossValidation => curve.iter().min_by(|a, b| a.score.total_cmp(&b.score)),
        _ => curve.iter().rev().find(|point| point.score <= 1.0).or(curve.first()),
    };
    best.map(|point| point.weight).ok_or_else(|| "no weight was tried".into()).map(|weight| (weight, curve))
}

/// Mean cost of rows that took no part in the fit, twice, so that it is a mean square for least squares.
fn left_out(model: &Model, rows: &Here) -> Result<f64, String> {
    let m = rows.r.len();
    let folds = FOLDS.min(m).max(1);
    let mut total = 0.0;
    for fold in 0..folds {
        let held: Vec<usize> = (fold * m / folds..(fold + 1) * m / folds).collect();
        let u = model.step(&part(model, rows, &complement(&held, m)), None).map_err(|why| why.0)?.u;
        let predicted = rows.predict(&u);
        let residual: Vec<f64> = held.iter().map(|&i| predicted[i]).collect();
        total += 2.0 * model.loss.merit(&residual);
    }
    Ok(total / m as f64)
}

/// Mean square of the residual that the fit leaves.
fn left_over(model: &Model, rows: &Here) -> Result<f64, String> {
    let all: Vec<usize> = (0..rows.r.len()).collect();
    let u = model.step(&part(model, rows, &all), None).map_err(|why| why.0)?.u;
    Ok(rows.predict(&u).iter().map(|v| v * v).sum::<f64>() / rows.r.len() as f64)
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
