//! Base, tool and free targets refined together: the numbers of `X g Y`, on whitened residuals, before any link moves.
//!
//! Rotations that are small, or all about one axis, leave combinations of base and tool that the data do not tell. A pull
//! towards the tool as drawn settles these; it is far too weak to move what is told.

use super::registration::Stand;
use super::rounds::EXACT;
use super::untold::Part;
use crate::calibration::Sample;
use crate::lie::{Se3, so3};
use crate::measure::{Evaluation, View};
use nalgebra::{DMatrix, DVector, Matrix3, SymmetricEigen, Vector3};

/// Postures by which starts are compared.
const TRIED: usize = 40;
/// Most steps of one refinement.
const STEPS: usize = 60;
/// Change of the tool, rad or machine sizes, that must change the median posture by more than what is left of its
/// residual, for the data to tell it: what a link without tolerance is thought to be off by after registration.
const TOLD: f64 = 0.1;
/// Factor on that where the readings show the tool further away, and where it ends, rad and machine sizes.
const FURTHER: f64 = 4.0;
const FURTHEST: f64 = 1.0;
/// Cost under the pull of the drawing, in that without it, from which the drawing spoils the fit.
const SPOILED: f64 = 1.2;
/// The same of the base, and of targets, of which no drawing knows anything.
const TOLD_BASE: f64 = 1.0;
/// Information, in terms of the least by which a direction is told, at which the closed form is beyond doubt.
const BEYOND_DOUBT: f64 = 30.0;
/// Most rounds of a factorisation.
const ITERATIONS: usize = 1000;
/// Relative decrease of the cost at which a refinement ends.
const GAINED: f64 = 1e-9;

/// Step through so many readings that takes about `most` of them and, the targets of a posture following each other, each
/// target in turn: no multiple of a few.
pub(super) fn stride(readings: usize, most: usize) -> usize {
    let least = readings.div_ceil(most).max(1);
    (least..).find(|step| [2, 3, 5, 7].iter().all(|few| step % few != 0)).unwrap_or(least)
}

/// Predicted tool poses with what was measured there.
pub(super) struct Refinement<'a> {
    seen: Vec<(Se3, &'a Sample)>,
    /// What moves, three numbers a part.
    parts: Vec<Part>,
    /// Constants of the instrument that are unknown.
    constants: Vec<usize>,
    length: f64,
    /// By how much residuals of angles and of lengths exceed the noise.
    scatter: [f64; 2],
    /// How far the tool is thought to be from the drawing, rad and machine sizes.
    tool_unit: f64,
}

/// Normal equations of one step: rad, machine sizes.
struct Normal {
    matrix: DMatrix<f64>,
    right: DVector<f64>,
}

