//! How far a Newton step of the lasso may go: to the least of the merit along it, kinks and limits included.

use super::here::Quadratic;
use super::step::Model;
use crate::linalg;

/// Replaces the end `u` of the step from `before` by the point of least merit on the way, and holds the coordinate
/// whose zero or limit lies there; whether the step ended at such a one.
///
/// `gradient` is that of the loss at `before`. Coordinates that pass zero earlier change their sign: the merit falls
/// all the way, however many do.
pub fn search(
    model: &Model,
    quadratic: &Quadratic,
    gradient: &[f64],
    before: &[f64],
    u: &mut [f64],
    held: &mut [bool],
) -> bool {
    let penalty = &model.penalty;
    let step: Vec<f64> = u.iter().zip(before).map(|(u, b)| u - b).collect();
    let sign = |b: f64| if b == 0.0 { 0.0 } else { 1f64.copysign(b) };
    let mut slope: f64 = (0..step.len())
        .map(|i| (gradient[i] + penalty.ridge * before[i] + penalty.lasso * sign(before[i])) * step[i])
        .sum();
    let bent = linalg::norm(&linalg::mul(quadratic.jac.as_ref(), &step)).powi(2);
    let curvature = bent + penalty.ridge * linalg::norm(&step).powi(2);
    // Where on the way, which coordinate, and where it stands there.
    let mut stops: Vec<(f64, usize, f64)> = Vec::new();
    for i in (0..step.len()).filter(|&i| step[i] != 0.0) {
        let limit = if step[i] > 0.0 { model.limits.upper[i] } else { model.limits.lower[i] };
        for value in [0.0, limit] {
            let way = (value - before[i]) / step[i];
            if value.is_finite() && way > 0.0 {
                stops.push((way, i, value));
            }
        }
    }
    stops.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut end = (-slope / curvature, None);
    for (way, i, value) in stops {
        if slope + curvature * way >= 0.0 {
            break;
        }
        let at_limit = value == model.limits.upper[i] || value == model.limits.lower[i];
        slope += 2.0 * penalty.lasso * step[i].abs();
        if at_limit || slope + curvature * way >= 0.0 {
            end = (way, Some((i, value)));
            break;
        }
        end = (-slope / curvature, None);
    }
    let way = if end.0.is_finite() { end.0.max(0.0) } else { 1.0 };
    for ((u, b), s) in u.iter_mut().zip(before).zip(&step) {
        *u = b + way * s;
    }
    if let (_, Some((i, value))) = end {
        u[i] = value;
        held[i] = true;
    }
    end.1.is_some()
}
