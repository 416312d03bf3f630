//! Whether residuals depend on the order in which they were read (docs/theory.md (10.12), (10.13)).

use super::linear::{Linear, Residual};
use super::pattern::{Fit, Pattern};
use crate::linalg;
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use statrs::distribution::{ContinuousCDF, Normal};

/// Probability with which readings that follow each other are called alike where they are not, and a drift found
/// where there is none.
const FALSE_ALARM: f64 = 5e-4;
/// Correlation below which nothing is said.
const FAINT: f64 = 0.1;
/// Pairs below which nothing is said.
const FEW: usize = 12;

/// Readings that follow each other err alike.
#[derive(Clone, Debug, PartialEq)]
pub struct OrderFinding {
    /// Correlation from one posture to the next.
    pub correlation: f64,
    /// Factor by which standard errors of the directions that the data decide are too small: the least and the
    /// greatest.
    pub inflation: (f64, f64),
    /// Log likelihood that it gains.
    pub gain: f64,
}

/// Readings drift from first to last.
#[derive(Clone, Debug, PartialEq)]
pub struct DriftFinding {
    /// Drift from the first to the last reading of what drifts most, in its noise.
    pub size: f64,
    /// What drifts most: index of its cell.
    pub cell: usize,
    /// Largest error of a direction that the data decide, in its standard error.
    pub shift: f64,
    /// Log likelihood that it gains.
    pub gain: f64,
}

impl OrderFinding {
    /// What was found, without a full stop.
    pub fn sentence(&self) -> String {
        let rho = self.correlation;
        let (least, most) = self.inflation;
        format!(
            "readings that follow each other in the file err alike (correlation {rho:.2} from one posture to the next): \
             they tell less than independent ones; standard errors are {least:.1} to {most:.1} times too small here, at \
             most sqrt((1 + {rho:.2})/(1 - {rho:.2})) = {:.1} times, of what all postures share",
            ((1.0 + rho) / (1.0 - rho)).sqrt()
        )
    }
}

impl DriftFinding {
    /// What was found, without a full stop; `name` is that of what drifts most.
    pub fn sentence(&self, name: &str) -> String {
        format!(
            "readings drift in the order of the file: {name} by {:.1} times the noise from first to last; the drift shifts \
             what is identified by up to {:.1} standard errors, which do not know of it",
            self.size, self.shift
        )
    }
}

/// Of each posture of the model the one before it whose residuals are of the same cells.
pub(super) fn predecessors(linear: &Linear) -> Vec<Option<usize>> {
    let cells = |k: usize| &linear.cell[linear.spans[k].clone()];
    let mut last: Option<usize> = None;
    let mut before = vec![None; linear.spans.len()];
    for k in (0..before.len()).filter(|&k| linear.active[k]) {
        before[k] = last.filter(|&p| cells(p) == cells(k));
        last = Some(k);
    }
    before
}

/// Tests whether residuals of postures resemble those of their predecessors, in a model whose rows are in standard
/// deviations.
pub(super) fn order(linear: &Linear, residual: &Residual, before: &[Option<usize>]) -> Option<OrderFinding> {
    let pairs: Vec<(usize, usize)> =
        before.iter().enumerate().filter_map(|(k, p)| Some(((*p)?, k))).collect();
    if pairs.len() < FEW {
        return None;
    }
    let z = resemblance(linear, residual, &pairs)?.1;
    if z < Normal::standard().inverse_cdf(1.0 - FALSE_ALARM) {
        return None;
    }
    let chain = Chain::new(linear, before);
    let none = chain.objective(linear, residual.freedom, 0.0)?;
    let at = |rho: f64| chain.objective(linear, residual.freedom, rho).unwrap_or(f64::INFINITY);
    let best = |grid: &mut dyn Iterator<Item = f64>| {
        grid.map(|rho| (rho, at(rho))).min_by(|a, b| a.1.total_cmp(&b.1))
    };
    let (coarse, _) = best(&mut (1..20).map(|k| 0.05 * f64::from(k)))?;
    let fine = best(&mut (-4..5).map(|k| (coarse + 0.01 * f64::from(k)).clamp(0.01, 0.99)))?;
    let (correlation, objective) = fine;
    let gain = 0.5 * (none - objective);
    (correlation > FAINT && gain > 0.0).then(|| OrderFinding {
        correlation,
        inflation: inflation(linear, before, correlation).unwrap_or((1.0, 1.0)),
        gain,
    })
}

