//! Fixed points, gauges and planes of which nothing is known, from the tool poses that the drawing predicts.
//!
//! A fixed point by multilateration: differences of squared distances are linear in it. A plane by the direction in which
//! the touched points spread least.

use super::registration::Sighting;
use crate::measure::{Clue, Gauge, Plane, Point};
use crate::model::{Constant, Mechanism, Prior};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// Most rounds of a decomposition: without a limit one of numbers that are not finite never ends.
const ROUNDS: usize = 1000;

const ITERATIONS: usize = 30;
/// Relative singular value below which distances do not determine a direction.
const RANK: f64 = 1e-4;

/// Where a target was predicted, m, and what was read there, m.
type Seen = (Vector3<f64>, f64);

/// Moves the instrument's free fixed points, zeros and planes to where the readings say that they are. What they do not
/// determine stays as drawn.
pub(super) fn place_references(mechanism: &mut Mechanism, sightings: &[Sighting]) {
    let instrument = mechanism.nominal().instrument;
    let at = |s: &Sighting, target: Point| s.tool.p + s.tool.r * target.at(&instrument);
    let mut ranges: Vec<(Point, Gauge, Vec<Seen>)> = Vec::new();
    let mut touches: Vec<(Plane, Vec<Seen>)> = Vec::new();
    for s in sightings {
        match s.clue {
            Clue::Range { target, point, gauge, reading } => {
                let seen = (at(s, target), reading);
                match ranges.iter_mut().find(|(p, g, _)| (*p, *g) == (point, gauge)) {
                    Some((_, _, list)) => list.push(seen),
                    None => ranges.push((point, gauge, vec![seen])),
                }
            }
            Clue::Touch { target, plane, height } => {
                let seen = (at(s, target), height);
                match touches.iter_mut().find(|(p, _)| *p == plane) {
                    Some((_, list)) => list.push(seen),
                    None => touches.push((plane, vec![seen])),
                }
            }
            Clue::Pose(_) | Clue::Position { .. } | Clue::Internal | Clue::None => {}
        }
    }
    for (point, gauge, seen) in &ranges {
        place_point(&mut mechanism.instrument, &instrument, point, gauge, seen);
    }
    for (plane, seen) in &touches {
        place_plane(&mut mechanism.instrument, plane, seen);
    }
}

fn is_free(constants: &[Constant], index: Option<usize>) -> bool {
    index.and_then(|k| constants.get(k)).is_some_and(|c| c.prior == Prior::Free)
}

/// Distances of a fixed point from known points: `d_k = |p_k - f| + z`, the zero `z` unknown or 0.
pub(super) struct Ranges<'a> {
    pub(super) seen: &'a [(Vector3<f64>, f64)],
    pub(super) with_zero: bool,
}

impl Ranges<'_> {
    fn cost(&self, f: &Vector3<f64>, zero: f64) -> f64 {
        self.seen.iter().map(|(p, d)| ((p - f).norm() + zero - d).powi(2)).sum()
    }

    /// Point and zero by linear least squares of `|p|^2 - d^2 = 2 p f - 2 d z - (|f|^2 - z^2)`, and the direction in
    /// which the points have no extent, if there is one.
    fn linear(&self) -> Option<(Vector3<f64>, f64, Option<Vector3<f64>>)> {
        let count = self.seen.len() as f64;
        let centre = self.seen.iter().map(|(p, _)| p).sum::<Vector3<f64>>() / count;
        let mean = self.seen.iter().map(|(_, d)| d).sum::<f64>() / count;
        let n = if self.with_zero { 4 } else { 3 };
        let row = |k: usize, j: usize| {
            let (p, d) = &self.seen[k];
            if j < 3 { 2.0 * (p[j] - centre[j]) } else { -2.0 * (d - mean) }
        };
        let square = |k: usize| (self.seen[k].0 - centre).norm_squared() - self.seen[k].1.powi(2);
        let middle = (0..self.seen.len()).map(square).sum::<f64>() / count;
        let a = DMatrix::from_fn(self.seen.len(), n, row);
        let b = DVector::from_fn(self.seen.len(), |k, _| square(k) - middle);
        let svd = a.try_svd(true, true, 5.0 * f64::EPSILON, ROUNDS)?;
        let largest = svd.singular_values.max();
        let solution = svd.solve(&b, RANK * largest).ok()?;
        let flat = (svd.singular_values.min() <= RANK * largest).then(|| {
            let v_t = svd.v_t.as_ref()?;
            let row = v_t.row(svd.singular_values.imin());
            let normal = Vector3::new(row[0], row[1], row[2]);
            (normal.norm() > 0.5).then(|| normal.normalize())
        });
        let f = Vector3::new(solution[0], solution[1], solution[2]) + centre;
        Some((f, if self.with_zero { solution[3] } else { 0.0 }, flat.flatten()))
    }

    /// Gauss-Newton with halved steps from a start: sum of squares, point and zero.
    pub(super) fn settled(&self, mut f: Vector3<f64>, mut zero: f64) -> (f64, Vector3<f64>, f64) {
        let mut cost = self.cost(&f, zero);
        let n = if self.with_zero { 4 } else { 3 };
        for _ in 0..ITERATIONS {
            let a = DMatrix::from_fn(self.seen.len(), n, |k, j| {
                let away = f - self.seen[k].0;
                if j < 3 { away[j] / away.norm().max(f64::MIN_POSITIVE) } else { 1.0 }
            });
            let b =
                DVector::from_fn(self.seen.len(), |k, _| self.seen[k].1 - (self.seen[k].0 - f).norm() - zero);
            let Some(svd) = a.try_svd(true, true, 5.0 * f64::EPSILON, ROUNDS) else { break };
            let largest = svd.singular_values.max();
            let Ok(step) = svd.solve(&b, 1e-9 * largest) else { break };
            let mut fraction = 1.0;
            loop {
                let next = f + Vector3::new(step[0], step[1], step[2]) * fraction;
                let next_zero = if self.with_zero { zero + fraction * step[3] } else { zero };
                let next_cost = self.cost(&next, next_zero);
                if next_cost < cost {
                    (f, zero, cost) = (next, next_zero, next_cost);
                    break;
                }
                fraction *= 0.5;
                if fraction < 1e-3 {
                    return (cost, f, zero);
                }
            }
        }
        (cost, f, zero)
    }

    /// The best of the starts: linear, beyond either side of the plane that holds the points, and as drawn.
    fn best(&self, drawn: Vector3<f64>) -> Option<(Vector3<f64>, f64)> {
        let (f, zero, flat) = self.linear()?;
        let mut starts = vec![f];
        if let Some(normal) = flat {
            let beyond = |(p, d): &(Vector3<f64>, f64)| (d - zero).powi(2) - (p - f).norm_squared();
            let square = self.seen.iter().map(beyond).sum::<f64>() / self.seen.len() as f64;
            let height = normal * square.max(0.0).sqrt();
            // Both sides fit alike: the one nearer to the drawing comes first.
            let sides = [f + height, f - height];
            let nearer = usize::from((sides[1] - drawn).norm() < (sides[0] - drawn).norm());
            starts = vec![sides[nearer], sides[1 - nearer]];
        }
        starts.push(drawn);
        let mut best: Option<(f64, Vector3<f64>, f64)> = None;
        for start in starts {
            let found = self.settled(start, zero);
            if found.0.is_finite() && best.is_none_or(|best| found.0 < best.0 * (1.0 - 1e-3)) {
                best = Some(found);
            }
        }
        best.map(|(_, f, zero)| (f, zero))
    }
}