impl<'a> Refinement<'a> {
    /// Of predicted poses and their samples; `length` is the machine's size, m.
    pub fn new(seen: Vec<(Se3, &'a Sample)>, parts: Vec<Part>, constants: Vec<usize>, length: f64) -> Self {
        Self { seen, parts, constants, length, scatter: [1.0; 2], tool_unit: TOLD }
    }

    /// The best of the starts, the first of which is the closed form, refined; and the directions that the data do not
    /// tell, a column each: base (turn, shift), tool (turn, shift), constants, in [`units`](Self::units).
    pub fn best(mut self, starts: &[Stand]) -> Option<(Stand, DMatrix<f64>)> {
        let first = starts.first()?;
        let all = std::mem::take(&mut self.seen);
        self.seen = all.iter().step_by(stride(all.len(), TRIED)).copied().collect();
        let (_, closed) = self.settled(first, false);
        self.scatter = self.scatter_at(&closed);
        let doubt = self
            .information(&closed)
            .is_none_or(|(values, _)| values.iter().any(|v| *v < BEYOND_DOUBT * self.seen.len() as f64));
        let mut found = closed;
        if doubt {
            found = self.sought(starts, found);
        }
        self.seen = all;
        self.scatter = self.scatter_at(&found);
        self.told(found)
    }

    /// The best of all starts under the pull of the drawing, weighed against what the best fit of all leaves.
    fn sought(&mut self, starts: &[Stand], closed: Stand) -> Stand {
        self.scatter = [1.0; 2];
        let free: Vec<(f64, Stand)> = starts[1..].iter().map(|start| self.settled(start, false)).collect();
        let mut best = (self.cost(&closed, false), closed);
        for found in free {
            if found.0 < best.0 {
                best = found;
            }
        }
        self.scatter = self.scatter_at(&best.1);
        let mut rows = 0.0;
        self.look(&best.1, |_, evaluation, _| rows += evaluation.rows.len() as f64);
        let least = self.cost(&best.1, false).max(rows * EXACT.powi(2));
        loop {
            let mut pulled = self.settled(&best.1, true);
            for start in starts {
                let found = self.settled(start, true);
                if found.0 < pulled.0 * (1.0 - 1e-6) {
                    pulled = found;
                }
            }
            // Where the pull costs the fit, the tool is further from the drawing than was thought.
            let spoiled = self.cost(&pulled.1, false) > SPOILED * least;
            if !spoiled || self.tool_unit >= FURTHEST {
                return pulled.1;
            }
            self.tool_unit = (self.tool_unit * FURTHER).min(FURTHEST);
        }
    }

    /// Gauss-Newton along what is told, without any pull.
    fn told(&self, mut at: Stand) -> Option<(Stand, DMatrix<f64>)> {
        let (values, vectors) = self.information(&at)?;
        let least = self.seen.len() as f64;
        let (told, untold): (Vec<usize>, Vec<usize>) = (0..values.len()).partition(|&k| values[k] >= least);
        if told.is_empty() {
            return Some((at, vectors));
        }
        let along = self.units() * vectors.select_columns(&told);
        let mut cost = self.cost(&at, false);
        for _ in 0..STEPS {
            let normal = self.normal(&at, false);
            let matrix = along.tr_mul(&(&normal.matrix * &along));
            let Some(factor) = matrix.cholesky() else { break };
            let step = &along * factor.solve(&along.tr_mul(&normal.right));
            let Some((next, next_cost)) = self.descended(&at, &step, cost) else { break };
            let gain = 1.0 - next_cost / cost;
            (at, cost) = (next, next_cost);
            if gain < GAINED {
                break;
            }
        }
        Some((at, vectors.select_columns(&untold)))
    }

    /// The longest of halved steps that lowers the cost.
    fn descended(&self, at: &Stand, step: &DVector<f64>, cost: f64) -> Option<(Stand, f64)> {
        let fractions = (0..10).map(|k| 0.5_f64.powi(k));
        fractions.map(|fraction| self.moved(at, &(step * fraction))).find_map(|next| {
            let next_cost = self.cost(&next, false);
            (next_cost < cost).then_some((next, next_cost))
        })
    }

    /// Levenberg-Marquardt from a start.
    fn settled(&self, start: &Stand, pull: bool) -> (f64, Stand) {
        let (mut at, mut cost) = (start.clone(), self.cost(start, pull));
        let mut damping = 1e-3;
        for _ in 0..STEPS {
            let Normal { matrix, right } = self.normal(&at, pull);
            let largest = matrix.diagonal().max();
            let damped = &matrix + DMatrix::identity(right.len(), right.len()) * (damping * largest);
            let step = damped.cholesky().map(|factor| factor.solve(&right));
            let next = step.map(|step| self.moved(&at, &step));
            let next_cost = next.as_ref().map_or(f64::INFINITY, |next| self.cost(next, pull));
            match next.filter(|_| next_cost < cost) {
                Some(next) => {
                    let gain = 1.0 - next_cost / cost;
                    (at, cost) = (next, next_cost);
                    damping = (damping * 0.1).max(1e-13);
                    if gain < GAINED {
                        break;
                    }
                }
                None if damping > 1e3 || !largest.is_finite() => break,
                None => damping *= 10.0,
            }
        }
        (cost, at)
    }

    fn count(&self) -> usize {
        3 * self.parts.len() + self.constants.len()
    }

    fn moves(&self, part: Part) -> bool {
        self.parts.contains(&part)
    }

    /// Units in which a direction is told or not, rad and machine sizes.
    fn units(&self) -> DMatrix<f64> {
        let unit = |i: usize| match self.parts.get(i / 3) {
            Some(Part::ToolTurn | Part::ToolOffset) => self.tool_unit,
            _ => TOLD_BASE,
        };
        DMatrix::from_diagonal(&DVector::from_fn(self.count(), |i, _| unit(i)))
    }

    /// Information of each direction in [`units`](Self::units), and the directions.
    fn information(&self, at: &Stand) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let units = self.units();
        let matrix = &units * self.normal(at, false).matrix * &units;
        if matrix.iter().any(|v| !v.is_finite()) {
            return None;
        }
        let eigen = SymmetricEigen::try_new(matrix, f64::EPSILON, ITERATIONS)?;
        Some((eigen.eigenvalues, eigen.eigenvectors))
    }

