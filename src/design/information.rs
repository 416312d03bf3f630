//! What each posture tells: rows of the whitened Jacobian in coordinates in which an average plan has unit information
//! (docs/theory.md section 11).

use super::candidates::{Candidate, DesignError};
use crate::calibration::{ByPosture, Calibration, Postures, Sample, SetAside, close_at};
use crate::identify::twists::twists_by_links;
use crate::lie::Se3;
use crate::linalg;
use crate::measure::Measurement;
use crate::model::Mechanism;
use crate::problem::{Form, Problem};
use crate::simulate::read;
use faer::linalg::solvers::DenseSolveCore;
use faer::{Mat, Side};
use rayon::prelude::*;
use std::sync::Arc;

/// Rows kept for each posture; a measurement with fewer leaves the others zero.
pub const ROWS: usize = 6;
/// Whitened singular value, all postures together, below which a direction is left to its tolerance: what it adds to a
/// variance is less than 1e-12 of a tolerance squared.
const VISIBLE: f64 = 1e-6;

/// What would be measured at each posture.
#[derive(Clone, Debug)]
pub struct Instrument {
    /// Measurements without readings, weighted by the stated noise, that the candidates take in turn.
    pub blanks: Vec<Arc<dyn Measurement>>,
}

impl Instrument {
    /// What is read at a candidate.
    pub fn blank(&self, candidate: usize) -> usize {
        candidate % self.blanks.len().max(1)
    }

    /// Index of the candidate with which a candidate is compared, where the instrument compares two postures: nearly half
    /// of all `count` candidates further on. Never exactly half where there are more than two, so that no two candidates
    /// are one distance read in both directions.
    pub fn second(candidate: usize, count: usize) -> usize {
        let stride = if count == 2 { 1 } else { count.saturating_sub(1) / 2 };
        (candidate + stride) % count.max(1)
    }

    /// Whether it compares two postures.
    pub fn compares(&self) -> bool {
        self.blanks.iter().any(|blank| blank.second().is_some())
    }

    /// What is read at these candidates without noise.
    fn samples(&self, mechanism: &Mechanism, of: &[Candidate]) -> Result<Vec<Sample>, DesignError> {
        let nominal = mechanism.nominal();
        let one = |(i, c): (usize, &Candidate)| {
            let blank = self.blanks.get(self.blank(i)).ok_or(DesignError::Blind)?;
            if blank.rows() > ROWS {
                return Err(DesignError::TooManyReadings { found: blank.rows() });
            }
            let second = &of[Self::second(i, of.len())].actuators;
            let measurement = read(mechanism, &nominal, &**blank, &c.actuators, second)
                .map_err(|why| DesignError::Evaluate(format!("{}: {why}", c.name)))?;
            Ok(Sample { name: c.name.clone(), actuators: c.actuators.clone(), measurement })
        };
        of.par_iter().enumerate().map(one).collect()
    }
}

/// Information of candidates, of what has been measured already, and of a workspace to be accurate in.
///
/// Coordinates: the minimal ones of the calibration, turned to the right singular vectors of all postures together and
/// divided by `sqrt(1 + s^2)`, `s^2` their information in an average plan. Every matrix that is inverted is then near 1.
#[derive(Clone, Debug)]
pub struct Information {
    /// [`ROWS`] rows for each candidate, k columns.
    pub rows: Mat<f64>,
    /// The unit prior on tolerances and what has been measured already, k x k.
    pub base: Mat<f64>,
    /// Standard deviation in tolerances that one unit of each coordinate stands for, k; descending information.
    pub scale: Vec<f64>,
    /// Directions that an average plan knows better than the tolerances.
    pub kept: usize,
    /// Whitened rows of the workspace, [`ROWS`] for each posture.
    pub workspace: Mat<f64>,
    /// The same by the tool twist `[w; dp]`, rad and m.
    pub twists: Mat<f64>,
    /// What the directions that no reading sees add to the variance of each row of `twists`, rad^2 and m^2: they stay at
    /// the unit prior whatever is measured.
    pub unseen: Vec<f64>,
    /// Whether each candidate is a pair of postures, with the second that [`Instrument::second`] says.
    pub pairs: bool,
    /// Names of postures measured already that take no part, because they do not close as drawn.
    pub left_out: Vec<String>,
}

