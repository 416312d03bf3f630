//! An identification about its solution: a linear model that tests reweight and extend (docs/theory.md (10.11)).

use super::cells::{Cell, Principal, kinds};
use crate::calibration::postures::telling;
use crate::calibration::{ByPosture, Calibration, Postures, Sample};
use crate::identify::covariance::weight;
use crate::identify::run::Identification;
use crate::linalg;
use crate::measure::Evaluation;
use crate::problem::{Form, Problem};
use faer::linalg::solvers::{DenseSolveCore, Solve};
use faer::{Mat, Side};
use nalgebra::Vector3;
use std::ops::Range;

/// Rows `r + J dx` and the precision `W` with which the tolerances hold `x + dx` to 0.
#[derive(Clone)]
pub(super) struct Linear {
    /// m x n, whitened.
    pub jac: Mat<f64>,
    /// m.
    pub r: Vec<f64>,
    /// The cell of each row, an index into `cells`.
    pub cell: Vec<usize>,
    /// The cells there are.
    pub cells: Vec<Cell>,
    /// Rows of each posture.
    pub spans: Vec<Range<usize>>,
    /// The caller's samples that close, ascending.
    pub closing: Vec<usize>,
    /// Those of each posture.
    pub members: Vec<Vec<usize>>,
    /// Whether a posture has a part in the estimate.
    pub active: Vec<bool>,
    /// W, n x n.
    pub prior: Mat<f64>,
    /// W - W W.
    weak: Mat<f64>,
    /// x, n.
    pub at: Vec<f64>,
    /// Rows that were turned to the principal axes of their noise.
    pub turned: Vec<Principal>,
}

/// `[J r]'[J r]` of the active rows of each cell, and how many they are.
pub(super) struct Grams(pub Vec<(Mat<f64>, usize)>);

/// The estimate under some noise.
#[derive(Clone)]
pub(super) struct Solution {
    /// `A^-1`, `A = J' D J + W` with `D` the inverse variances.
    pub inverse: Mat<f64>,
    /// `A^-1 (A + W - W W) A^-1`: what it takes from the covariance of the residual.
    pub middle: Mat<f64>,
    /// Step to it.
    pub step: Vec<f64>,
    /// Of each cell: sum of squares of the residual in standard deviations.
    pub square: Vec<f64>,
    /// Of each cell: what the noise makes of it.
    pub freedom: Vec<f64>,
    /// -2 log of the restricted likelihood, but for a constant.
    pub objective: f64,
}

impl Linear {
    /// About the result `found`, over those samples that close there. `sets` has the set of each sample, `active`
    /// whether it has a part in the estimate. `None` where linear theory does not describe the estimate.
    pub fn new(found: &Identification, samples: &[Sample], sets: &[usize], active: &[bool]) -> Option<Self> {
        found.covariance.as_ref()?;
        let seen = found.visibility.as_ref()?;
        let at = found.geometry.deviations_from(&found.supported.nominal());
        let whole = Calibration::new(&found.supported, samples, Form::Minimal, &at);
        let mut closes = vec![true; samples.len()];
        whole.set_aside().iter().for_each(|s| closes[s.sample] = false);
        let closing: Vec<usize> = (0..samples.len()).filter(|&k| closes[k]).collect();
        let own: Vec<Sample> = closing.iter().map(|&k| samples[k].clone()).collect();
        let problem = Calibration::new(&found.supported, &own, Form::Minimal, &at);
        let x = problem.coordinates().nearest(&at);
        let spans = problem.blocks();
        let by_posture = ByPosture::of(&own);
        let members: Vec<Vec<usize>> =
            by_posture.iter().map(|of| of.iter().map(|&i| closing[i]).collect()).collect();
        if spans.len() != members.len() {
            return None;
        }
        let lin = problem.linearize(&x).ok()?;
        let n = x.len();
        // What was seen is told in stated tolerances; the prior is that of the tolerances in force.
        let restated = found.tolerance_test.is_some_and(|test| test.in_force != 1.0);
        let own = if restated { Some(linalg::svd(problem.compress(&x).ok()?.jac.as_ref())?) } else { None };
        let mut root = own.as_ref().map_or(&seen.directions, |own| &own.v).clone();
        for k in 0..root.ncols() {
            let strengths = own.as_ref().map_or(&seen.singular_values, |own| &own.s);
            let s = strengths.get(k).copied().unwrap_or(0.0);
            let w = weight(found.report.estimate, s)?.sqrt();
            root.as_mut().col_mut(k).iter_mut().for_each(|v| *v *= w);
        }
        (root.nrows() == n).then_some(())?;
        let prior = &root * root.transpose();
        let mut out = Self {
            jac: lin.jac,
            r: lin.r,
            cell: Vec::new(),
            cells: Vec::new(),
            spans,
            active: members.iter().map(|of| of.iter().all(|&k| active[k])).collect(),
            weak: &prior - &prior * &prior,
            prior,
            at: x,
            closing,
            members,
            turned: Vec::new(),
        };
        out.name_rows(found, samples, sets)?;
        out.jac.is_all_finite().then_some(out)
    }

