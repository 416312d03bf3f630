//! The active-set method that changes one limit at a time, for programs whose active set Newton steps do not settle.
//!
//! [`polish`](super::polish) holds and releases many limits at once, which is quick but may cycle. Here every pass either
//! goes to the first limit in the way or, at the minimiser on a face, releases the limit whose multiplier is most wrong:
//! the program's cost never rises.

use super::here::Here;
use super::polish::{ActiveSet, SIGN, free_directions, guess, newton};
use super::step::Model;
use crate::linalg::norm;

/// Halvings of a step along spheres.
const HALVINGS: usize = 30;
/// Move, relative to the point, that is none.
const STILL: f64 = 1e-13;

/// What a step meets, or what is released: a coordinate's limit or a group's.
enum Limit {
    Bound(usize),
    Cone(usize),
}

/// The solution of a program with limits, from a point within them; `None` where there are sparse penalties, or where
/// `passes` do not do.
pub fn walk(model: &Model, here: &Here, from: &[f64], unit: &[f64], passes: usize) -> Option<Vec<f64>> {
    if model.penalty.lasso > 0.0 || model.penalty.group > 0.0 {
        return None;
    }
    let mut u = from.to_vec();
    let mut set = guess(model, &mut u, unit);
    on_spheres(model, &set, &mut u)?;
    for _ in 0..passes {
        let quadratic = model.loss.quadratic(here, &here.predict(&u))?;
        let before = u.clone();
        newton(model, here, &quadratic, &free_directions(model, &set, &u), &mut u)?;
        let met = cut(model, &set, &before, &mut u);
        match met {
            Some(Limit::Bound(i)) => set.held[i] = true,
            Some(Limit::Cone(g)) => set.cone[g] = true,
            None => {}
        }
        if set.cone.contains(&true) && !along_spheres(model, here, &set, &before, &mut u)? && met.is_none() {
            // Spheres are curved: one step does not end at the minimiser on the face.
            continue;
        }
        if met.is_some() {
            continue;
        }
        match most_wrong(model, here, &set, &u) {
            Some(Limit::Bound(i)) => set.held[i] = false,
            Some(Limit::Cone(g)) => set.cone[g] = false,
            None => return Some(u),
        }
    }
    None
}

/// Puts groups that are held at the limit of their cone on it; `None` where the coordinates held there are beyond it.
fn on_spheres(model: &Model, set: &ActiveSet, u: &mut [f64]) -> Option<()> {
    for (g, group) in model.groups.iter().enumerate() {
        if set.cone[g] && !model.limits.onto_cone(u, group, |i, _| set.held[i]) {
            return None;
        }
    }
    Some(())
}

/// Puts the end `u` of a step from `before` back on the spheres, and shortens it until the program's cost falls; whether the
/// step was nothing.
fn along_spheres(model: &Model, here: &Here, set: &ActiveSet, before: &[f64], u: &mut [f64]) -> Option<bool> {
    let cost = |u: &[f64]| model.merit(&here.predict(u), u);
    let least = cost(before);
    for _ in 0..HALVINGS {
        on_spheres(model, set, u)?;
        let moved = u.iter().zip(before).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        if moved <= STILL * norm(u) {
            return Some(true);
        }
        if cost(u) <= least {
            return Some(false);
        }
        u.iter_mut().zip(before).for_each(|(u, before)| *u = 0.5 * (*u + before));
    }
    u.copy_from_slice(before);
    on_spheres(model, set, u)?;
    Some(true)
}

/// Cuts the step from `before` to `u` at the first limit in its way; what it meets.
fn cut(model: &Model, set: &ActiveSet, before: &[f64], u: &mut [f64]) -> Option<Limit> {
    let (lower, upper) = (&model.limits.lower, &model.limits.upper);
    let limit = |i: usize, u: f64| u.max(lower[i]).min(upper[i]);
    let bounds = (0..u.len())
        .filter(|&i| limit(i, u[i]) != u[i])
        .map(|i| ((limit(i, u[i]) - before[i]) / (u[i] - before[i]), Limit::Bound(i)));
    let cones = model.groups.iter().enumerate().filter_map(|(g, group)| {
        if set.cone[g] || group.length(u) <= model.limits.cone {
            return None;
        }
        let sum = |of: &dyn Fn(usize) -> f64| group.members.iter().map(|&i| of(i)).sum::<f64>();
        let a = sum(&|i| (u[i] - before[i]).powi(2));
        if a == 0.0 {
            return None;
        }
        let b = sum(&|i| (u[i] - before[i]) * before[i]);
        let c = model.limits.cone.powi(2) - sum(&|i| before[i] * before[i]);
        // |before + t (u - before)| is the limit.
        let part = ((b * b + a * c.max(0.0)).sqrt() - b) / a;
        Some((part.clamp(0.0, 1.0), Limit::Cone(g)))
    });
    let (part, first) = bounds.chain(cones).min_by(|(a, _), (b, _)| a.total_cmp(b))?;
    let ends: Vec<f64> = before.iter().zip(&*u).map(|(b, u)| b + part * (u - b)).collect();
    if let Limit::Bound(i) = first {
        let at = limit(i, u[i]);
        u.copy_from_slice(&ends);
        u[i] = at;
    } else {
        u.copy_from_slice(&ends);
    }
    (0..u.len()).for_each(|i| u[i] = limit(i, u[i]));
    Some(first)
}

/// What is held and whose multiplier has the wrong sign by most.
fn most_wrong(model: &Model, here: &Here, set: &ActiveSet, u: &[f64]) -> Option<Limit> {
    let mut gradient = model.program_gradient(here, u);
    gradient.iter_mut().zip(u).for_each(|(g, u)| *g += model.penalty.ridge * u);
    let measure = model.program_measure(here, u);
    let mut wrong: Vec<(f64, Limit)> = Vec::new();
    for (g, group) in model.groups.iter().enumerate().filter(|(g, _)| set.cone[*g]) {
        let free = || group.members.iter().filter(|&&i| !set.held[i]);
        let along: f64 = free().map(|&i| gradient[i] * u[i]).sum();
        let square: f64 = free().map(|&i| u[i] * u[i]).sum();
        let largest = free().fold(f64::MIN_POSITIVE, |a, &i| a.max(measure[i]));
        wrong.push((along / (square.sqrt() * largest), Limit::Cone(g)));
        group.members.iter().for_each(|&i| gradient[i] -= along / square * u[i]);
    }
    let held = (0..u.len()).filter(|&i| set.held[i] && model.limits.lower[i] < model.limits.upper[i]);
    wrong.extend(held.map(|i| {
        let slope = gradient[i] / measure[i];
        (if u[i] >= model.limits.upper[i] { slope } else { -slope }, Limit::Bound(i))
    }));
    let most = wrong.into_iter().filter(|(wrong, _)| *wrong > SIGN).max_by(|(a, _), (b, _)| a.total_cmp(b));
    most.map(|(_, limit)| limit)
}
