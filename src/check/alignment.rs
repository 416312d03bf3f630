//! Base and tool where predicted and observed postures agree best, in closed form with a few steps of Gauss-Newton
//! where that is blunt: what ranks thousands of hypotheses. What is named is fitted in [`super::fit`].

use super::observed::{Observed, Seen};
use crate::identify::hand_eye::{self, Pair};
use crate::identify::registration::FreeEnds;
use crate::lie::{Se3, so3};
use crate::statistics::median;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// Part of the postures that must close.
pub(super) const CLOSED: f64 = 0.6;
/// Postures below which nothing is aligned.
const FEWEST: usize = 4;
/// [`sharpness`] below which rotations alone do not tell where the base stands.
const BLUNT: f64 = 0.02;
/// Steps of Gauss-Newton.
const STEPS: usize = 6;
/// Pull, in parts of the normal matrix, towards what is there along what the postures do not see.
const PULL: f64 = 1e-7;

/// Errors of a posture in parts of the scales: rotation, position.
pub(super) type Error = [f64; 6];

/// How well predicted postures agree with observed ones.
#[derive(Clone, Debug)]
pub(super) struct Alignment {
    /// Of each posture that closes and was observed: its index and its errors.
    pub errors: Vec<(usize, Error)>,
    /// Median error in parts of the spread: 1 where nothing is explained.
    pub misfit: f64,
    /// Base and tool, what is put in front of the drawing and behind it.
    pub ends: (Se3, Se3),
}

impl Alignment {
    /// Root mean square error.
    pub fn rms(&self) -> f64 {
        let square: f64 = self.errors.iter().flat_map(|(_, e)| e).map(|v| v * v).sum();
        (square / self.errors.len().max(1) as f64).sqrt()
    }
}

/// Aligns predictions with what was observed, `free` ends moved; `None` where too few postures close.
pub(super) fn align(predicted: &[Option<Se3>], observed: &Observed, free: FreeEnds) -> Option<Alignment> {
    let free = FreeEnds { tool: free.tool || observed.loose, ..free };
    let [length, angle] = observed.scale;
    let (known, ends, errors) = match &observed.seen {
        Seen::Poses(poses) => {
            let both = predicted.iter().zip(poses).enumerate();
            let (which, pairs): (Vec<usize>, Vec<Pair>) =
                both.filter_map(|(k, (g, m))| Some((k, ((*g)?, (*m)?)))).unzip();
            if !enough(pairs.len(), poses.iter().flatten().count()) {
                return None;
            }
            let (base, tool) = of_poses(&pairs, free, length)?;
            let error = |(k, (g, m)): (&usize, &Pair)| {
                let (w, v) = difference(&(base * *g * tool), m);
                (*k, [w.x / angle, w.y / angle, w.z / angle, v.x / length, v.y / length, v.z / length])
            };
            (2.0, (base, tool), which.iter().zip(&pairs).map(error).collect::<Vec<_>>())
        }
        Seen::Points(points, at) => {
            let both = predicted.iter().zip(points).enumerate();
            let pairs: Vec<(usize, Se3, Vector3<f64>)> =
                both.filter_map(|(k, (g, m))| Some((k, (*g)?, (*m)?))).collect();
            if !enough(pairs.len(), points.iter().flatten().count()) {
                return None;
            }
            let drawn = *at;
            let (base, at) = of_points(&pairs, drawn, free)?;
            let error = |(k, g, m): &(usize, Se3, Vector3<f64>)| {
                let v = (base.r * (g.r * at + g.p) + base.p - m) / length;
                (*k, [0.0, 0.0, 0.0, v.x, v.y, v.z])
            };
            let tool = Se3 { p: at - drawn, ..Se3::identity() };
            (1.0, (base, tool), pairs.iter().map(error).collect())
        }
    };
    let part = |from: usize| {
        let sizes = errors.iter().map(|(_, e)| e[from..from + 3].iter().map(|v| v * v).sum::<f64>().sqrt());
        median(sizes).unwrap_or(0.0)
    };
    let misfit = ((part(0).powi(2) + part(3).powi(2)) / known).sqrt();
    misfit.is_finite().then_some(Alignment { errors, misfit, ends })
}