    /// Finds the cell of each row, and turns rows to the principal axes of their noise where they have no axis.
    fn name_rows(&mut self, found: &Identification, samples: &[Sample], sets: &[usize]) -> Option<()> {
        let mut postures = Postures::new(&found.supported);
        let mut evaluation = Evaluation::default();
        let mut names = Vec::with_capacity(self.r.len());
        for (span, members) in self.spans.iter().zip(&self.members) {
            telling(members.iter().map(|&i| &samples[i]))?
                .close_all(&found.supported, &found.geometry, &mut postures)
                .ok()?;
            for &i in members {
                let view = postures.view(&samples[i], &found.geometry);
                evaluation.clear();
                samples[i].measurement.evaluate(&view, &mut evaluation);
                let (kinds, turned) = kinds(&samples[i], &view, &evaluation);
                let set = sets.get(i).copied().unwrap_or(0);
                names.extend(kinds.into_iter().map(|(quantity, axis)| Cell { set, quantity, axis }));
                // Rows of several samples are whitened together.
                if members.len() == 1 {
                    self.turned.extend(turned.into_iter().map(|(first, turn)| (span.start + first, turn)));
                }
            }
        }
        let mut rows = self.rows();
        self.turn(&mut rows);
        self.set_rows(&rows);
        self.cells = names.clone();
        self.cells.sort_unstable();
        self.cells.dedup();
        self.cell = names.iter().map(|name| self.cells.binary_search(name).unwrap_or(0)).collect();
        (self.cell.len() == self.r.len()).then_some(())
    }

    /// Turns the rows of a matrix as those of the model were: to the principal axes of their noise.
    pub fn turn(&self, rows: &mut Mat<f64>) {
        for (first, turn) in &self.turned {
            for j in 0..rows.ncols() {
                let v = turn * Vector3::from_fn(|i, _| rows[(first + i, j)]);
                (0..3).for_each(|i| rows[(first + i, j)] = v[i]);
            }
        }
    }

    /// `[J r]`.
    pub fn rows(&self) -> Mat<f64> {
        let n = self.jac.ncols();
        Mat::from_fn(self.r.len(), n + 1, |i, j| if j == n { self.r[i] } else { self.jac[(i, j)] })
    }

    /// Takes other rows `[J r]` for its own.
    pub fn set_rows(&mut self, rows: &Mat<f64>) {
        let n = rows.ncols() - 1;
        self.jac = rows.get(.., ..n).to_owned();
        self.r = rows.col(n).iter().copied().collect();
    }

    /// Whether each row has a part in the estimate.
    pub fn active_rows(&self) -> Vec<bool> {
        let mut active = vec![false; self.r.len()];
        for (span, on) in self.spans.iter().zip(&self.active) {
            active[span.clone()].iter_mut().for_each(|row| *row = *on);
        }
        active
    }

    /// The normal matrices of the cells.
    pub fn grams(&self) -> Grams {
        let n = self.jac.ncols();
        let active = self.active_rows();
        let of =
            |cell: usize| {
                let own: Vec<usize> =
                    (0..self.r.len()).filter(|&i| active[i] && self.cell[i] == cell).collect();
                let rows = Mat::from_fn(own.len(), n + 1, |i, j| {
                    if j == n { self.r[own[i]] } else { self.jac[(own[i], j)] }
                });
                (rows.transpose() * &rows, own.len())
            };
        Grams((0..self.cells.len()).map(of).collect())
    }

