//! Weights in place of postures, and the bound on every plan that they prove (docs/theory.md (11.8)).

use super::criterion::{Criterion, View, block_products};
use super::information::{Information, ROWS};
use faer::Mat;

/// Most rounds: one gradient of all candidates each.
const ROUNDS: usize = 150;
/// Pairs of candidates between which weight moves in a round.
const PAIRS: usize = 60;
/// Halvings of a step before a pair is left as it is.
const HALVINGS: usize = 5;
/// Gap at which the relaxation is solved: of `log det` for each kept direction, of a variance relative to it.
const SOLVED: f64 = 1e-3;

/// Rounds in which the bound of a worst case has to improve by a tenth of [`SOLVED`]: near its optimum it creeps.
const PATIENCE: usize = 12;

/// Weights of all candidates, each between 0 and 1, their sum the number of postures.
#[derive(Clone, Debug)]
pub struct Relaxed {
    /// The weights.
    pub weights: Vec<f64>,
    /// No plan has an exact value above this one.
    pub bound: f64,
    /// Rounds that it took.
    pub rounds: usize,
}

/// Improves the weights, beginning with a plan, until the duality gap is small; the least bound on the way.
///
/// The criterion is concave in the weights: with the derivative `g_i` by the i-th, no weights have a value above
/// `value + max over plans of sum g_i - sum w_i g_i` (Kiefer & Wolfowitz 1960, for weights of at most 1: Wynn 1982). The
/// maximum is the sum of the largest derivatives.
pub fn relax(info: &Information, criterion: Criterion, plan: &[usize]) -> Option<Relaxed> {
    let mut weights = vec![0.0; info.count()];
    for &i in plan {
        weights[i] = 1.0;
    }
    let mut bound = f64::INFINITY;
    let mut rounds = 0;
    let mut bounds = Vec::new();
    loop {
        let mut information = info.weighted(&weights);
        let mut view = criterion.view(info, &information)?;
        let slopes = block_products(&info.rows, &(&info.rows * &view.slope));
        let gap = gap(&weights, &slopes, plan.len());
        // A worst case does no less harm than any mixture of cases; `Q` is one, after division by its mass.
        bound = bound.min((view.mixture + gap) / view.mass);
        rounds += 1;
        let scale = if criterion == Criterion::D { info.kept.max(1) as f64 } else { view.value.abs() };
        bounds.push(bound);
        let creeping = bounds
            .iter()
            .nth_back(PATIENCE)
            .is_some_and(|earlier| !criterion.is_smooth() && earlier - bound < 0.1 * SOLVED * scale);
        if gap <= SOLVED * scale || creeping || rounds == ROUNDS {
            return Some(Relaxed { weights, bound, rounds });
        }
        let before = view.value;
        for (up, down) in pairs(&weights, &slopes) {
            transfer(info, criterion, &mut weights, &mut information, &mut view, up, down);
        }
        if view.value <= before {
            return Some(Relaxed { weights, bound, rounds });
        }
    }
}

/// Moves weight from `down` to `up` by a Newton step on the line between them, halved until the criterion grows.
fn transfer(
    info: &Information,
    criterion: Criterion,
    weights: &mut [f64],
    information: &mut Mat<f64>,
    view: &mut View,
    up: usize,
    down: usize,
) {
    let room = (1.0 - weights[up]).min(weights[down]);
    let (u, d) = (info.columns(up), info.columns(down));
    let both = Mat::from_fn(u.nrows(), 2 * ROWS, |i, j| if j < ROWS { u[(i, j)] } else { d[(i, j - ROWS)] });
    let by_covariance = both.transpose() * (&view.covariance * &both);
    let by_slope = both.transpose() * (&view.slope * &both);
    let sign = |i: usize| if i < ROWS { 1.0 } else { -1.0 };
    let (mut first, mut second) = (0.0, 0.0);
    for i in 0..2 * ROWS {
        first += sign(i) * by_slope[(i, i)];
        for j in 0..2 * ROWS {
            second += sign(i) * sign(j) * by_slope[(i, j)] * by_covariance[(i, j)];
        }
    }
    second *= 2.0 * view.bend;
    if first <= 0.0 || room <= 0.0 {
        return;
    }
    let mut step = if second * room > first { first / second } else { room };
    let change = &u * u.transpose() - &d * d.transpose();
    for _ in 0..HALVINGS {
        let trial = &*information + faer::Scale(step) * &change;
        if let Some(next) = criterion.view(info, &trial).filter(|next| next.value > view.value) {
            weights[up] = if step == room && room < weights[down] { 1.0 } else { weights[up] + step };
            weights[down] = if step == room && room == weights[down] { 0.0 } else { weights[down] - step };
            (*information, *view) = (trial, next);
            return;
        }
        step *= 0.5;
    }
}

/// How much the linearised criterion gains at the best plan.
fn gap(weights: &[f64], slopes: &[f64], poses: usize) -> f64 {
    let mut sorted = slopes.to_vec();
    sorted.sort_unstable_by(|a, b| b.total_cmp(a));
    let best: f64 = sorted.iter().take(poses).sum();
    best - weights.iter().zip(slopes).map(|(w, g)| w * g).sum::<f64>()
}

/// Candidates that may gain weight, of largest derivative first, each with one that may lose some, of smallest first.
fn pairs(weights: &[f64], slopes: &[f64]) -> Vec<(usize, usize)> {
    let mut up: Vec<usize> = (0..weights.len()).filter(|&i| weights[i] < 1.0).collect();
    let mut down: Vec<usize> = (0..weights.len()).filter(|&i| weights[i] > 0.0).collect();
    up.sort_unstable_by(|&a, &b| slopes[b].total_cmp(&slopes[a]).then(a.cmp(&b)));
    down.sort_unstable_by(|&a, &b| slopes[a].total_cmp(&slopes[b]).then(a.cmp(&b)));
    up.into_iter().zip(down).take(PAIRS).take_while(|(u, d)| slopes[*u] > slopes[*d]).collect()
}