fn enough(closed: usize, observed: usize) -> bool {
    closed >= FEWEST && closed as f64 >= CLOSED * observed as f64
}

fn difference(to: &Se3, from: &Se3) -> (Vector3<f64>, Vector3<f64>) {
    (so3::log(&(to.r * from.r.transpose())), to.p - from.p)
}

fn mean(values: impl Iterator<Item = Vector3<f64>>, count: usize) -> Vector3<f64> {
    values.sum::<Vector3<f64>>() / count.max(1) as f64
}

/// Base `X` and tool `Y` of `m = X g Y`.
fn of_poses(pairs: &[Pair], free: FreeEnds, length: f64) -> Option<(Se3, Se3)> {
    let n = pairs.len();
    let mut blunt = false;
    let x = if free.base && free.tool {
        let mut sum = hand_eye::relative_turns(pairs);
        blunt = so3::nearest(&sum)?.sharpness < BLUNT || sum.norm() < 1e-3 * n as f64;
        if blunt {
            // Shifts tell what turns do not: they are those of the base where the tool hardly turns.
            let (g0, m0) = (mean(pairs.iter().map(|(g, _)| g.p), n), mean(pairs.iter().map(|(_, m)| m.p), n));
            let shifts: Matrix3<f64> = pairs.iter().map(|(g, m)| (m.p - m0) * (g.p - g0).transpose()).sum();
            sum += shifts / (length * length);
        }
        so3::nearest(&sum)?.rotation
    } else if free.base {
        so3::nearest(&hand_eye::turns(pairs))?.rotation
    } else {
        Matrix3::identity()
    };
    let y = match free.tool {
        true => so3::nearest(&hand_eye::tool_turns(pairs, &x))?.rotation,
        false => Matrix3::identity(),
    };
    let (place, offset) = hand_eye::shifts(pairs, &x, (free.base, free.tool), PULL.sqrt())?;
    let (mut base, mut tool) = (Se3 { r: x, p: place }, Se3 { r: y, p: offset });
    if blunt {
        (base, tool) = settled(pairs, base, tool, length);
    }
    (base.is_finite() && tool.is_finite()).then_some((base, tool))
}

/// Gauss-Newton on base and tool.
fn settled(pairs: &[Pair], mut base: Se3, mut tool: Se3, length: f64) -> (Se3, Se3) {
    let centre = mean(pairs.iter().map(|(_, m)| m.p), pairs.len());
    let cost = |base: &Se3, tool: &Se3| -> f64 {
        let error = |(g, m): &Pair| {
            let (w, v) = difference(&(*base * *g * *tool), m);
            w.norm_squared() + v.norm_squared() / (length * length)
        };
        pairs.iter().map(error).sum()
    };
    let mut least = cost(&base, &tool);
    for _ in 0..STEPS {
        let mut normal = SMatrix::<f64, 12, 12>::zeros();
        let mut right = SVector::<f64, 12>::zeros();
        for (g, m) in pairs {
            let at = base * *g * tool;
            let (w, v) = difference(&at, m);
            let mut jac = SMatrix::<f64, 6, 12>::zeros();
            jac.fixed_view_mut::<3, 3>(0, 0).copy_from(&Matrix3::identity());
            jac.fixed_view_mut::<3, 3>(3, 0).copy_from(&(-so3::hat(&(at.p - centre)) / length));
            jac.fixed_view_mut::<3, 3>(3, 3).copy_from(&Matrix3::identity());
            jac.fixed_view_mut::<3, 3>(0, 6).copy_from(&at.r);
            jac.fixed_view_mut::<3, 3>(3, 9).copy_from(&at.r);
            let mut error = SVector::<f64, 6>::zeros();
            error.fixed_rows_mut::<3>(0).copy_from(&w);
            error.fixed_rows_mut::<3>(3).copy_from(&(v / length));
            normal += jac.tr_mul(&jac);
            right -= jac.tr_mul(&error);
        }
        let pull = PULL * pairs.len() as f64;
        (0..12).for_each(|i| normal[(i, i)] += pull);
        let Some(factor) = normal.cholesky() else { break };
        let step = factor.solve(&right);
        let part = |k: usize| step.fixed_rows::<3>(k).into_owned();
        let turn = so3::exp(&part(0));
        let next_base = Se3 { r: turn * base.r, p: turn * (base.p - centre) + centre + part(3) * length };
        let next_tool = Se3 { r: tool.r * so3::exp(&part(6)), p: tool.p + tool.r * part(9) * length };
        let next = cost(&next_base, &next_tool);
        if next.is_nan() || next >= least {
            break;
        }
        (base, tool, least) = (next_base, next_tool, next);
    }
    (base, tool)
}

