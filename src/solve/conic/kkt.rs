//! The Karush-Kuhn-Tucker conditions of the nonlinear problem, from its own gradient: the solver is not asked.

use super::limits::Limits;
use super::penalty::Penalty;
use crate::problem::Group;

/// Smallest column of the Jacobian, relative to the largest, against which a gradient is measured.
const COLUMN: f64 = 1e-8;

/// Stationarity of a point, and the limits that carry it.
#[derive(Clone, Debug)]
pub struct Stationarity {
    /// Largest component of the Lagrangian's gradient, relative to the terms it is the sum of.
    pub residual: f64,
    /// Multiplier and limit of every coordinate at its bound.
    pub bounds: Vec<(usize, f64, f64)>,
    /// Multiplier of every group at the limit of its cone.
    pub cones: Vec<(usize, f64)>,
}

/// What a gradient is measured against: column norms of the Jacobian times the size of the loss's influence.
pub fn measure(columns: &[f64], influence: f64, penalty: &Penalty, x: &[f64]) -> Vec<f64> {
    let largest = columns.iter().fold(0.0f64, |a, v| a.max(*v));
    columns
        .iter()
        .zip(x)
        .map(|(c, x)| {
            let terms =
                c.max(COLUMN * largest) * influence + penalty.ridge * x.abs() + penalty.lasso + penalty.group;
            if terms > 0.0 { terms } else { 1.0 }
        })
        .collect()
}

/// Checks the conditions at `x`, where the loss has `gradient`; `measure` is from [`measure`].
pub fn stationarity(
    gradient: &[f64],
    measure: &[f64],
    x: &[f64],
    penalty: &Penalty,
    limits: &Limits,
    groups: &[Group],
) -> Stationarity {
    let mut g = lagrangian(gradient, x, penalty, groups);
    let at_bound = |i: usize| x[i] >= limits.upper[i] || x[i] <= limits.lower[i];
    let mut cones = Vec::new();
    for (index, group) in groups.iter().enumerate() {
        if !limits.reaches_cone(group.length(x)) {
            continue;
        }
        let (mut along, mut square) = (0.0, 0.0);
        for &i in group.members.iter().filter(|&&i| !at_bound(i)) {
            along += x[i] * g[i];
            square += x[i] * x[i];
        }
        if square > 0.0 {
            let multiplier = (-along / square).max(0.0);
            group.members.iter().for_each(|&i| g[i] += multiplier * x[i]);
            cones.push((index, multiplier * limits.cone));
        }
    }
    let mut bounds = Vec::new();
    let mut residual = 0.0f64;
    for i in 0..x.len() {
        let (upper, lower) = (x[i] >= limits.upper[i], x[i] <= limits.lower[i]);
        if (upper && g[i] <= 0.0) || (lower && g[i] >= 0.0) {
            bounds.push((i, x[i], g[i].abs()));
        } else {
            residual = residual.max(g[i].abs() / measure[i]);
        }
    }
    Stationarity { residual, bounds, cones }
}

/// The gradient with the penalties' subgradients of least magnitude.
fn lagrangian(gradient: &[f64], x: &[f64], penalty: &Penalty, groups: &[Group]) -> Vec<f64> {
    let mut g: Vec<f64> = gradient.iter().zip(x).map(|(g, x)| g + penalty.ridge * x).collect();
    if penalty.lasso > 0.0 {
        for (g, x) in g.iter_mut().zip(x) {
            *g = if *x == 0.0 {
                g.signum() * (g.abs() - penalty.lasso).max(0.0)
            } else {
                *g + penalty.lasso.copysign(*x)
            };
        }
    }
    if penalty.group > 0.0 {
        for group in groups {
            let size = group.length(x);
            let pull = group.members.iter().map(|&i| g[i] * g[i]).sum::<f64>().sqrt();
            for &i in &group.members {
                if size > 0.0 {
                    g[i] += penalty.group * x[i] / size;
                } else {
                    g[i] *= if pull > penalty.group { 1.0 - penalty.group / pull } else { 0.0 };
                }
            }
        }
    }
    g
}