impl Information {
    /// Linearises candidates, postures measured already and workspace at nominal geometry; `poses` is the size of an
    /// average plan.
    pub fn new(
        mechanism: &Mechanism,
        instrument: &Instrument,
        candidates: &[Candidate],
        measured: &[Sample],
        workspace: &[Candidate],
        poses: usize,
    ) -> Result<Self, DesignError> {
        let planned = padded_jacobian(mechanism, &instrument.samples(mechanism, candidates)?)?;
        let (measured, left_out) = as_drawn(mechanism, measured);
        let (known, _) = jacobian(mechanism, &measured)?;
        let seen = padded_jacobian(mechanism, &instrument.samples(mechanism, workspace)?)?;
        let zero = vec![0.0; mechanism.component_count()];
        let postures: Vec<(&[f64], Se3)> =
            workspace.iter().map(|c| (c.actuators.as_slice(), c.pose)).collect();
        let twists = twists_by_links(mechanism, &postures, Form::Minimal, &zero)
            .map_err(|why| DesignError::Evaluate(why.to_string()))?;
        let average = (poses as f64 / candidates.len().max(1) as f64).sqrt();
        let (directions, s) = spectrum(&[(&planned, average), (&known, 1.0), (&seen, 1.0)])
            .ok_or_else(|| DesignError::Evaluate("the Jacobian is not finite".into()))?;
        let k = s.iter().filter(|s| **s > VISIBLE).count();
        if k == 0 {
            return Err(DesignError::Blind);
        }
        // Information of an average plan along each direction; the workspace only says which directions count.
        let turned = &planned * directions.get(.., ..k);
        let by_known = &known * directions.get(.., ..k);
        let square = |a: &Mat<f64>, j: usize| a.col(j).iter().map(|v| v * v).sum::<f64>();
        let scale: Vec<f64> = (0..k)
            .map(|j| 1.0 / (1.0 + average * average * square(&turned, j) + square(&by_known, j)).sqrt())
            .collect();
        let scaled = |a: Mat<f64>| Mat::from_fn(a.nrows(), k, |i, j| a[(i, j)] * scale[j]);
        let by_known = scaled(by_known);
        let prior = Mat::from_fn(k, k, |i, j| if i == j { scale[i] * scale[i] } else { 0.0 });
        let (turned, base) = (scaled(turned), prior + by_known.transpose() * &by_known);
        let kept = scale.iter().filter(|scale| is_kept(**scale)).count();
        let workspace = scaled(&seen * directions.get(.., ..k));
        let lost = &twists * directions.get(.., k..);
        let unseen = (0..lost.nrows()).map(|row| lost.row(row).iter().map(|v| v * v).sum()).collect();
        let twists = scaled(&twists * directions.get(.., ..k));
        let pairs = instrument.compares();
        Ok(Self { rows: turned, base, scale, kept, workspace, twists, unseen, pairs, left_out })
    }

    /// Whether an average plan knows this coordinate better than the tolerances.
    pub fn is_kept(&self, coordinate: usize) -> bool {
        self.scale.get(coordinate).is_some_and(|scale| is_kept(*scale))
    }

    /// Number of candidates.
    pub fn count(&self) -> usize {
        self.rows.nrows() / ROWS
    }

    /// Rows of one candidate, as columns: k x [`ROWS`].
    pub fn columns(&self, candidate: usize) -> Mat<f64> {
        self.rows.get(ROWS * candidate..ROWS * (candidate + 1), ..).transpose().to_owned()
    }

    /// Information matrix of the chosen candidates, base included, k x k.
    pub fn of(&self, chosen: &[usize]) -> Mat<f64> {
        let mut weights = vec![0.0; self.count()];
        chosen.iter().for_each(|&candidate| weights[candidate] += 1.0);
        self.weighted(&weights)
    }

    /// Information matrix of weighted candidates, base included, k x k.
    pub fn weighted(&self, weights: &[f64]) -> Mat<f64> {
        let some: Vec<usize> = (0..weights.len()).filter(|&i| weights[i] > 0.0).collect();
        let rows = Mat::from_fn(ROWS * some.len(), self.scale.len(), |i, j| {
            let candidate = some[i / ROWS];
            weights[candidate].sqrt() * self.rows[(ROWS * candidate + i % ROWS, j)]
        });
        &self.base + rows.transpose() * &rows
    }

    /// `log det(I + J'J)` in tolerances, of a matrix in these coordinates.
    pub fn log_det(&self, information: &Mat<f64>) -> Option<f64> {
        let units: f64 = self.scale.iter().map(|scale| 2.0 * scale.ln()).sum();
        Some(log_det(information)? - units)
    }
}

