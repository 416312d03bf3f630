//! A problem with a prior is again a problem: rows of the prior below the residual.

use super::identifier::Stop;
use super::report::{Failure, Outcome, Report};
use super::split::prior_weight;
use crate::linalg;
use crate::problem::{Compressed, EvalError, Group, Linearized, Param, Problem, Representative, cost};
use faer::{Mat, MatRef};
use std::borrow::Cow;
use std::ops::Range;

/// `min |r(x)|^2 / 2 + |A'z|^2 / 2`, `z` the coordinates of what is not redundant: those of the equivalent description of
/// `x` that has nothing along the redundancy at nominal, or `x` itself where nothing is redundant. What is redundant is
/// not pulled.
pub struct Anchored<'p> {
    inner: &'p dyn Problem,
    /// `A'`, one row a direction.
    rows: Mat<f64>,
    /// Principal directions of the Jacobian by `z` where the anchors were laid, by columns, and the curvature along each,
    /// anchors included; none of a ridge.
    directions: Mat<f64>,
    curvature: Vec<f64>,
    /// Whether the anchors stand on `z` instead of `x`.
    on_representative: bool,
}

/// Most splits, each after a run under the one before: as many as it takes at the slowest rate that goes on, a half, from
/// ten tolerances to [`SETTLED`].
const SPLITS: usize = 30;
/// How far, in tolerances, a solution may still move under the prior's weights at its end.
pub const SETTLED: f64 = 1e-8;

/// Jacobian by the coordinates `z` of the representative from that by `x`: no row sees what `z` leaves out.
pub fn by_representative(jac: MatRef<'_, f64>, of: &Representative) -> Mat<f64> {
    use faer::linalg::solvers::Solve;
    // The rows of dz/dx are orthonormal but for the deviations: their products are next to the identity.
    let by = of.jac.as_ref();
    let products = (by * by.transpose()).partial_piv_lu();
    products.solve(by * jac.transpose()).transpose().to_owned()
}

impl<'p> Anchored<'p> {
    /// A ridge: every coordinate anchored with `weight` (dimensionless: x counts in tolerances, r in standard
    /// deviations).
    pub fn ridge(inner: &'p dyn Problem, weight: f64) -> Self {
        let n = inner.params().len();
        let root = weight.max(0.0).sqrt();
        let rows = Mat::from_fn(n, n, |i, j| if i == j { root } else { 0.0 });
        let (directions, curvature) = (Mat::zeros(n, 0), Vec::new());
        Self { inner, rows, directions, curvature, on_representative: false }
    }

    /// The columns of `A` are the directions whose singular value at `x` is low, in units of `threshold`, times
    /// the root of [`prior_weight`]: without them flat valleys of a machine are followed for hundreds of steps that
    /// mean nothing (docs/theory.md section 6). `here` is the problem at `x`. `None` where singular values cannot be had.
    pub fn at(inner: &'p dyn Problem, x: &[f64], here: &Compressed, threshold: f64) -> Option<Self> {
        let representative = inner.representative(x);
        let svd = match &representative {
            Some(of) => linalg::svd(by_representative(here.jac.as_ref(), of).as_ref())?,
            None => linalg::svd(here.jac.as_ref())?,
        };
        let n = svd.v.nrows();
        let sizes: Vec<f64> = (0..n).map(|i| svd.s.get(i).copied().unwrap_or(0.0)).collect();
        let weights: Vec<f64> = sizes.iter().map(|s| prior_weight(s / threshold)).collect();
        let weak: Vec<usize> = (0..n).filter(|&i| weights[i] > 0.0).collect();
        Some(Self {
            inner,
            rows: Mat::from_fn(weak.len(), n, |i, j| weights[weak[i]].sqrt() * svd.v[(j, weak[i])]),
            curvature: sizes.iter().zip(&weights).map(|(s, w)| s * s + w).collect(),
            directions: svd.v,
            on_representative: representative.is_some(),
        })
    }

    /// How far the solution `x` under the anchors `before` moves, to first order, under these, laid there.
    fn shift(&self, before: &Self, x: &[f64]) -> f64 {
        let z = match self.representative(x) {
            Some(of) => of.z,
            None => x.to_vec(),
        };
        let pull = |anchored: &Self| {
            linalg::mul_transpose(anchored.rows.as_ref(), &linalg::mul(anchored.rows.as_ref(), &z))
        };
        let difference: Vec<f64> = pull(self).iter().zip(pull(before)).map(|(a, b)| a - b).collect();
        let along = linalg::mul_transpose(self.directions.as_ref(), &difference);
        along.iter().zip(&self.curvature).map(|(a, c)| (a / c).powi(2)).sum::<f64>().sqrt()
    }

