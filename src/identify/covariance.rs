//! Covariance of an estimate, as a square root that tells data from prior (docs/theory.md (10.1)-(10.4)).

use super::counts::Visibility;
use crate::calibration::{Calibration, Coordinates};
use crate::lie::Se3;
use crate::lie::se3::{self, Twist};
use crate::linalg::{self, RowStream};
use crate::model::{Geometry, Mechanism};
use crate::problem::{EvalError, Problem};
use crate::solve::Estimate;
use crate::solve::split::prior_weight;
use faer::Mat;

/// Singular value below which least squares without a prior has no finite error; the tolerance stands in for it.
const BLIND: f64 = 1e-6;

/// Postures whose rows are in memory at a time.
const TOGETHER: usize = 128;

/// Covariance `root root'` of the minimal coordinates.
#[derive(Clone, Debug)]
pub struct Covariance {
    /// n x k, tolerances: column by column, independent errors of one standard deviation.
    pub root: Mat<f64>,
    /// Of each column's variance, the share that stems from the tolerances and not from the noise.
    pub prior_share: Vec<f64>,
    /// By how much the estimate lowers the expected chi-square of the residual: the effective number of parameters.
    pub absorbed: f64,
}

/// A variance, and how much of it stems from the tolerances.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Variance {
    /// All of it.
    pub total: f64,
    /// The part of the prior.
    pub prior: f64,
}

impl Variance {
    /// Standard error where the noise is `ratio` times what was stated, the tolerances being true (10.10).
    pub fn scaled_error(&self, ratio: f64) -> f64 {
        ((self.total - self.prior) * ratio * ratio + self.prior).max(0.0).sqrt()
    }

    /// Share of the prior, from 0 (data) to 1 (tolerances); 0 where there is no variance.
    pub fn prior_share(&self) -> f64 {
        if self.total > 0.0 { self.prior / self.total } else { 0.0 }
    }
}

/// Weight of the prior on a direction of singular value `s`; `None` where linear theory does not apply.
pub fn weight(estimate: Estimate, s: f64) -> Option<f64> {
    match estimate {
        Estimate::Split { threshold } | Estimate::Decoupled { threshold } => {
            Some(prior_weight(s / threshold))
        }
        Estimate::Ridge { weight } => Some(weight),
        Estimate::LeastSquares => Some(if s > BLIND { 0.0 } else { 1.0 }),
        Estimate::Other => None,
    }
}

/// Variance along a direction of singular value `s` (10.1), tolerances squared; `None` where the estimate does not weigh
/// all data at once.
pub fn variance(estimate: Estimate, s: f64) -> Option<Variance> {
    match estimate {
        Estimate::Decoupled { .. } => None,
        _ => Some(direction(s, weight(estimate, s)?).0),
    }
}

/// Of one direction: variance by noise, variance by the unit prior, and what it takes from chi-square.
fn direction(s: f64, w: f64) -> (Variance, f64) {
    let square = (s * s + w).powi(2);
    let variance = Variance { total: (s * s + w * w) / square, prior: w * w / square };
    (variance, 1.0 - w * w * (1.0 + s * s) / square)
}

impl Covariance {
    /// Of an estimate that weighs all data at once (10.1); `None` where linear theory does not apply.
    pub fn joint(estimate: Estimate, seen: &Visibility) -> Option<Self> {
        let mut root = seen.directions.clone();
        let (mut prior_share, mut absorbed) = (Vec::with_capacity(root.ncols()), 0.0);
        for (k, s) in seen.singular_values.iter().enumerate() {
            let (variance, taken) = direction(*s, weight(estimate, *s)?);
            root.as_mut().col_mut(k).iter_mut().for_each(|v| *v *= variance.total.sqrt());
            prior_share.push(variance.prior_share());
            absorbed += taken;
        }
        Some(Self { root, prior_share, absorbed })
    }