/// Correlation over pairs of postures and how many of its standard deviations it is above what the estimate makes of
/// independent noise.
pub(super) fn resemblance(
    linear: &Linear,
    residual: &Residual,
    pairs: &[(usize, usize)],
) -> Option<(f64, f64)> {
    let (mut sum, mut expected, mut variance, mut norm) = (0.0, 0.0, 0.0, 0.0);
    let n = linear.at.len();
    let scale = residual.scale();
    for &(p, k) in pairs {
        for (i, j) in linear.spans[p].clone().zip(linear.spans[k].clone()) {
            sum += residual.r[i] * residual.r[j];
            expected -= scale * (0..n).map(|c| residual.taken[(i, c)] * linear.jac[(j, c)]).sum::<f64>();
            variance += residual.variance[i] * residual.variance[j];
            norm += (residual.variance[i] * residual.variance[j]).sqrt();
        }
    }
    let z = (sum - expected) / (scale * variance.sqrt());
    z.is_finite().then_some(((sum - expected) / (scale * norm), z))
}

/// Normal matrices of which those of rows less a part of their predecessors consist.
struct Chain {
    first: Mat<f64>,
    later: Mat<f64>,
    earlier: Mat<f64>,
    across: Mat<f64>,
    /// Rows that have a predecessor.
    rows: usize,
}

impl Chain {
    fn new(linear: &Linear, before: &[Option<usize>]) -> Self {
        let n = linear.at.len();
        let entry = |i: usize, j: usize| if j == n { linear.r[i] } else { linear.jac[(i, j)] };
        let stack = |rows: &[usize]| Mat::from_fn(rows.len(), n + 1, |i, j| entry(rows[i], j));
        let (mut first, mut later, mut earlier) = (Vec::new(), Vec::new(), Vec::new());
        for (k, p) in before.iter().enumerate().filter(|(k, _)| linear.active[*k]) {
            match p {
                Some(p) => {
                    later.extend(linear.spans[k].clone());
                    earlier.extend(linear.spans[*p].clone());
                }
                None => first.extend(linear.spans[k].clone()),
            }
        }
        let rows = later.len();
        let (first, later, earlier) = (stack(&first), stack(&later), stack(&earlier));
        let across = later.transpose() * &earlier;
        Self {
            first: first.transpose() * &first,
            across: &across + across.transpose(),
            later: later.transpose() * &later,
            earlier: earlier.transpose() * &earlier,
            rows,
        }
    }

    /// -2 log of the restricted likelihood of a correlation, the size of the noise being what it is best.
    fn objective(&self, linear: &Linear, freedom: f64, rho: f64) -> Option<f64> {
        let n = linear.at.len();
        let rest = 1.0 - rho * rho;
        let of = |i: usize, j: usize| {
            let pair = self.later[(i, j)] + rho * rho * self.earlier[(i, j)] - rho * self.across[(i, j)];
            self.first[(i, j)] + pair / rest
        };
        let a = Mat::from_fn(n, n, |i, j| of(i, j) + linear.prior[(i, j)]);
        let pull = linalg::mul(linear.prior.as_ref(), &linear.at);
        let g: Vec<f64> = (0..n).map(|i| of(i, n) + pull[i]).collect();
        let llt = a.llt(Side::Lower).ok()?;
        let lower = llt.L();
        let log_det: f64 = (0..n).map(|i| 2.0 * lower[(i, i)].ln()).sum();
        let solved = llt.solve(&Mat::from_fn(n, 1, |i, _| g[i]));
        let gained: f64 = (0..n).map(|i| g[i] * solved[(i, 0)]).sum();
        let square = of(n, n) + linalg::dot(&pull, &linear.at) - gained;
        let out = log_det + self.rows as f64 * rest.ln() + freedom * (square / freedom).ln();
        out.is_finite().then_some(out)
    }
}

/// Least and greatest factor on standard errors of directions that the data decide, where noise has this correlation
/// and the estimate does not know.
fn inflation(linear: &Linear, before: &[Option<usize>], rho: f64) -> Option<(f64, f64)> {
    let n = linear.at.len();
    // Row by row the sum of all earlier ones of its chain, each times its correlation.
    let mut sums: Mat<f64> = Mat::zeros(linear.r.len(), n);
    let (mut own, mut cross): (Mat<f64>, Mat<f64>) = (Mat::zeros(n, n), Mat::zeros(n, n));
    let active = linear.active_rows();
    for (k, p) in before.iter().enumerate() {
        let Some(p) = p else { continue };
        for (i, j) in linear.spans[k].clone().zip(linear.spans[*p].clone()) {
            for c in 0..n {
                sums[(i, c)] = rho * (sums[(j, c)] + linear.jac[(j, c)]);
            }
        }
    }
    let on = Mat::from_fn(linear.r.len(), n, |i, j| if active[i] { linear.jac[(i, j)] } else { 0.0 });
    own += on.transpose() * &on;
    cross += on.transpose() * &sums;
    let svd = linalg::svd(own.as_ref())?;
    let ratios = svd.s.iter().enumerate().filter(|(_, s)| **s > 1.0).map(|(k, s)| {
        let v: Vec<f64> = svd.v.col(k).iter().copied().collect();
        let extra = 2.0 * linalg::dot(&v, &linalg::mul(cross.as_ref(), &v));
        (1.0 + extra / s).max(0.0).sqrt()
    });
    let (least, most) = ratios.fold((f64::INFINITY, 0.0_f64), |(a, b), v| (a.min(v), b.max(v)));
    (most > 0.0).then_some((least, most))
}

