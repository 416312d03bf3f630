//! Base, tool and targets from measured positions: `m_k = X g_k Y o_k` over predicted tool poses `g_k`, with the base `X`,
//! the tool `Y` and the offsets `o` of targets unknown, or some of them.
//!
//! With `X`'s rotation given the rest is nearly linear, but for the rotation of `Y`, which the mean positions of three known
//! targets then give. So Gauss-Newton starts from the rotation that explains best how positions follow the predicted motions,
//! and from the 24 rotations that map a cube to itself, of which one lies within 63 degrees of any rotation; the best end
//! is taken.

use super::ends::stride;
use super::registration::{FreeEnds, Sighting, Stand};
use crate::lie::{Se3, se3, so3};
use crate::measure::{Clue, Point};
use crate::model::{Mechanism, Prior};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use std::f64::consts::FRAC_PI_2;

/// Most rounds of a decomposition: without a limit one of numbers that are not finite never ends.
const ROUNDS: usize = 1000;

/// Positions from which starts are tried.
const TRIED: usize = 60;
const ITERATIONS: usize = 40;
/// Most rounds of a factorisation.
const FACTORED: usize = 1000;
/// Relative size of an eigenvalue of the normal matrix below which its direction is left alone.
const RANK: f64 = 1e-10;

/// Sharpness below which the mean positions of targets do not give the tool's rotation: they lie on a line.
const ON_A_LINE: f64 = 1e-4;
/// Most targets whose motions are compared.
const MOST_TARGETS: usize = 20;
/// Singular value, relative to the largest, below which positions do not tell how they follow a motion.
const FOLLOWED: f64 = 1e-6;

/// A predicted tool pose, the target and where it was measured.
struct Seen {
    tool: Se3,
    target: Point,
    at: Vector3<f64>,
}

/// What is unknown.
#[derive(Clone)]
struct Unknowns {
    free: FreeEnds,
    /// First constants of the free targets.
    targets: Vec<usize>,
    base: Se3,
    tool: Se3,
    /// Values of the instrument's constants.
    instrument: Vec<f64>,
}

impl Unknowns {
    fn stand(&self) -> Stand {
        Stand { base: self.base, tool: self.tool, instrument: self.instrument.clone() }
    }

    fn count(&self) -> usize {
        6 * (usize::from(self.free.base) + usize::from(self.free.tool)) + 3 * self.targets.len()
    }

    fn error(&self, seen: &Seen) -> Vector3<f64> {
        let offset = self.tool.r * seen.target.at(&self.instrument) + self.tool.p;
        self.base.r * (seen.tool.r * offset + seen.tool.p) + self.base.p - seen.at
    }

    fn cost(&self, seen: &[Seen]) -> f64 {
        seen.iter().map(|s| self.error(s).norm_squared()).sum()
    }

    /// The normal equations of one Gauss-Newton step.
    fn normal(&self, seen: &[Seen]) -> (DMatrix<f64>, DVector<f64>) {
        let n = self.count();
        let (mut matrix, mut right) = (DMatrix::zeros(n, n), DVector::zeros(n));
        for s in seen {
            let offset = s.target.at(&self.instrument);
            let turned = self.base.r * s.tool.r * self.tool.r;
            let error = self.error(s);
            let mut jac = DMatrix::zeros(3, n);
            let mut column = 0;
            if self.free.base {
                let moved = error + s.at - self.base.p;
                jac.view_mut((0, 0), (3, 3)).copy_from(&-so3::hat(&moved));
                jac.view_mut((0, 3), (3, 3)).copy_from(&Matrix3::identity());
                column += 6;
            }
            if self.free.tool {
                jac.view_mut((0, column), (3, 3)).copy_from(&(turned * -so3::hat(&offset)));
                jac.view_mut((0, column + 3), (3, 3)).copy_from(&turned);
                column += 6;
            }
            if let Some(k) = self.targets.iter().position(|first| s.target.constants == Some(*first)) {
                jac.view_mut((0, column + 3 * k), (3, 3)).copy_from(&turned);
            }
            matrix += jac.tr_mul(&jac);
            right -= jac.tr_mul(&error);
        }
        (matrix, right)
    }

    /// Moved by a step: base on the left about its own origin, tool on the right.
    fn moved(&self, step: &DVector<f64>) -> Self {
        let mut next = self.clone();
        let mut at = 0;
        let mut take = || {
            at += 3;
            Vector3::new(step[at - 3], step[at - 2], step[at - 1])
        };
        if self.free.base {
            next.base.r = so3::exp(&take()) * self.base.r;
            next.base.p += take();
        }
        if self.free.tool {
            let (w, v) = (take(), take());
            next.tool = self.tool * se3::exp(&se3::Twist::new(w.x, w.y, w.z, v.x, v.y, v.z));
        }
        for &first in &self.targets {
            let by = take();
            next.instrument[first..first + 3].iter_mut().zip(by.iter()).for_each(|(o, v)| *o += v);
        }
        next
    }