fn place_point(
    constants: &mut [Constant],
    instrument: &[f64],
    point: &Point,
    gauge: &Gauge,
    seen: &[(Vector3<f64>, f64)],
) {
    let (zero, scale) = gauge.at(instrument);
    let with_zero = is_free(constants, gauge.zero_constant);
    let known = if with_zero { 0.0 } else { zero };
    let distances: Vec<Seen> = seen.iter().map(|(p, d)| (*p, (d - known) / scale)).collect();
    let drawn = point.at(instrument);
    if !is_free(constants, point.constants) {
        if let (true, Some(k)) = (with_zero, gauge.zero_constant) {
            let rest = |(p, d): &(Vector3<f64>, f64)| d - scale * (p - drawn).norm();
            constants[k].nominal = seen.iter().map(rest).sum::<f64>() / seen.len() as f64;
        }
        return;
    }
    // Three distances leave two sides, of which the one nearer to the drawing is taken; see `sides`.
    if distances.len() < if with_zero { 5 } else { 3 } {
        return;
    }
    let Some((f, found)) = (Ranges { seen: &distances, with_zero }).best(drawn) else { return };
    if let Some(first) = point.constants {
        (0..3).for_each(|i| constants[first + i].nominal = f[i]);
    }
    if let (true, Some(k)) = (with_zero, gauge.zero_constant) {
        constants[k].nominal = found * scale;
    }
}

fn place_plane(constants: &mut [Constant], plane: &Plane, seen: &[(Vector3<f64>, f64)]) {
    let instrument: Vec<f64> = constants.iter().map(|c| c.nominal).collect();
    let (mut normal, _) = plane.at(&instrument);
    let drawn = normal;
    let tilts = plane.tilts.filter(|k| is_free(constants, Some(*k)));
    let count = seen.len() as f64;
    if let (Some(first), true) = (tilts, seen.len() >= 3) {
        // The heights are along the normal: a few rounds, where there are any.
        for _ in 0..ITERATIONS {
            let feet = || seen.iter().map(|(p, height)| p - normal * *height);
            let centre = feet().sum::<Vector3<f64>>() / count;
            let spread: Matrix3<f64> = feet().map(|p| (p - centre) * (p - centre).transpose()).sum();
            let Some(eigen) = spread.try_symmetric_eigen(f64::EPSILON, ROUNDS) else { return };
            let found: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
            normal = if found.dot(&drawn) < 0.0 { -found } else { found };
        }
        let found = plane.tilts_of(&normal);
        (0..2).for_each(|i| constants[first + i].nominal = found[i]);
    }
    if let Some(k) = plane.shift.filter(|k| is_free(constants, Some(*k))) {
        constants[k].nominal = seen.iter().map(|(p, height)| normal.dot(p) - height).sum::<f64>() / count;
    }
}
