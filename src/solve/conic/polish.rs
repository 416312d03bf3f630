//! The last digits of a conic program: Newton steps by QR on the active set that the program found.
//!
//! An interior point stops some 1e-8 of its scale away. With the active set known, what remains is a smooth
//! problem in the free coordinates; groups at their cone move along the sphere.

use super::here::{Here, Quadratic};
use super::step::Model;
use super::{kinks, tips};
use crate::linalg::{self, norm};
use faer::{Mat, MatMut};

/// Nearness to a limit or to zero, in units of the program, at which a candidate counts as there.
const NEAR: f64 = 1e-6;
/// The same for the zero of a group: a cone's tip is found less exactly, and what is held there wrongly is released.
const NEAR_TIP: f64 = 1e-4;
/// Move, relative to the point, from which on multipliers are those of the minimiser on the active set.
const CLOSE: f64 = 1e-3;
/// Move, relative to the point, after which it counts as settled.
const SETTLED: f64 = 1e-13;
/// Proximal weight, relative to the squared column norms, that keeps the factor of a deficient Jacobian regular.
const PROXIMAL: f64 = 1e-20;
/// Size of a multiplier, relative to its measure, from which its sign counts.
pub(super) const SIGN: f64 = 1e-10;

/// A direction in which the point may still move.
pub(super) struct Free {
    /// `(coordinate, component)`.
    parts: Vec<(usize, f64)>,
}

/// What is held where.
pub(super) struct ActiveSet {
    /// Coordinate at a limit, or at the zero of the lasso.
    pub(super) held: Vec<bool>,
    /// Group at the zero of the group lasso.
    zero: Vec<bool>,
    /// Group at the limit of its cone.
    pub(super) cone: Vec<bool>,
}

/// The polished point; `None` where the loss has no quadratic or the active set does not settle.
pub fn polish(
    model: &Model,
    here: &Here,
    candidate: &[f64],
    unit: &[f64],
    passes: usize,
) -> Option<Vec<f64>> {
    let mut u = candidate.to_vec();
    let mut set = guess(model, &mut u, unit);
    let mut last = f64::INFINITY;
    for _ in 0..passes {
        let quadratic = model.loss.quadratic(here, &here.predict(&u))?;
        let free = free_directions(model, &set, &u);
        let before = u.clone();
        newton(model, here, &quadratic, &free, &mut u)?;
        let cut = if model.penalty.lasso > 0.0 {
            let gradient = model.program_gradient(here, &before);
            kinks::search(model, &quadratic, &gradient, &before, &mut u, &mut set.held)
        } else {
            model.penalty.group > 0.0 && tips::search(model, here, &before, &mut u, &mut set.zero)
        };
        // A length is no quadratic: one step does not end at the minimiser on the set.
        let far = model.penalty.group > 0.0 && !close(&before, &u);
        // Multipliers belong to the minimiser on the set, before it is cut back: the primal-dual active set method.
        let freed = !cut && !far && release(model, here, &mut set, &mut u);
        let grown = cut || hold(model, &mut set, &mut u);
        let moved = u.iter().zip(&before).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        if !freed && !grown && !far && (moved <= SETTLED * norm(&u) || moved > 0.5 * last) {
            return Some(u);
        }
        last = if freed || grown || far { f64::INFINITY } else { moved };
    }
    Some(u)
}

/// Whether a step is so short that the multipliers at its end are those of the minimiser on its active set.
fn close(before: &[f64], u: &[f64]) -> bool {
    let moved: Vec<f64> = u.iter().zip(before).map(|(a, b)| a - b).collect();
    norm(&moved) <= CLOSE * norm(u)
}

pub(super) fn guess(model: &Model, u: &mut [f64], unit: &[f64]) -> ActiveSet {
    let (lower, upper) = (&model.limits.lower, &model.limits.upper);
    let mut held = vec![false; u.len()];
    // Units are large where columns are small; what is small against the point itself is another matter.
    let largest = u.iter().fold(0.0f64, |a, v| a.max(v.abs()));
    for i in 0..u.len() {
        let near = NEAR * unit[i];
        if upper[i] - u[i] <= near || u[i] - lower[i] <= near {
            u[i] = if upper[i] - u[i] <= u[i] - lower[i] { upper[i] } else { lower[i] };
            held[i] = true;
        } else if model.penalty.lasso > 0.0 && u[i].abs() <= near.min(NEAR * largest) {
            u[i] = 0.0;
            held[i] = true;
        }
    }
    let size = |i: &usize| unit[*i];
    let mut zero = vec![false; model.groups.len()];
    let mut cone = vec![false; model.groups.len()];
    for (g, group) in model.groups.iter().enumerate() {
        let reach = group.length(u);
        let near = NEAR_TIP * group.members.iter().map(size).fold(0.0, f64::max).min(largest);
        if model.penalty.group > 0.0 && reach <= near {
            group.members.iter().for_each(|&i| u[i] = 0.0);
            zero[g] = true;
        }
        cone[g] = reach >= model.limits.cone * (1.0 - NEAR);
    }
    ActiveSet { held, zero, cone }
}

