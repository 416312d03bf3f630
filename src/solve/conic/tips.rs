//! Steps of the group lasso: a length has a kink at zero, and is no quadratic anywhere else.
//!
//! The program is convex: a method that lowers its merit with every step cannot cycle through active sets.

use super::here::Here;
use super::step::Model;
use crate::linalg::dot;
use crate::problem::Group;

/// Most halvings of a step.
const HALVINGS: i32 = 30;
/// Rise of the merit, relative to it, that may be rounding.
const ROUNDING: f64 = 1e-14;

fn part(x: &[f64], group: &Group) -> Vec<f64> {
    group.members.iter().map(|&i| x[i]).collect()
}

/// Shortens the step from `before` to `u` until the merit of the program falls, and puts groups that it carries
/// through zero there; whether it was shortened or any group put to zero.
pub fn search(model: &Model, here: &Here, before: &[f64], u: &mut [f64], zero: &mut [bool]) -> bool {
    let merit = |x: &[f64]| model.merit(&here.predict(x), x);
    let start = merit(before);
    let slack = ROUNDING * start.abs();
    let end = u.to_vec();
    for halving in 0..HALVINGS {
        let way = 0.5f64.powi(halving);
        u.iter_mut().zip(before.iter().zip(&end)).for_each(|(u, (b, e))| *u = b + way * (e - b));
        // A step through zero believed in a slope that ends there.
        let through: Vec<usize> = (0..model.groups.len())
            .filter(|&g| !zero[g] && dot(&part(before, &model.groups[g]), &part(u, &model.groups[g])) <= 0.0)
            .collect();
        for &g in &through {
            model.groups[g].members.iter().for_each(|&i| u[i] = 0.0);
        }
        if merit(u) <= start + slack {
            through.iter().for_each(|&g| zero[g] = true);
            return halving > 0 || !through.is_empty();
        }
    }
    u.copy_from_slice(before);
    false
}

/// Frees the groups at zero whose `gradient` is steeper than the penalty by more than `sign` of its `measure`; whether
/// any was. They take a proximal gradient step, all of them together no farther than the merit falls.
pub fn release(
    model: &Model,
    here: &Here,
    gradient: &[f64],
    measure: &[f64],
    sign: f64,
    zero: &mut [bool],
    u: &mut [f64],
) -> bool {
    let penalty = &model.penalty;
    let mut freed = Vec::new();
    for (g, group) in model.groups.iter().enumerate() {
        let pull = group.length(gradient);
        let tolerance = group.members.iter().map(|&i| sign * measure[i]).fold(0.0, f64::max);
        if zero[g] && pull > penalty.group + tolerance {
            // Down the steepest descent, no farther than the group's own curvature allows.
            let square: f64 = group.members.iter().map(|&i| here.jac.col(i).squared_norm_l2()).sum();
            freed.push((g, (1.0 - penalty.group / pull) / (square + penalty.ridge)));
        }
    }
    if freed.is_empty() {
        return false;
    }
    let merit = |x: &[f64]| model.merit(&here.predict(x), x);
    let start = merit(u);
    for halving in 0..HALVINGS {
        for (g, step) in &freed {
            let members = &model.groups[*g].members;
            members.iter().for_each(|&i| u[i] = -0.5f64.powi(halving) * step * gradient[i]);
        }
        if merit(u) < start {
            break;
        }
    }
    freed.iter().for_each(|(g, _)| zero[*g] = false);
    true
}