    /// The estimate where the variance of each cell is `factors` times what was stated; `None` where it is singular.
    pub fn solve(&self, grams: &Grams, factors: &[f64]) -> Option<Solution> {
        let n = self.at.len();
        let mut a = self.prior.clone();
        let pull = linalg::mul(self.prior.as_ref(), &self.at);
        let mut gradient = pull.clone();
        let mut objective = 0.0;
        for ((gram, count), factor) in grams.0.iter().zip(factors) {
            for j in 0..n {
                for i in 0..n {
                    a[(i, j)] += gram[(i, j)] / factor;
                }
                gradient[j] += gram[(j, n)] / factor;
            }
            objective += *count as f64 * factor.ln();
        }
        let llt = a.llt(Side::Lower).ok()?;
        let lower = llt.L();
        objective += (0..n).map(|i| 2.0 * lower[(i, i)].ln()).sum::<f64>();
        let inverse = llt.inverse();
        let step = llt.solve(&Mat::from_fn(n, 1, |i, _| -gradient[i]));
        let step: Vec<f64> = step.col(0).iter().copied().collect();
        let middle = &inverse * (&a + &self.weak) * &inverse;
        let (mut square, mut freedom) = (Vec::new(), Vec::new());
        for ((gram, count), factor) in grams.0.iter().zip(factors) {
            let (mut q, mut taken) = (gram[(n, n)], 0.0);
            for j in 0..n {
                let own: f64 = (0..n).map(|i| gram[(i, j)] * step[i]).sum();
                q += step[j] * (own + 2.0 * gram[(j, n)]);
                taken += (0..n).map(|i| gram[(i, j)] * middle[(i, j)]).sum::<f64>();
            }
            square.push(q.max(0.0) / factor);
            freedom.push((*count as f64 - taken / factor).max(0.0));
        }
        let end: Vec<f64> = self.at.iter().zip(&step).map(|(x, dx)| x + dx).collect();
        let held = linalg::dot(&end, &linalg::mul(self.prior.as_ref(), &end));
        objective += square.iter().sum::<f64>() + held;
        let finite = objective.is_finite() && step.iter().all(|v| v.is_finite());
        finite.then_some(Solution { inverse, middle, step, square, freedom, objective })
    }

    /// Divides each row of a matrix by the standard deviation that `factors` (variances) give its cell.
    pub fn normalise(&self, factors: &[f64], rows: &mut Mat<f64>) {
        for (i, cell) in self.cell.iter().enumerate() {
            let by = factors[*cell].sqrt();
            (0..rows.ncols()).for_each(|j| rows[(i, j)] /= by);
        }
    }

    /// With further unknowns, of which nothing is known: `columns` is m x p.
    pub fn extended(&self, columns: &Mat<f64>) -> Self {
        let (n, p) = (self.at.len(), columns.ncols());
        let jac =
            Mat::from_fn(
                self.r.len(),
                n + p,
                |i, j| {
                    if j < n { self.jac[(i, j)] } else { columns[(i, j - n)] }
                },
            );
        let padded =
            |of: &Mat<f64>| Mat::from_fn(n + p, n + p, |i, j| if i < n && j < n { of[(i, j)] } else { 0.0 });
        let (prior, weak) = (padded(&self.prior), padded(&self.weak));
        let mut at = self.at.clone();
        at.resize(n + p, 0.0);
        Self { jac, prior, weak, at, ..self.clone() }
    }
}

/// Residual at an estimate, with what tests of it need.
pub(super) struct Residual {
    /// m.
    pub r: Vec<f64>,
    /// `J M`, m x n.
    pub taken: Mat<f64>,
    /// Diagonal of its covariance, m.
    pub variance: Vec<f64>,
    /// Sum of squares of the active rows.
    pub square: f64,
    /// Its expectation.
    pub freedom: f64,
}

impl Residual {
    /// Of a model whose rows are in standard deviations.
    pub fn of(linear: &Linear, solution: &Solution) -> Self {
        let along = linalg::mul(linear.jac.as_ref(), &solution.step);
        let r: Vec<f64> = linear.r.iter().zip(&along).map(|(r, d)| r + d).collect();
        let taken = &linear.jac * &solution.middle;
        let n = linear.at.len();
        let own = |i: usize| (0..n).map(|j| taken[(i, j)] * linear.jac[(i, j)]).sum::<f64>();
        let variance = (0..r.len()).map(|i| (1.0 - own(i)).max(0.0)).collect();
        Self {
            r,
            taken,
            variance,
            square: solution.square.iter().sum(),
            freedom: solution.freedom.iter().sum(),
        }
    }

    /// Variance of the noise that it shows, in stated variances.
    pub fn scale(&self) -> f64 {
        self.square / self.freedom.max(1.0)
    }
}