/// Whether information beats the unit prior, by the standard deviation that both together leave.
fn is_kept(scale: f64) -> bool {
    scale * scale < 0.5
}

/// Inverse of a positive definite matrix; `None` where it is none.
pub fn inverse(a: &Mat<f64>) -> Option<Mat<f64>> {
    Some(a.llt(Side::Lower).ok()?.inverse())
}

/// Logarithm of the determinant of a positive definite matrix; `None` where it is none.
pub fn log_det(a: &Mat<f64>) -> Option<f64> {
    let factor = a.llt(Side::Lower).ok()?;
    let diagonal = factor.L().diagonal().column_vector();
    Some(diagonal.iter().map(|d| 2.0 * d.ln()).sum())
}

/// The samples as they would read on the machine as drawn, wherever its free ends stood when they were measured; and the
/// names of those that do not close there.
fn as_drawn(mechanism: &Mechanism, samples: &[Sample]) -> (Vec<Sample>, Vec<String>) {
    let nominal = mechanism.nominal();
    let (mut drawn, mut left_out) = (Vec::with_capacity(samples.len()), Vec::new());
    let mut postures = Postures::new(mechanism);
    for sample in samples {
        let first = close_at(mechanism, &nominal, &sample.actuators, None, &mut postures.first);
        let second = sample
            .measurement
            .second()
            .map_or(Ok(()), |other| close_at(mechanism, &nominal, other, None, &mut postures.second));
        if first.and(second).is_ok() {
            let measurement = sample.measurement.expected(&postures.view(sample, &nominal));
            drawn.push(Sample { measurement, ..sample.clone() });
        } else {
            left_out.push(sample.name.clone());
        }
    }
    (drawn, left_out)
}

/// Whitened Jacobian of the samples at nominal in minimal coordinates, m x n.
fn jacobian(mechanism: &Mechanism, samples: &[Sample]) -> Result<(Mat<f64>, Option<SetAside>), DesignError> {
    let zero = vec![0.0; mechanism.component_count()];
    let problem = Calibration::new(mechanism, samples, Form::Minimal, &zero);
    let x = vec![0.0; problem.params().len()];
    let lin = problem.linearize(&x).map_err(|why| DesignError::Evaluate(why.to_string()))?;
    Ok((lin.jac, problem.set_aside().first().cloned()))
}

/// The same of candidates: [`ROWS`] rows for each in their order, each by itself whatever is measured beside it.
fn padded_jacobian(mechanism: &Mechanism, samples: &[Sample]) -> Result<Mat<f64>, DesignError> {
    let parts = ByPosture::of(samples).apart();
    let mut out: Option<Mat<f64>> = None;
    for part in &parts {
        let own: Vec<Sample> = part.iter().map(|i| samples[*i].clone()).collect();
        let (jac, aside) = jacobian(mechanism, &own)?;
        if let Some(aside) = aside {
            return Err(DesignError::Evaluate(format!("{}: {}", aside.name, aside.reason.unitless())));
        }
        let all = out.get_or_insert_with(|| Mat::zeros(ROWS * samples.len(), jac.ncols()));
        let mut next = 0;
        for (i, sample) in part.iter().zip(&own) {
            let rows = sample.measurement.rows();
            all.as_mut().subrows_mut(ROWS * i, rows).copy_from(jac.as_ref().subrows(next, rows));
            next += rows;
        }
    }
    out.ok_or(DesignError::Blind)
}

/// Right singular vectors (n x n) and singular values of the parts on top of each other, each times its factor.
fn spectrum(parts: &[(&Mat<f64>, f64)]) -> Option<(Mat<f64>, Vec<f64>)> {
    let n = parts.first().map_or(0, |(part, _)| part.ncols());
    let mut stacked = Mat::zeros(0, n);
    for (part, factor) in parts {
        let triangle = linalg::compress(part, &vec![0.0; part.nrows()]).jac;
        let upper: Mat<f64> = stacked;
        stacked =
            Mat::from_fn(upper.nrows() + triangle.nrows(), n, |i, j| match i.checked_sub(upper.nrows()) {
                None => upper[(i, j)],
                Some(i) => factor * triangle[(i, j)],
            });
    }
    let svd = linalg::svd(stacked.as_ref())?;
    Some((svd.v, svd.s))
}