/// Base `X` and point `o` of `m = X g o`.
fn of_points(
    pairs: &[(usize, Se3, Vector3<f64>)],
    mut at: Vector3<f64>,
    free: FreeEnds,
) -> Option<(Se3, Vector3<f64>)> {
    let n = pairs.len();
    let mut base = Se3::identity();
    if free.base {
        base = onto(pairs, &at)?;
    }
    if free.tool {
        for _ in 0..2 * STEPS {
            let (step, moved) = point_step(pairs, &base, &at, free.base)?;
            at += step;
            base = moved;
            if step.norm() <= 1e-9 * (at.norm() + f64::MIN_POSITIVE) {
                break;
            }
        }
        if free.base {
            base = onto(pairs, &at)?;
        }
    }
    (n > 0 && base.is_finite() && at.iter().all(|v| v.is_finite())).then_some((base, at))
}

/// The base that brings the predicted places of the point to the observed ones.
fn onto(pairs: &[(usize, Se3, Vector3<f64>)], at: &Vector3<f64>) -> Option<Se3> {
    let n = pairs.len();
    let place = |g: &Se3| g.r * at + g.p;
    let from = mean(pairs.iter().map(|(_, g, _)| place(g)), n);
    let to = mean(pairs.iter().map(|(_, _, m)| *m), n);
    let sum = pairs.iter().map(|(_, g, m)| (m - to) * (place(g) - from).transpose()).sum();
    let r = so3::nearest(&sum)?.rotation;
    Some(Se3 { r, p: to - r * from })
}

/// A step of Gauss-Newton on the point and, where it is free, the base.
fn point_step(
    pairs: &[(usize, Se3, Vector3<f64>)],
    base: &Se3,
    at: &Vector3<f64>,
    base_is_free: bool,
) -> Option<(Vector3<f64>, Se3)> {
    let centre = mean(pairs.iter().map(|(_, _, m)| *m), pairs.len());
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    let mut right = SVector::<f64, 9>::zeros();
    // Arms of about this length make turns comparable to shifts.
    let length = mean(pairs.iter().map(|(_, _, m)| (m - centre).abs()), pairs.len()).norm().max(1e-9);
    for (_, g, m) in pairs {
        let place = base.r * (g.r * at + g.p) + base.p;
        let mut jac = SMatrix::<f64, 3, 9>::zeros();
        jac.fixed_view_mut::<3, 3>(0, 0).copy_from(&(base.r * g.r));
        if base_is_free {
            jac.fixed_view_mut::<3, 3>(0, 3).copy_from(&(-so3::hat(&(place - centre)) / length));
            jac.fixed_view_mut::<3, 3>(0, 6).copy_from(&Matrix3::identity());
        }
        normal += jac.tr_mul(&jac);
        right -= jac.tr_mul(&(place - m));
    }
    (0..9).for_each(|i| normal[(i, i)] += 1e-4 * PULL * pairs.len() as f64 + f64::MIN_POSITIVE);
    let step = normal.cholesky()?.solve(&right);
    let part = |k: usize| step.fixed_rows::<3>(k).into_owned();
    let turn = so3::exp(&(part(3) / length));
    let moved = Se3 { r: turn * base.r, p: turn * (base.p - centre) + centre + part(6) };
    Some((part(0), if base_is_free { moved } else { *base }))
}