    /// Shows the rows of every sample and the tool pose there.
    fn look(&self, at: &Stand, mut each: impl FnMut(&Sample, &Evaluation, &Se3)) {
        let mut evaluation = Evaluation::default();
        for (predicted, sample) in &self.seen {
            let tool = at.base * *predicted * at.tool;
            evaluation.clear();
            let view = View { tool, posture: None, second: tool, instrument: &at.instrument };
            sample.measurement.evaluate(&view, &mut evaluation);
            each(sample, &evaluation, &tool);
        }
    }

    fn sigma(&self, sample: &Sample, row: usize) -> f64 {
        self.scatter[usize::from(!sample.measurement.is_angle(row))]
    }

    /// Root mean square residual of angles and of lengths, in noise, 1 or more.
    fn scatter_at(&self, at: &Stand) -> [f64; 2] {
        let (mut square, mut count) = ([0.0; 2], [0.0; 2]);
        self.look(at, |sample, evaluation, _| {
            for (k, row) in evaluation.rows.iter().enumerate() {
                let kind = usize::from(!sample.measurement.is_angle(k));
                square[kind] += row.r * row.r;
                count[kind] += 1.0;
            }
        });
        let rows: f64 = count.iter().sum();
        let correction = rows / (rows - self.count() as f64).max(1.0);
        [0, 1].map(|kind| f64::sqrt(correction * square[kind] / f64::max(count[kind], 1.0)).max(1.0))
    }

    /// How far the tool is from the drawing, in standard deviations of the pull: zero of what does not move.
    fn pull(&self, at: &Stand) -> [Vector3<f64>; 2] {
        let weight = self.pull_weight();
        [so3::log(&at.tool.r) * weight, at.tool.p * (weight / self.length)]
    }

    fn pull_weight(&self) -> f64 {
        (self.seen.len() as f64).sqrt() / self.tool_unit
    }

    fn cost(&self, at: &Stand, pull: bool) -> f64 {
        let mut cost = 0.0;
        self.look(at, |sample, evaluation, _| {
            for (k, row) in evaluation.rows.iter().enumerate() {
                cost += (row.r / self.sigma(sample, k)).powi(2);
            }
        });
        if pull {
            cost += self.pull(at).iter().map(Vector3::norm_squared).sum::<f64>();
        }
        if cost.is_finite() { cost } else { f64::INFINITY }
    }

    /// About where the tool is on average the base turns; about where it is drawn, if its place stays.
    fn centre(&self, at: &Stand) -> Vector3<f64> {
        if !self.moves(Part::BasePlace) {
            return at.base.p;
        }
        let places = self.seen.iter().map(|(g, _)| at.base.r * g.p + at.base.p);
        places.sum::<Vector3<f64>>() / self.seen.len().max(1) as f64
    }

