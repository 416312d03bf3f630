//! Postures that stand out, judged by the estimate that the others give (docs/theory.md (10.9)).

use super::linear::{Linear, Solution};
use crate::calibration::Sample;
use crate::calibration::postures::posture_name;
use crate::identify::outliers::{FALSE_ALARM, Outlier};
use crate::identify::run::Identification;
use crate::identify::score::score;
use faer::Mat;
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Variance of a residual, in that of the noise, below which it tells nothing.
const ABSORBED: f64 = 0.02;
/// Rounds of an eigenvalue decomposition, many more than it takes.
const EIGEN_ROUNDS: usize = 10_000;

/// Postures whose residual noise does not explain, worst first: their samples, and what is said of them. Those that have no
/// part in the estimate are predicted, with the variance of the prediction; of the others what the estimate takes from
/// their residual is made up for. Where the median posture is worse than noise makes it, its excess counts as noise.
pub(super) fn outlying(
    linear: &Linear,
    solution: &Solution,
    samples: &[Sample],
) -> Vec<(Vec<usize>, Outlier)> {
    let count = linear.spans.len();
    let tested: Vec<(f64, f64, f64)> = (0..count).map(|k| test(linear, solution, k)).collect();
    let law = |freedom: f64| ChiSquared::new(freedom.max(0.5));
    let inside = (0..count).filter(|&k| linear.active[k] && tested[k].1 >= 1.0);
    let excess = inside.filter_map(|k| Some(tested[k].0 / law(tested[k].1).ok()?.inverse_cdf(0.5)));
    let noise = crate::statistics::median(excess).unwrap_or(1.0).max(1.0);
    let level = FALSE_ALARM / count.max(1) as f64;
    let mut out: Vec<(Vec<usize>, Outlier)> = Vec::new();
    for (members, (value, freedom, weighted_rms)) in linear.members.iter().zip(tested) {
        let probability = law(freedom).map_or(1.0, |law| law.sf(value / noise));
        if freedom >= 1.0 && probability <= level {
            let names: Vec<&str> = members.iter().map(|&i| samples[i].name.as_str()).collect();
            let samples = names.iter().map(|name| (*name).to_owned()).collect();
            let outlier = Outlier { name: posture_name(&names), samples, weighted_rms, probability };
            out.push((members.clone(), outlier));
        }
    }
    out.sort_by(|a, b| b.1.weighted_rms.total_cmp(&a.1.weighted_rms));
    out
}

/// Those samples of a posture that stands out which noise does not explain by themselves, where it explains the others:
/// readings that were not renewed join what does not belong together. Else all.
pub(super) fn to_blame(
    found: &Identification,
    samples: &[Sample],
    members: &[usize],
    count: usize,
) -> Vec<usize> {
    let level = FALSE_ALARM / count.max(1) as f64;
    let fails = |i: &usize| {
        let one = score(&found.start, &found.geometry, std::slice::from_ref(&samples[*i]));
        one.is_none_or(|fit| {
            let rows = samples[*i].measurement.rows() as f64;
            ChiSquared::new(rows).is_ok_and(|law| law.sf(fit.weighted_rms.powi(2) * rows) <= level)
        })
    };
    let blamed: Vec<usize> = members.iter().copied().filter(|i| fails(i)).collect();
    if blamed.is_empty() { members.to_vec() } else { blamed }
}

/// The same posture, of which only these samples are named.
pub(super) fn named(outlier: &Outlier, samples: &[Sample], members: &[usize]) -> Outlier {
    let names: Vec<&str> = members.iter().map(|&i| samples[i].name.as_str()).collect();
    let samples = names.iter().map(|name| (*name).to_owned()).collect();
    Outlier { name: posture_name(&names), samples, ..outlier.clone() }
}

/// Chi-square of one posture, its degrees of freedom, and the root mean square residual.
fn test(linear: &Linear, solution: &Solution, posture: usize) -> (f64, f64, f64) {
    let rows: Vec<usize> = linear.spans[posture].clone().collect();
    let (m, n) = (rows.len(), linear.at.len());
    let own = Mat::from_fn(m, n, |i, j| linear.jac[(rows[i], j)]);
    let e = DVector::from_fn(m, |i, _| {
        let along: f64 = (0..n).map(|j| own[(i, j)] * solution.step[j]).sum();
        linear.r[rows[i]] + along
    });
    let inside = linear.active[posture];
    let by = if inside { &solution.middle } else { &solution.inverse };
    let part = &own * by * own.transpose();
    let sign = if inside { -1.0 } else { 1.0 };
    let covariance = DMatrix::from_fn(m, m, |i, j| {
        let one = if i == j { 1.0 } else { 0.0 };
        one + sign * 0.5 * (part[(i, j)] + part[(j, i)])
    });
    let Some(eigen) = SymmetricEigen::try_new(covariance, f64::EPSILON, EIGEN_ROUNDS) else {
        return (0.0, 0.0, (e.norm_squared() / m.max(1) as f64).sqrt());
    };
    let along = eigen.eigenvectors.transpose() * &e;
    let (mut value, mut freedom) = (0.0, 0.0);
    for (v, a) in eigen.eigenvalues.iter().zip(along.iter()) {
        if *v > ABSORBED {
            value += a * a / v;
            freedom += 1.0;
        }
    }
    (value, freedom, (e.norm_squared() / m.max(1) as f64).sqrt())
}