    /// Gauss-Newton with halved steps; directions that the positions do not see are left alone.
    fn settled(mut self, seen: &[Seen]) -> (f64, Self) {
        let mut cost = self.cost(seen);
        for _ in 0..ITERATIONS {
            let (matrix, right) = self.normal(seen);
            let Some(svd) = matrix.try_svd(true, true, f64::EPSILON, FACTORED) else { break };
            let largest = svd.singular_values.max();
            let Ok(step) = svd.solve(&right, RANK * largest) else { break };
            let mut fraction = 1.0;
            let better = loop {
                let next = self.moved(&(&step * fraction));
                let next_cost = next.cost(seen);
                if next_cost < cost {
                    break Some((next, next_cost));
                }
                fraction *= 0.5;
                if fraction < 1e-3 {
                    break None;
                }
            };
            let Some((next, next_cost)) = better else { break };
            let gain = 1.0 - next_cost / cost;
            (self, cost) = (next, next_cost);
            if gain < 1e-9 {
                break;
            }
        }
        (cost, self)
    }
}

/// First constants of the targets that are measured and unknown.
fn unknown_targets<'a>(mechanism: &Mechanism, targets: impl Iterator<Item = &'a Point>) -> Vec<usize> {
    let is_free = |k: &usize| mechanism.instrument.get(*k).is_some_and(|c| c.prior == Prior::Free);
    let mut firsts: Vec<usize> = targets.filter_map(|target| target.constants).filter(is_free).collect();
    firsts.sort_unstable();
    firsts.dedup();
    firsts
}

/// Constants of the instrument that place a measured target and are unknown.
pub(super) fn free_targets(mechanism: &Mechanism, sightings: &[Sighting]) -> Vec<usize> {
    let targets = sightings.iter().filter_map(|s| match &s.clue {
        Clue::Position { target, .. } => Some(target),
        _ => None,
    });
    unknown_targets(mechanism, targets).into_iter().flat_map(|first| first..first + 3).collect()
}

/// Base, tool and free targets where the positions say that they are; `None` where the positions do not determine the
/// base.
pub(super) fn place_targets(mechanism: &Mechanism, sightings: &[Sighting], free: FreeEnds) -> Option<Stand> {
    let seen: Vec<Seen> = sightings
        .iter()
        .filter_map(|s| match s.clue {
            Clue::Position { target, at } => Some(Seen { tool: s.tool, target, at }),
            _ => None,
        })
        .collect();
    let start = Unknowns {
        free,
        targets: unknown_targets(mechanism, seen.iter().map(|s| &s.target)),
        base: Se3::identity(),
        tool: Se3::identity(),
        instrument: mechanism.nominal().instrument,
    };
    if start.count() == 0 {
        return Some(start.stand());
    }
    if seen.len() < 3 {
        return None;
    }
    let few: Vec<Seen> = seen
        .iter()
        .step_by(stride(seen.len(), TRIED))
        .map(|s| Seen { tool: s.tool, target: s.target, at: s.at })
        .collect();
    let mut best: Option<(f64, Unknowns)> = None;
    let mut turns = Vec::new();
    if free.base {
        turns.extend(following(&seen));
        turns.extend(cube_rotations());
    } else {
        turns.push(Matrix3::identity());
    }
    for turn in turns {
        let mut from = start.clone();
        from.base.r = turn;
        if free.tool {
            from.tool.r = tool_rotation(&from, &few).unwrap_or(from.tool.r);
        }
        if free.base {
            let gap: Vector3<f64> = few.iter().map(|s| from.error(s)).sum();
            from.base.p -= gap / few.len() as f64;
        }
        let found = from.settled(&few);
        // Strictly better, so that equal ends keep the order of the starts.
        if best.as_ref().is_none_or(|(cost, _)| found.0 < *cost * (1.0 - 1e-6)) {
            best = Some(found);
        }
    }
    let (_, found) = best?.1.settled(&seen);
    (!free.base || spans(&found, &seen)).then(|| found.stand())
}

/// What tells targets apart: their constants, or their place.
type TargetKey = (Option<usize>, [u64; 3]);

fn key(target: &Point) -> TargetKey {
    (target.constants, [0, 1, 2].map(|i| target.nominal[i].to_bits()))
}

/// What was seen of each target; `None` where they are too many.
fn by_target(seen: &[Seen]) -> Option<Vec<Vec<&Seen>>> {
    let mut all: Vec<(TargetKey, Vec<&Seen>)> = Vec::new();
    for s in seen {
        let (own, full) = (key(&s.target), all.len() == MOST_TARGETS);
        match all.iter_mut().find(|(other, _)| *other == own) {
            Some((_, list)) => list.push(s),
            None if full => return None,
            None => all.push((own, vec![s])),
        }
    }
    Some(all.into_iter().map(|(_, list)| list).collect())
}