    /// Of an estimate of each limb by itself (10.4): one pose's noise is common to all limbs, which the estimate did
    /// not know. `None` where the problem does not fall apart into limbs, or linear theory does not apply.
    pub fn decoupled(
        estimate: Estimate,
        problem: &Calibration<'_>,
        x: &[f64],
    ) -> Result<Option<Self>, EvalError> {
        let Some(limbs) = problem.limbs() else { return Ok(None) };
        let n = x.len();
        // Of each limb: where it is estimated, and the inverse of its information with the prior's.
        let mut inverses = Vec::with_capacity(limbs.len());
        let mut prior = Mat::<f64>::zeros(n, n);
        for (limb, members) in &limbs {
            let own: Vec<f64> = members.clone().map(|i| x[i]).collect();
            let svd = linalg::svd(limb.compress(&own)?.jac.as_ref())
                .ok_or_else(|| EvalError("a limb's Jacobian is not finite".into()))?;
            let mut scaled = svd.v.clone();
            for k in 0..own.len() {
                let s = svd.s.get(k).copied().unwrap_or(0.0);
                let Some(w) = weight(estimate, s) else { return Ok(None) };
                for (i, v) in members.clone().zip(svd.v.col(k).iter()) {
                    prior[(i, members.start + k)] = v * (w / (s * s + w));
                }
                scaled.as_mut().col_mut(k).iter_mut().for_each(|v| *v /= s * s + w);
            }
            inverses.push((own, scaled * svd.v.transpose()));
        }
        // Noise of the readings, standard deviations, to coordinates: of a few postures at a time, since all of them may
        // be more than memory holds.
        let (mut by_noise, mut whole) =
            (RowStream::new(n, problem.rows()), RowStream::new(n, problem.rows()));
        let mut trace = 0.0;
        for first in (0..problem.posture_count()).step_by(TOGETHER) {
            let part = problem.only(first..(first + TOGETHER).min(problem.posture_count()));
            let Some(limbs) = part.limbs() else { return Ok(None) };
            let rows = part.linearize(x)?.jac;
            let mut gain = Mat::<f64>::zeros(rows.nrows(), n);
            for ((limb, members), (own, inverse)) in limbs.iter().zip(&inverses) {
                let (jac, by_noise) = limb.sensitivities(own)?;
                let of_sample = 6 * jac.nrows() / rows.nrows().max(1);
                let carried = &jac * inverse;
                for sample in 0..rows.nrows() / 6 {
                    let range = of_sample * sample..of_sample * (sample + 1);
                    let block = by_noise.get(range.clone(), ..).transpose() * carried.get(range, ..);
                    gain.as_mut()
                        .submatrix_mut(6 * sample, members.start, 6, members.len())
                        .copy_from(&block);
                }
            }
            trace += (0..n).map(|j| linalg::dot(&column(&rows, j), &column(&gain, j))).sum::<f64>();
            whole.push_rows(&rows);
            by_noise.push_rows(&gain);
        }
        let data = by_noise.finish().jac.transpose().to_owned();
        let whole = whole.finish().jac;
        let square = |m: Mat<f64>| m.norm_l2().powi(2);
        let absorbed = 2.0 * trace - square(&whole * &data) - square(&whole * &prior);
        let (from_data, from_prior) = (data.ncols(), prior.ncols());
        let root = Mat::from_fn(n, from_data + from_prior, |i, j| match j.checked_sub(from_data) {
            None => data[(i, j)],
            Some(j) => prior[(i, j)],
        });
        let mut prior_share = vec![0.0; from_data];
        prior_share.resize(from_data + from_prior, 1.0);
        Ok(Some(Self { root, prior_share, absorbed }))
    }

    /// Square root by deviations of the links (rad and m, six rows a link), at deviations `at`: how the links' frames
    /// err as body twists, in the frame behind each link (10.2). Behind them one row for each constant of the instrument.
    pub fn of_links(&self, coordinates: &Coordinates, at: &[f64]) -> Mat<f64> {
        let mut out = Mat::zeros(at.len(), self.root.ncols());
        let links = coordinates.limbs.iter().map(|limb| limb.sigma.len()).sum();
        for j in 0..self.root.ncols() {
            let d = coordinates.deviations(&column(&self.root, j));
            for (i, d) in d.iter().enumerate().skip(links) {
                out[(i, j)] = *d;
            }
            for (link, (d, at)) in d[..links].chunks_exact(6).zip(at.chunks_exact(6)).enumerate() {
                let turned = se3::right_jacobian(&Twist::from_column_slice(at)) * Twist::from_column_slice(d);
                for i in 0..6 {
                    out[(6 * link + i, j)] = turned[i];
                }
            }
        }
        out
    }

    /// Variance of each component of the deviations (rad^2, m^2) that lead from `drawn` to `geometry`, where
    /// `of_links` is the square root of the links' body twists.
    pub fn of_deviations(
        &self,
        of_links: &Mat<f64>,
        drawn: &Mechanism,
        geometry: &Geometry,
    ) -> Vec<Variance> {
        let mut out = vec![Variance::default(); of_links.nrows()];
        let links: Vec<Se3> = geometry.limbs.concat();
        for (link, (g, drawn)) in links.iter().zip(drawn.nominal().limbs.concat()).enumerate() {
            // d(deviation) from the body twist: the inverse of the right Jacobian.
            let back = se3::left_jacobian_inverse(&-se3::log(&(drawn.inverse() * *g)));
            for (j, share) in self.prior_share.iter().enumerate() {
                let d = back * Twist::from_fn(|i, _| of_links[(6 * link + i, j)]);
                for (sum, d) in out[6 * link..6 * link + 6].iter_mut().zip(d.iter()) {
                    sum.total += d * d;
                    sum.prior += share * d * d;
                }
            }
        }
        for (i, sum) in out.iter_mut().enumerate().skip(6 * links.len()) {
            for (j, share) in self.prior_share.iter().enumerate() {
                let d = of_links[(i, j)];
                sum.total += d * d;
                sum.prior += share * d * d;
            }
        }
        out
    }
}

fn column(a: &Mat<f64>, j: usize) -> Vec<f64> {
    a.col(j).iter().copied().collect()
}