pub(super) fn free_directions(model: &Model, set: &ActiveSet, u: &[f64]) -> Vec<Free> {
    let mut single: Vec<bool> = set.held.iter().map(|held| !held).collect();
    let mut free = Vec::new();
    for (g, group) in model.groups.iter().enumerate() {
        if set.zero[g] {
            group.members.iter().for_each(|&i| single[i] = false);
        } else if set.cone[g] {
            let members: Vec<usize> = group.members.iter().copied().filter(|&i| single[i]).collect();
            members.iter().for_each(|&i| single[i] = false);
            free.extend(tangents(&members, u));
        }
    }
    free.extend((0..u.len()).filter(|&i| single[i]).map(|i| Free { parts: vec![(i, 1.0)] }));
    free
}

/// Orthonormal directions along the sphere through `u` in the coordinates `members`: all columns but the first of
/// the Householder reflection that turns the first axis into `u`.
fn tangents(members: &[usize], u: &[f64]) -> Vec<Free> {
    let radius = members.iter().map(|&i| u[i] * u[i]).sum::<f64>().sqrt();
    if radius == 0.0 {
        return Vec::new();
    }
    let mut v: Vec<f64> = members.iter().map(|&i| u[i] / radius).collect();
    v[0] += 1f64.copysign(v[0]);
    let square: f64 = v.iter().map(|x| x * x).sum();
    (1..members.len())
        .map(|column| Free {
            parts: members
                .iter()
                .zip(&v)
                .enumerate()
                .map(|(row, (&i, vi))| (i, f64::from(row == column) - 2.0 * vi * v[column] / square))
                .collect(),
        })
        .collect()
}

/// One Newton step of the program in the free directions, by QR.
pub(super) fn newton(
    model: &Model,
    here: &Here,
    quadratic: &Quadratic,
    free: &[Free],
    u: &mut [f64],
) -> Option<()> {
    if free.is_empty() {
        return Some(());
    }
    let (k, f) = (quadratic.jac.nrows(), free.len());
    let (slope, bend) = curved(model, here, quadratic, u);
    let bent: Vec<usize> = (0..u.len()).filter(|&i| bend[i] > 0.0).collect();
    let moved: Vec<f64> = u.iter().zip(&here.x).map(|(u, x)| u - x).collect();
    let at = linalg::mul(quadratic.jac.as_ref(), &moved);
    let mut rows = Mat::zeros(k + bent.len() + f, f + 1);
    let mut linear = vec![0.0; f];
    for (j, direction) in free.iter().enumerate() {
        let (mut square, mut along) = (0.0, 0.0);
        for &(i, part) in &direction.parts {
            for (to, from) in rows.col_mut(j).iter_mut().zip(quadratic.jac.col(i).iter()) {
                *to += from * part;
            }
            linear[j] += slope[i] * part;
            along += u[i] * part;
        }
        for (row, &i) in bent.iter().enumerate() {
            let part = direction.parts.iter().find(|(member, _)| *member == i).map_or(0.0, |(_, part)| *part);
            rows[(k + row, j)] = bend[i].sqrt() * part;
        }
        for value in rows.col(j).iter().take(k) {
            square += value * value;
        }
        // The directions are orthonormal, so that the ridge is diagonal in them.
        let ridge = model.penalty.ridge;
        let diagonal = (ridge + PROXIMAL * square).max(f64::MIN_POSITIVE).sqrt();
        rows[(k + bent.len() + j, j)] = diagonal;
        rows[(k + bent.len() + j, f)] = ridge * along / diagonal;
    }
    flatten_along(model, u, &bent, rows.as_mut().submatrix_mut(k, 0, bent.len(), f));
    for row in 0..k {
        rows[(row, f)] = at[row] + quadratic.r[row];
    }
    if !rows.is_all_finite() {
        return None;
    }
    let factor = linalg::upper_factor(rows.as_mut());
    // R'R t = -(A'b + linear): the linear part through R twice, the rest through Q.
    linalg::solve_upper_transpose(&factor, &mut linear)?;
    let mut t: Vec<f64> = (0..f).map(|i| -factor[(i, f)] - linear[i]).collect();
    linalg::solve_upper(&factor, &mut t)?;
    for (direction, t) in free.iter().zip(&t) {
        for &(i, part) in &direction.parts {
            u[i] += part * t;
        }
    }
    Some(())
}

