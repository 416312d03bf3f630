//! A plan: which postures to measure, how good they are, and how much better any others could be.

use super::accuracy::{Expected, expected};
use super::candidates::{Candidate, DesignError};
use super::criterion::Criterion;
use super::exchange::exchange;
use super::information::{Information, Instrument};
use super::order::short_way;
use super::relaxation::relax;
use crate::model::Mechanism;
use crate::simulate::actuator_ranges;
use rayon::prelude::*;

/// What is asked of a plan.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Number of postures.
    pub poses: usize,
    /// What they are judged by.
    pub criterion: Criterion,
    /// Sets of postures from which exchange begins: a greedy one, and random ones.
    pub starts: u64,
    /// Of the random ones.
    pub seed: u64,
}

/// Postures to measure.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Indices of candidates, in the order in which to visit them.
    pub chosen: Vec<usize>,
    /// For each of them whether the second of the two postures that are compared is visited first.
    pub reversed: Vec<bool>,
    /// Exact value of the criterion: `log det(I + J'J)` in tolerances for D, a variance for the others (A, E: in
    /// tolerances squared; G: in units of the noise).
    pub value: f64,
    /// No plan of as many of these candidates does better than this, in the same terms.
    pub bound: f64,
    /// Least efficiency against the best plan, 0 to 1.
    pub efficiency: f64,
    /// Directions that an average plan knows better than the tolerances.
    pub kept: usize,
    /// Expected accuracy without any further measurement, and with the plan.
    pub accuracy: (Option<Expected>, Option<Expected>),
}

/// Chooses postures: exchange from several starts, then the bound by the relaxation.
pub fn plan(
    mechanism: &Mechanism,
    candidates: &[Candidate],
    info: &Information,
    settings: &Settings,
) -> Result<Plan, DesignError> {
    let Settings { poses, criterion, starts, seed } = *settings;
    let rounding = || DesignError::Evaluate("the information matrices are not positive definite".into());
    let tried: Vec<Option<(Vec<usize>, f64)>> = (0..starts.max(1))
        .into_par_iter()
        .map(|start| exchange(info, criterion, poses, seed, start))
        .collect();
    let best = tried.into_iter().flatten().reduce(|a, b| if b.1 > a.1 { b } else { a });
    let (chosen, exact) = best.ok_or_else(rounding)?;
    let relaxed = relax(info, criterion, &chosen).ok_or_else(rounding)?;
    // Rounding may leave the bound of a plan that is the best one a hair below it.
    let bound = relaxed.bound.max(exact);
    let units: f64 = info.scale.iter().map(|scale| 2.0 * scale.ln()).sum();
    let (value, bound, efficiency) = match criterion {
        Criterion::D => (exact - units, bound - units, ((exact - bound) / info.kept.max(1) as f64).exp()),
        _ => (-exact, -bound, bound / exact),
    };
    let posture = |i: usize| candidates[i].actuators.as_slice();
    let second = |i: usize| if info.pairs { Instrument::second(i, candidates.len()) } else { i };
    let stops: Vec<[&[f64]; 2]> = chosen.iter().map(|&i| [posture(i), posture(second(i))]).collect();
    let order = short_way(&stops, &actuator_ranges(mechanism));
    Ok(Plan {
        accuracy: (expected(info, &info.base), expected(info, &info.of(&chosen))),
        reversed: order.iter().map(|&(_, reversed)| info.pairs && reversed).collect(),
        chosen: order.into_iter().map(|(i, _)| chosen[i]).collect(),
        kept: info.kept,
        value,
        bound,
        efficiency,
    })
}