/// Takes from each row of a matrix the part of its predecessor's that leaves independent noise.
pub(super) fn decorrelate(linear: &Linear, before: &[Option<usize>], rho: f64, rows: &mut Mat<f64>) {
    let rest = (1.0 - rho * rho).sqrt();
    // From the last one back: predecessors are taken as they were.
    for (k, p) in before.iter().enumerate().rev() {
        let Some(p) = p else { continue };
        for (i, j) in linear.spans[k].clone().zip(linear.spans[*p].clone()) {
            (0..rows.ncols()).for_each(|c| rows[(i, c)] = (rows[(i, c)] - rho * rows[(j, c)]) / rest);
        }
    }
}

/// Undoes [`decorrelate`].
pub(super) fn recorrelate(linear: &Linear, before: &[Option<usize>], rho: f64, rows: &mut Mat<f64>) {
    let rest = (1.0 - rho * rho).sqrt();
    for (k, p) in before.iter().enumerate() {
        let Some(p) = p else { continue };
        for (i, j) in linear.spans[k].clone().zip(linear.spans[*p].clone()) {
            (0..rows.ncols()).for_each(|c| rows[(i, c)] = rows[(i, c)] * rest + rho * rows[(j, c)]);
        }
    }
}

/// Columns of a drift: the order of the samples, from -1/2 to 1/2, one column a cell.
pub(super) fn drift_pattern(linear: &Linear) -> Pattern {
    let last = linear.spans.len().saturating_sub(1).max(1) as f64;
    let mut columns = Mat::zeros(linear.r.len(), linear.cells.len());
    for (k, span) in linear.spans.iter().enumerate() {
        for i in span.clone() {
            columns[(i, linear.cell[i])] = k as f64 / last - 0.5;
        }
    }
    Pattern { columns }
}

/// A drift, where the fit of its pattern is beyond chance: of the cell whose drift is best known not to be 0.
pub(super) fn drift(linear: &Linear, pattern: &Pattern, fit: &Fit) -> Option<DriftFinding> {
    if fit.probability > FALSE_ALARM {
        return None;
    }
    let known = |j: &usize| fit.amounts[*j].abs() / fit.errors[*j].max(f64::MIN_POSITIVE);
    let cell = (0..fit.amounts.len().min(fit.errors.len())).max_by(|a, b| known(a).total_cmp(&known(b)))?;
    let size = fit.amounts[cell];
    Some(DriftFinding {
        size: size.abs(),
        cell,
        shift: shift(linear, &pattern.columns, &fit.amounts).unwrap_or(0.0),
        gain: fit.gain,
    })
}

/// How far errors of the readings that the model does not have carry the estimate: the largest shift of a direction that
/// the data decide, in its standard error.
pub(super) fn shift(linear: &Linear, columns: &Mat<f64>, amounts: &[f64]) -> Option<f64> {
    let active = linear.active_rows();
    let errors = linalg::mul(columns.as_ref(), amounts);
    let errors: Vec<f64> = errors.iter().zip(active).map(|(e, on)| if on { *e } else { 0.0 }).collect();
    let n = linear.at.len();
    let a = linear.jac.transpose() * &linear.jac + &linear.prior;
    let llt = a.llt(Side::Lower).ok()?;
    let g = linalg::mul_transpose(linear.jac.as_ref(), &errors);
    // Of all directions `d` the largest |d' A^-1 g| / sqrt(d' A^-1 d).
    let moved = llt.solve(&Mat::from_fn(n, 1, |i, _| g[i]));
    let square: f64 = g.iter().enumerate().map(|(i, g)| g * moved[(i, 0)]).sum();
    Some(square.max(0.0).sqrt()).filter(|shift| shift.is_finite())
}