/// Slope of everything that is not a square, and `weight / length` of every group's penalty and cone.
fn curved(model: &Model, here: &Here, quadratic: &Quadratic, u: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let mut slope = quadratic.linear.clone();
    let mut bend = vec![0.0; u.len()];
    if model.penalty.lasso > 0.0 {
        for (s, u) in slope.iter_mut().zip(u) {
            *s += if *u == 0.0 { 0.0 } else { model.penalty.lasso.copysign(*u) };
        }
    }
    let multipliers = model.program_stationarity(here, u).cones;
    for (g, group) in model.groups.iter().enumerate() {
        let size = group.length(u);
        if size == 0.0 {
            continue;
        }
        let cone = multipliers.iter().find(|(index, _)| *index == g).map_or(0.0, |(_, m)| *m);
        for &i in &group.members {
            slope[i] += model.penalty.group * u[i] / size;
            bend[i] = (model.penalty.group + cone) / size;
        }
    }
    (slope, bend)
}

/// Takes from the bend of every group what lies along the group itself: a length is straight along its own ray.
fn flatten_along(model: &Model, u: &[f64], bent: &[usize], mut rows: MatMut<'_, f64>) {
    for group in model.groups {
        let size = group.length(u);
        let members: Vec<(usize, f64)> = (0..bent.len())
            .filter(|&row| group.members.contains(&bent[row]))
            .map(|row| (row, u[bent[row]] / size))
            .collect();
        if members.is_empty() {
            continue;
        }
        for j in 0..rows.ncols() {
            let along: f64 = members.iter().map(|&(row, unit)| unit * rows[(row, j)]).sum();
            members.iter().for_each(|&(row, unit)| rows[(row, j)] -= unit * along);
        }
    }
}

/// Holds what the step carried across a limit; whether anything was.
fn hold(model: &Model, set: &mut ActiveSet, u: &mut [f64]) -> bool {
    let mut grown = false;
    for (i, u) in u.iter_mut().enumerate() {
        let (lower, upper) = (model.limits.lower[i], model.limits.upper[i]);
        if *u > upper || *u < lower {
            *u = u.max(lower).min(upper);
            grown |= !set.held[i];
            set.held[i] = true;
        }
    }
    for (g, group) in model.groups.iter().enumerate() {
        if set.cone[g] || group.length(u) > model.limits.cone {
            grown |= !set.cone[g];
            set.cone[g] = true;
            model.limits.onto_cone(u, group, |i, _| set.held[i]);
        }
    }
    grown
}

/// Frees what its multiplier does not hold; whether anything was.
fn release(model: &Model, here: &Here, set: &mut ActiveSet, u: &mut [f64]) -> bool {
    let gradient = model.program_gradient(here, u);
    let measure = model.program_measure(here, u);
    let stationarity = model.program_stationarity(here, u);
    let mut freed = false;
    for i in 0..u.len() {
        let fixed = model.limits.lower[i] == model.limits.upper[i];
        if !set.held[i] || fixed || stationarity.bounds.iter().any(|(j, _, _)| *j == i) {
            continue;
        }
        let g = gradient[i] + model.penalty.ridge * u[i];
        let slack = if model.penalty.lasso > 0.0 && u[i] == 0.0 { model.penalty.lasso } else { 0.0 };
        if g.abs() > slack + SIGN * measure[i] {
            set.held[i] = false;
            freed = true;
            if u[i] == 0.0 {
                // Enough of a sign for the slope of the lasso, too little to matter.
                u[i] = -f64::MIN_POSITIVE.sqrt().copysign(g);
            }
        }
    }
    freed |=
        model.penalty.group > 0.0 && tips::release(model, here, &gradient, &measure, SIGN, &mut set.zero, u);
    for g in 0..model.groups.len() {
        if set.cone[g] && stationarity.cones.iter().any(|(index, m)| *index == g && *m == 0.0) {
            set.cone[g] = false;
            freed = true;
        }
    }
    freed
}
