//! The active-set method that changes one limit at a time, for programs whose active set Newton steps do not settle.
//!
//! [`polish`](super::polish) holds and releases many limits at once, which is quick but may cycle. Here every pass either
//! goes to the first limit in the way or, at the minimiser on a face, releases the limit whose multiplier is most wrong:
//! the program's cost never rises.

use super::here::Here;
use super::polish::{ActiveSet, SIGN, free_directions, guess, newton};
use super::step::Model;

/// The solution of a program with limits on single coordinates, from a point within them; `None` where there are other
/// limits or sparse penalties, or where `passes` do not do.
pub fn walk(model: &Model, here: &Here, from: &[f64], unit: &[f64], passes: usize) -> Option<Vec<f64>> {
    let others = model.penalty.lasso > 0.0 || model.penalty.group > 0.0 || model.limits.cone < f64::INFINITY;
    if others {
        return None;
    }
    let mut u = from.to_vec();
    let mut set = guess(model, &mut u, unit);
    for _ in 0..passes {
        let quadratic = model.loss.quadratic(here, &here.predict(&u))?;
        let before = u.clone();
        newton(model, here, &quadratic, &free_directions(model, &set, &u), &mut u)?;
        if let Some(first) = cut(model, &before, &mut u) {
            set.held[first] = true;
        } else if let Some(wrong) = most_wrong(model, here, &set, &u) {
            set.held[wrong] = false;
        } else {
            return Some(u);
        }
    }
    None
}

/// Cuts the step from `before` to `u` at the first limit in its way; the coordinate that meets it.
fn cut(model: &Model, before: &[f64], u: &mut [f64]) -> Option<usize> {
    let (lower, upper) = (&model.limits.lower, &model.limits.upper);
    let limit = |i: usize, u: f64| u.max(lower[i]).min(upper[i]);
    let (first, part) = (0..u.len())
        .filter(|&i| limit(i, u[i]) != u[i])
        .map(|i| (i, (limit(i, u[i]) - before[i]) / (u[i] - before[i])))
        .min_by(|(_, a), (_, b)| a.total_cmp(b))?;
    let at = limit(first, u[first]);
    for i in 0..u.len() {
        u[i] = limit(i, before[i] + part * (u[i] - before[i]));
    }
    u[first] = at;
    Some(first)
}

/// The held coordinate whose multiplier has the wrong sign by most.
fn most_wrong(model: &Model, here: &Here, set: &ActiveSet, u: &[f64]) -> Option<usize> {
    let gradient = model.program_gradient(here, u);
    let measure = model.program_measure(here, u);
    let wrong = |i: usize| {
        let slope = (gradient[i] + model.penalty.ridge * u[i]) / measure[i];
        if u[i] >= model.limits.upper[i] { slope } else { -slope }
    };
    (0..u.len())
        .filter(|&i| set.held[i] && model.limits.lower[i] < model.limits.upper[i])
        .map(|i| (i, wrong(i)))
        .filter(|(_, wrong)| *wrong > SIGN)
        .max_by(|(_, a), (_, b)| a.total_cmp(b))
        .map(|(i, _)| i)
}