fn mean(of: &[&Seen], value: impl Fn(&Seen) -> Vector3<f64>) -> Vector3<f64> {
    of.iter().map(|s| value(s)).sum::<Vector3<f64>>() / of.len().max(1) as f64
}

/// The tool's rotation by the mean positions of known targets, the base's rotation given; `None` where these lie on a line.
fn tool_rotation(at: &Unknowns, seen: &[Seen]) -> Option<Matrix3<f64>> {
    let turned = at.base.r * so3::nearest(&seen.iter().map(|s| s.tool.r).sum())?.rotation;
    let targets = by_target(seen)?;
    let place = |own: &Vec<&Seen>| (mean(own, |s| s.target.at(&at.instrument)), mean(own, |s| s.at));
    let places: Vec<(Vector3<f64>, Vector3<f64>)> = targets.iter().map(place).collect();
    let count = places.len() as f64;
    let drawn = places.iter().map(|(o, _)| o).sum::<Vector3<f64>>() / count;
    let measured = places.iter().map(|(_, m)| m).sum::<Vector3<f64>>() / count;
    let sum = places.iter().map(|(o, m)| turned.tr_mul(&(m - measured)) * (o - drawn).transpose()).sum();
    so3::nearest(&sum).filter(|near| near.sharpness > ON_A_LINE).map(|near| near.rotation)
}

/// The base's rotation by how positions follow predicted motions: of a target, `dm = X dp + B dw` about its mean, with `B`
/// its own where offsets are unknown; linear least squares, and the rotation nearest to what stands for `X`.
fn following(seen: &[Seen]) -> Option<Matrix3<f64>> {
    let targets = by_target(seen)?;
    let columns = 3 + 3 * targets.len();
    let mean_turn = so3::nearest(&seen.iter().map(|s| s.tool.r).sum())?.rotation;
    // Turns are scaled to lengths: by the size of the motion.
    let centre = mean(&seen.iter().collect::<Vec<_>>(), |s| s.tool.p);
    let turn = |s: &Seen| so3::log(&(s.tool.r * mean_turn.transpose()));
    let (mut lengths, mut angles) = (0.0, 0.0);
    for s in seen {
        lengths += (s.tool.p - centre).norm_squared();
        angles += turn(s).norm_squared();
    }
    let scale = if angles > 0.0 { (lengths / angles).sqrt() } else { 0.0 };
    let (mut normal, mut right) = (DMatrix::zeros(columns, columns), DMatrix::zeros(columns, 3));
    for (k, own) in targets.iter().enumerate() {
        let (p0, w0, m0) = (mean(own, |s| s.tool.p), mean(own, turn), mean(own, |s| s.at));
        for s in own {
            let mut row = DVector::zeros(columns);
            row.fixed_rows_mut::<3>(0).copy_from(&(s.tool.p - p0));
            row.fixed_rows_mut::<3>(3 + 3 * k).copy_from(&((turn(s) - w0) * scale));
            normal.ger(1.0, &row, &row, 1.0);
            right += &row * (s.at - m0).transpose();
        }
    }
    let svd = normal.try_svd(true, true, f64::EPSILON, FACTORED)?;
    let solved = svd.solve(&right, FOLLOWED * FOLLOWED * svd.singular_values.max()).ok()?;
    let by_shift: Matrix3<f64> = solved.fixed_view::<3, 3>(0, 0).transpose();
    so3::nearest(&by_shift).filter(|near| near.sharpness > ON_A_LINE).map(|near| near.rotation)
}

/// Whether the points, as predicted, do not lie on one line: only then they determine a rotation.
fn spans(found: &Unknowns, seen: &[Seen]) -> bool {
    let points: Vec<Vector3<f64>> = seen.iter().map(|s| found.error(s) + s.at).collect();
    let centre = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let spread: Matrix3<f64> = points.iter().map(|p| (p - centre) * (p - centre).transpose()).sum();
    let Some(eigen) = spread.try_symmetric_eigen(f64::EPSILON, ROUNDS) else { return false };
    let mut s: [f64; 3] = eigen.eigenvalues.into();
    s.sort_by(f64::total_cmp);
    s[1] > 1e-12 * s[2] && s[2] > 0.0
}

/// The 24 rotations that map a cube to itself.
fn cube_rotations() -> Vec<Matrix3<f64>> {
    let quarter = |axis: Vector3<f64>, times: i32| so3::exp(&(axis * (FRAC_PI_2 * f64::from(times))));
    let faces = [
        Matrix3::identity(),
        quarter(Vector3::x(), 1),
        quarter(Vector3::x(), 2),
        quarter(Vector3::x(), 3),
        quarter(Vector3::y(), 1),
        quarter(Vector3::y(), 3),
    ];
    faces.iter().flat_map(|face| (0..4).map(move |k| face * quarter(Vector3::z(), k))).collect()
}