    /// `A'z` and its derivative by `x`.
    fn anchors(&self, x: &[f64]) -> (Vec<f64>, Cow<'_, Mat<f64>>) {
        match self.representative(x) {
            Some(of) => (linalg::mul(self.rows.as_ref(), &of.z), Cow::Owned(&self.rows * of.jac)),
            None => (linalg::mul(self.rows.as_ref(), x), Cow::Borrowed(&self.rows)),
        }
    }

    fn extend(&self, jac: &Mat<f64>, mut r: Vec<f64>, x: &[f64]) -> (Mat<f64>, Vec<f64>) {
        let (values, rows) = self.anchors(x);
        let m = jac.nrows();
        let mut stacked = Mat::zeros(m + values.len(), x.len());
        stacked.as_mut().subrows_mut(0, m).copy_from(jac);
        stacked.as_mut().subrows_mut(m, values.len()).copy_from(rows.as_ref());
        r.extend(values);
        (stacked, r)
    }
}

impl Problem for Anchored<'_> {
    fn params(&self) -> &[Param] {
        self.inner.params()
    }

    fn groups(&self) -> &[Group] {
        self.inner.groups()
    }

    fn has_prior(&self) -> bool {
        self.inner.has_prior()
    }

    fn residual(&self, x: &[f64]) -> Result<Vec<f64>, EvalError> {
        let mut r = self.inner.residual(x)?;
        r.extend(self.anchors(x).0);
        Ok(r)
    }

    fn linearize(&self, x: &[f64]) -> Result<Linearized, EvalError> {
        let lin = self.inner.linearize(x)?;
        let (jac, r) = self.extend(&lin.jac, lin.r, x);
        Ok(Linearized { r, jac })
    }

    fn compress(&self, x: &[f64]) -> Result<Compressed, EvalError> {
        let here = self.inner.compress(x)?;
        let rows = here.r.len();
        let (jac, r) = self.extend(&here.jac, here.r, x);
        let cost = here.cost + cost(&r[rows..]);
        Ok(Compressed { cost, ..linalg::compress(&jac, &r) })
    }

    fn gradient(&self, x: &[f64]) -> Result<(f64, Vec<f64>), EvalError> {
        let (of_data, mut gradient) = self.inner.gradient(x)?;
        let (values, rows) = self.anchors(x);
        let pull = linalg::mul_transpose(rows.as_ref().as_ref(), &values);
        gradient.iter_mut().zip(pull).for_each(|(g, pull)| *g += pull);
        Ok((of_data + cost(&values), gradient))
    }

    fn blocks(&self) -> Vec<Range<usize>> {
        self.inner.blocks()
    }

    fn prior_rows(&self) -> usize {
        self.rows.nrows()
    }

    fn representative(&self, x: &[f64]) -> Option<Representative> {
        if self.on_representative { self.inner.representative(x) } else { None }
    }

    fn redundant(&self, x: &[f64]) -> Mat<f64> {
        self.inner.redundant(x)
    }
}

/// Runs an identifier on `problem` with anchors, and again with those at its end until they would move it by no
/// more than `settled` tolerances; on the plain problem where there is no prior. The report's cost is that of the data.
pub fn settle(
    problem: &dyn Problem,
    start: &[f64],
    threshold: f64,
    settled: f64,
    stop: &Stop,
    mut report: Report,
    run: impl Fn(&dyn Problem, &[f64], &Stop) -> Report,
) -> Report {
    if !problem.has_prior() {
        return run(problem, start, stop);
    }
    let mut last: Option<Anchored> = None;
    let mut shifted = f64::INFINITY;
    for _ in 0..SPLITS {
        let here = match problem.compress(&report.x) {
            Ok(here) => here,
            Err(why) => return report.fail(Failure::Start(why.0)),
        };
        let Some(anchored) = Anchored::at(problem, &report.x, &here, threshold) else {
            return report.fail(Failure::Start("the Jacobian is not finite".into()));
        };
        if let Some(before) = &last {
            let shift = anchored.shift(before, &report.x);
            // Along a flat valley the weights may swing instead of settling: another run would not end nearer.
            if shift <= settled || shift > 0.5 * shifted {
                break;
            }
            shifted = shift;
        }
        let left = Stop { iterations: stop.iterations.saturating_sub(report.trace.len()), ..*stop };
        let mut next = run(&anchored, &report.x, &left);
        if last.is_some() && next.outcome == Outcome::OutOfIterations {
            // The solution under the weights before is one; the limit only stopped their last corrections.
            break;
        }
        next.trace.splice(..0, report.trace);
        next.cost = problem.residual(&next.x).map_or(f64::INFINITY, |r| cost(&r));
        report = next;
        if !report.outcome.converged() {
            break;
        }
        last = Some(anchored);
    }
    report
}