    fn normal(&self, at: &Stand, pull: bool) -> Normal {
        let n = self.count();
        let centre = self.centre(at);
        let (mut matrix, mut right) = (DMatrix::zeros(n, n), DVector::zeros(n));
        let mut row = DVector::zeros(n);
        self.look(at, |sample, evaluation, tool| {
            for (k, seen) in evaluation.rows.iter().enumerate() {
                let per_sigma = 1.0 / self.sigma(sample, k);
                let [a, b, c, x, y, z] = seen.by_tool;
                let (w, v) = (Vector3::new(a, b, c), Vector3::new(x, y, z));
                let mut column = 0;
                let mut put = |by: Vector3<f64>, unit: f64| {
                    by.iter().enumerate().for_each(|(i, by)| row[column + i] = by * unit * per_sigma);
                    column += 3;
                };
                for part in &self.parts {
                    match part {
                        Part::BaseTurn => put(w + (tool.p - centre).cross(&v), 1.0),
                        Part::BasePlace => put(v, self.length),
                        Part::ToolTurn => put(tool.r.tr_mul(&w), 1.0),
                        Part::ToolOffset => put(tool.r.tr_mul(&v), self.length),
                    }
                }
                let column = 3 * self.parts.len();
                for (i, constant) in self.constants.iter().enumerate() {
                    let own =
                        evaluation.by_constant.iter().filter(|by| by.row == k && by.constant == *constant);
                    row[column + i] = own.map(|by| by.value).sum::<f64>() * self.length * per_sigma;
                }
                matrix.ger(1.0, &row, &row, 1.0);
                right.axpy(-seen.r * per_sigma, &row, 1.0);
            }
        });
        if pull {
            let weight = self.pull_weight();
            let [turn, shift] = self.pull(at);
            let by_turn = so3::left_jacobian_inverse(&-so3::log(&at.tool.r)) * weight;
            for (k, part) in self.parts.iter().enumerate() {
                let (by, value) = match part {
                    Part::ToolTurn => (by_turn, turn),
                    Part::ToolOffset => (at.tool.r * weight, shift),
                    Part::BaseTurn | Part::BasePlace => continue,
                };
                let first = 3 * k;
                let block = matrix.fixed_view::<3, 3>(first, first) + by.tr_mul(&by);
                matrix.fixed_view_mut::<3, 3>(first, first).copy_from(&block);
                let part = right.fixed_rows::<3>(first) - by.tr_mul(&value);
                right.fixed_rows_mut::<3>(first).copy_from(&part);
            }
        }
        Normal { matrix, right }
    }

    fn moved(&self, at: &Stand, step: &DVector<f64>) -> Stand {
        let mut next = at.clone();
        let by = |part: Part| {
            let place = self.parts.iter().position(|own| *own == part);
            place.map_or(Vector3::zeros(), |k| Vector3::new(step[3 * k], step[3 * k + 1], step[3 * k + 2]))
        };
        let (turn, shift) = (so3::exp(&by(Part::BaseTurn)), by(Part::BasePlace) * self.length);
        let centre = self.centre(at);
        next.base = Se3 { r: turn * at.base.r, p: turn * (at.base.p - centre) + centre + shift };
        let (turn, shift) = (so3::exp(&by(Part::ToolTurn)), by(Part::ToolOffset) * self.length);
        next.tool = at.tool * Se3 { r: turn, p: shift };
        let first = self.count() - self.constants.len();
        for (i, constant) in self.constants.iter().enumerate() {
            next.instrument[*constant] += step[first + i] * self.length;
        }
        // Many small turns leave rounding in the matrices.
        next.base.r = orthonormal(&next.base.r);
        next.tool.r = orthonormal(&next.tool.r);
        next
    }
}

fn orthonormal(r: &Matrix3<f64>) -> Matrix3<f64> {
    so3::exp(&so3::log(r))
}
