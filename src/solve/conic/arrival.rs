//! When a run of conic steps has arrived, and what it hands back.

use super::descent::{Descent, Point};
use super::here::Here;
use super::kkt::{self, Stationarity};
use crate::linalg::{self, norm};
use crate::solve::damped::column_norms;
use crate::solve::report::{ActiveBound, Criterion, Iterate, Report};

/// KKT residual at which a run that can go no farther has arrived.
pub(super) const ARRIVED: f64 = 1e-6;
/// Norm of the influence, relative to that at the start, below which a residual counts as none.
const NO_RESIDUAL: f64 = 1e-8;
/// Iterations over which a loss without derivative must lower the merit by [`PROGRESS`] of it.
const SPAN: usize = 5;
/// See [`SPAN`].
pub(super) const PROGRESS: f64 = 1e-3;
/// Distance in tolerances within which a loss without derivative must have nothing better by [`PROGRESS`] of it.
pub(super) const REACH: f64 = 1.0;

impl Descent<'_> {
    pub(super) fn stationarity(&self, point: &Point, at: &Here) -> Stationarity {
        let influence = match &point.influence {
            Some(influence) => influence.clone(),
            None => point.loss.influence(&at.r),
        };
        let gradient = linalg::mul_transpose(at.jac.as_ref(), &influence);
        let full = if point.loss.needs_rows() { norm(&influence) } else { (2.0 * at.cost).sqrt() };
        let size = full.max(NO_RESIDUAL * point.first_influence).max(f64::MIN_POSITIVE);
        let measure = kkt::measure(&column_norms(&at.jac), size, &self.penalty, &at.x);
        let groups = self.problem.groups();
        kkt::stationarity(&gradient, &measure, &at.x, &self.penalty, self.limits, groups)
    }

    pub(super) fn stationary(&self, point: &Point) -> Option<Criterion> {
        if self.merit(point, &point.here) == 0.0 {
            Some(Criterion::Zero)
        } else if self.stationarity(point, &point.here).residual <= self.stop.gradient {
            Some(Criterion::Gradient)
        } else {
            None
        }
    }

    pub(super) fn arrived(&self, point: &Point) -> bool {
        self.stationarity(point, &point.here).residual <= ARRIVED
    }

    /// Whether the dual weights of the last program prove that the linearised problem has no point within [`REACH`]
    /// that costs less by more than [`PROGRESS`]. The proof is computed from the problem's own rows: clarabel is not
    /// believed. With weights `y`, `loss(r + J d) >= y'r + (J'y)'d >= y'r - |J'y| |d|`, where what a limit holds back
    /// does not count.
    pub(super) fn proved(&self, point: &Point) -> bool {
        let (Some(weights), true) = (&point.influence, self.problem.has_prior()) else {
            return false;
        };
        let Some(supported) = point.loss.supported(&point.here.r, weights) else {
            return false;
        };
        let x = &point.here.x;
        let mut slope = linalg::mul_transpose(point.here.jac.as_ref(), weights);
        for (i, slope) in slope.iter_mut().enumerate() {
            let held = if *slope < 0.0 { x[i] >= self.limits.upper[i] } else { x[i] <= self.limits.lower[i] };
            if held {
                *slope = 0.0;
            }
        }
        let merit = self.merit(point, &point.here);
        merit - (supported - REACH * norm(&slope)) <= PROGRESS * merit
    }

    pub(super) fn finish(&self, point: Point, mut report: Report) -> Report {
        self.note(self.stationarity(&point, &point.here), &mut report);
        report.cost = point.here.cost;
        report.x = point.here.x;
        report
    }

    fn note(&self, stationarity: Stationarity, report: &mut Report) {
        let (params, groups) = (self.problem.params(), self.problem.groups());
        report.active = stationarity
            .bounds
            .iter()
            .map(|&(i, limit, multiplier)| ActiveBound { name: params[i].name.clone(), limit, multiplier })
            .chain(stationarity.cones.iter().map(|&(g, multiplier)| ActiveBound {
                name: groups[g].name.clone(),
                limit: self.limits.cone,
                multiplier,
            }))
            .collect();
        report.kkt = Some(stationarity.residual);
    }

    /// Writes into `report` how stationary its point is for this problem, and what limits hold it.
    pub fn judge(&self, report: &mut Report) {
        let Ok(here) = Here::at(self.problem, &report.x, self.loss.needs_rows()) else { return };
        let point = self.point(here);
        let stationarity = self.stationarity(&point, &point.here);
        self.note(stationarity, report);
    }
}

pub(super) fn ended(tiny: bool, flat: bool) -> Option<Criterion> {
    if tiny {
        Some(Criterion::Step)
    } else if flat {
        Some(Criterion::Cost)
    } else {
        None
    }
}

pub(super) fn stalled(trace: &[Iterate]) -> bool {
    let before = trace.len().checked_sub(SPAN + 1).and_then(|index| trace.get(index));
    before.zip(trace.last()).is_some_and(|(before, last)| before.cost - last.cost < PROGRESS * last.cost)
}
