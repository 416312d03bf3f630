//! The loop round the conic step: successive programs, each accepted or not on the true merit.

use super::arrival::{PROGRESS, REACH, ended, stalled};
use super::curvature::{Bent, Curvature};
use super::here::Here;
use super::limits::Limits;
use super::loss::Loss;
use super::penalty::Penalty;
use super::restore::restore;
use super::step::{Model, Step};
use crate::linalg::norm;
use crate::problem::{Problem, cost};
use crate::solve::anchored::SETTLED;
use crate::solve::identifier::Stop;
use crate::solve::report::{Criterion, Failure, Iterate, Outcome, Report};

/// Gain ratio from which a step is accepted.
const ACCEPT: f64 = 1e-4;
/// Relative change of the merit within which rounding decides; stationarity judges there.
const FLAT: f64 = 1e-9;
/// Rise of the merit, relative to it, that rounding of the residuals explains.
const ROUNDING: f64 = 1e-11;
/// Trial steps from one point.
const TRIALS: usize = 40;
/// Radius, relative to the point, below which nothing is gained by going on.
const SHORTEST: f64 = 1e-14;

/// Step, in tolerances, from which on the curvature that a linear model does not see is worth its price.
const SHORT_ENOUGH: f64 = 1.0;
/// Iterations after which it is in any case.
const LONG: usize = 6;
/// First radius, in [`REACH`], of a loss without derivative.
const FIRST: f64 = 2.0;
/// Share of [`REACH`] that counts as a short step.
const SHORT: f64 = 0.3;

/// A run: what is minimised within what.
pub struct Descent<'a> {
    /// The problem.
    pub problem: &'a dyn Problem,
    /// Cost of residuals.
    pub loss: &'a dyn Loss,
    /// Cost of deviations, the tie-breaking ridge included.
    pub penalty: Penalty,
    /// Limits of deviations.
    pub limits: &'a Limits,
    /// When to stop.
    pub stop: &'a Stop,
}

/// State between iterations.
pub(super) struct Point {
    pub(super) here: Here,
    /// The loss asked for, arranged for the rows of the problem.
    asked: Box<dyn Loss>,
    /// That in force.
    pub(super) loss: Box<dyn Loss>,
    metric: Vec<f64>,
    radius: Option<f64>,
    pub(super) influence: Option<Vec<f64>>,
    pub(super) first_influence: f64,
    curvature: Option<Curvature>,
}

enum Trial {
    Accepted(Here, Step, f64),
    Ended(Outcome),
}

impl Descent<'_> {
    /// Runs from `start`, writing into `report`.
    pub fn run(&self, start: &[f64], mut report: Report) -> Report {
        let start = match restore(start, self.limits, self.problem.groups(), self.problem.params()) {
            Ok(start) => start,
            Err(failure) => return report.fail(failure),
        };
        let here = match Here::at(self.problem, &start, self.loss.needs_rows()) {
            Ok(here) => here,
            Err(why) => return report.fail(Failure::Start(why)),
        };
        let mut point = self.point(here);
        for _ in 0..self.stop.iterations {
            if let Some(criterion) = self.stationary(&point) {
                if self.rescale(&mut point) {
                    continue;
                }
                if criterion == Criterion::Gradient {
                    self.refine(&mut point, &mut report);
                }
                report.outcome = Outcome::Converged(criterion);
                break;
            }
            match self.search(&mut point) {
                Trial::Ended(outcome) => {
                    if outcome.converged() && self.rescale(&mut point) {
                        continue;
                    }
                    report.outcome = outcome;
                    break;
                }
                Trial::Accepted(there, step, actual) => {
                    let moved: Vec<f64> = there.x.iter().zip(&point.here.x).map(|(a, b)| a - b).collect();
                    let merit = self.merit(&point, &there);
                    report.trace.push(Iterate { cost: merit, step: norm(&moved), kept: None });
                    let tiny = self.stop.by_step(norm(&moved), &there.x);
                    let flat = actual.abs() <= self.stop.cost * merit
                        && step.predicted.abs() <= self.stop.cost * merit;
                    point.here = there;
                    point.influence = step.influence;
                    let relaxed = self.retune(&mut point);
                    self.measure(&mut point);
                    self.bend(&mut point, norm(&moved), report.trace.len());
                    if !relaxed
                        && let Some(criterion) = ended(tiny, flat)
                        && !self.rescale(&mut point)
                    {
                        if criterion == Criterion::Cost {
                            self.refine(&mut point, &mut report);
                        }
                        report.outcome = Outcome::Converged(criterion);
                        break;
                    }
                    if norm(&moved) <= SHORT * REACH && self.proved(&point) {
                        report.outcome = Outcome::Converged(Criterion::Gap);
                        break;
                    }
                    if !self.loss.smooth() && stalled(&report.trace) {
                        report.outcome = match self.proved(&point) {
                            true => Outcome::Converged(Criterion::Gap),
                            false => Outcome::Failed(Failure::Stalled(PROGRESS)),
                        };
                        break;
                    }
                }
            }
        }
        self.finish(point, report)
    }

    pub(super) fn point(&self, here: Here) -> Point {
        let asked = self.loss.arranged(&self.problem.blocks(), here.r.len(), self.problem.prior_rows());
        let loss = asked.at_scale(&here.r);
        let mut point = Point {
            first_influence: norm(&loss.influence(&here.r)),
            metric: Vec::new(),
            // Without one the first linear program goes to a vertex that is far beyond where it holds.
            radius: (!self.loss.smooth() && self.problem.has_prior()).then_some(FIRST * REACH),
            influence: None,
            curvature: None,
            asked,
            loss,
            here,
        };
        self.measure(&mut point);
        point
    }

    fn model<'m>(&'m self, point: &'m Point) -> Model<'m> {
        Model {
            loss: point.loss.as_ref(),
            penalty: self.penalty,
            limits: self.limits,
            groups: self.problem.groups(),
            metric: &point.metric,
        }
    }

    pub(super) fn merit(&self, point: &Point, at: &Here) -> f64 {
        // Compressed rows lack what no step can reach; the sum of squares has it.
        let unreached = if point.loss.needs_rows() { 0.0 } else { at.cost - cost(&at.r) };
        self.model(point).merit(&at.r, &at.x) + unreached
    }

    /// Gauge-free tolerance units where the problem has them, running column norms elsewhere.
    fn measure(&self, point: &mut Point) {
        if self.problem.has_prior() {
            point.metric = vec![1.0; point.here.x.len()];
        } else {
            crate::solve::damped::raise_scale(&mut point.metric, &point.here.jac);
        }
    }

    /// Renews the curvature of the residual, once steps are short enough for it to hold, after a step of this length.
    fn bend(&self, point: &mut Point, moved: f64, iterations: usize) {
        let before = point.curvature.take();
        if point.loss.smooth() && (moved <= SHORT_ENOUGH || iterations >= LONG) {
            let (problem, penalty, limits) = (self.problem, &self.penalty, self.limits);
            let bent = Bent { problem, loss: point.loss.as_ref(), penalty, limits };
            point.curvature = bent.at(&point.here.x, before);
        }
    }

    /// Lets an eased loss follow the residual towards the loss asked for; whether it changed.
    fn retune(&self, point: &mut Point) -> bool {
        let next = point.asked.at_scale(&point.here.r);
        let (now, then) = (point.loss.merit(&point.here.r), next.merit(&point.here.r));
        // On the way an eased loss only tightens: the merit may not swing.
        if then < now * (1.0 - FLAT) {
            point.loss = next;
            return true;
        }
        false
    }

    /// At the end of a run with an eased loss, the loss that belongs to the residual there, tighter or not; whether
    /// it is another one. Where the data never come to the loss asked for, the solution is the point whose own
    /// residual eases it to the loss that the point minimises.
    fn rescale(&self, point: &mut Point) -> bool {
        let next = point.asked.at_scale(&point.here.r);
        let (now, then) = (point.loss.merit(&point.here.r), next.merit(&point.here.r));
        if (then - now).abs() <= FLAT * now {
            return false;
        }
        point.loss = next;
        point.influence = None;
        point.radius = None;
        true
    }

    /// Further steps from where gradient or cost end a run, each at most half as long as the one before, until they are
    /// nothing in tolerances.
    ///
    /// A gradient is measured against columns of the Jacobian, and a cost against the whole. Along a direction that the data
    /// hardly see, what is nothing by these measures can still be millionths of a tolerance away. Where only cone programs
    /// give the steps, as with a penalty on groups, they end at the accuracy of those.
    fn refine(&self, point: &mut Point, report: &mut Report) {
        let mut last = f64::INFINITY;
        let exact = point.loss.smooth() && self.penalty.group == 0.0;
        while exact && report.trace.len() < self.stop.iterations {
            let Ok(step) = self
                .model(point)
                .step(&point.here.bent(point.curvature.as_ref().map(|bent| &bent.rows)), point.radius)
            else {
                return;
            };
            let Ok(there) = Here::at(self.problem, &step.u, point.loss.needs_rows()) else { return };
            let (before, after) = (self.merit(point, &point.here), self.merit(point, &there));
            let residual = |at: &Here| self.stationarity(point, at).residual;
            if step.length > 0.5 * last
                || after > before * (1.0 + ROUNDING)
                || residual(&there) > self.stop.gradient.max(residual(&point.here))
            {
                return;
            }
            report.trace.push(Iterate { cost: after, step: step.length, kept: None });
            point.here = there;
            self.bend(point, step.length, report.trace.len());
            last = step.length;
            if last <= SETTLED * self.reach(point) {
                return;
            }
        }
    }

    fn search(&self, point: &mut Point) -> Trial {
        let merit = self.merit(point, &point.here);
        let mut refused = None;
        for _ in 0..TRIALS {
            let step = match self
                .model(point)
                .step(&point.here.bent(point.curvature.as_ref().map(|bent| &bent.rows)), point.radius)
            {
                Ok(step) => step,
                Err(why) => {
                    refused = Some(Failure::Inner(why.0));
                    // A shorter step is a better conditioned program.
                    let radius = 0.25 * point.radius.unwrap_or_else(|| self.reach(point));
                    point.radius = Some(radius);
                    if radius <= SHORTEST * self.reach(point) || self.arrived(point) {
                        break;
                    }
                    continue;
                }
            };
            let tiny = step.length <= f64::EPSILON * self.reach(point);
            let mut ratio = f64::NEG_INFINITY;
            match Here::at(self.problem, &step.u, point.loss.needs_rows()) {
                Ok(there) => {
                    let actual = merit - self.merit(point, &there);
                    // A step that promises nothing is the solver's rounding.
                    if step.predicted > 0.0 {
                        ratio = actual / step.predicted;
                    }
                    let flat = step.predicted.abs() <= FLAT * merit && actual.abs() <= FLAT * merit;
                    let improves = || {
                        self.stationarity(point, &there).residual
                            < 0.9 * self.stationarity(point, &point.here).residual
                    };
                    if ratio > ACCEPT || (flat && improves()) {
                        resize(point, &step, if flat { 1.0 } else { ratio });
                        return Trial::Accepted(there, step, actual);
                    }
                    if tiny || (flat && step.predicted <= self.stop.cost.max(f64::EPSILON) * merit) {
                        let criterion = if tiny { Criterion::Step } else { Criterion::Cost };
                        return Trial::Ended(Outcome::Converged(criterion));
                    }
                    refused = None;
                }
                Err(why) => refused = Some(Failure::Evaluation(why)),
            }
            if tiny || self.arrived(point) {
                break;
            }
            resize(point, &step, ratio);
        }
        if self.arrived(point) {
            return Trial::Ended(Outcome::Converged(Criterion::Step));
        }
        Trial::Ended(Outcome::Failed(refused.unwrap_or(Failure::NoDescent)))
    }

    fn reach(&self, point: &Point) -> f64 {
        point.metric.iter().zip(&point.here.x).map(|(d, x)| (d * x).powi(2)).sum::<f64>().sqrt().max(1.0)
    }
}

/// The next radius: shorter after a poor step, none again after a good one that it did not limit.
fn resize(point: &mut Point, step: &Step, ratio: f64) {
    let limited = point.radius.is_some_and(|radius| step.length >= 0.9 * radius);
    if ratio < 0.25 {
        let least = 1.0 / (2.0 * (1.0 - ratio.max(-1e3)));
        point.radius = Some(step.length * least.clamp(0.1, 0.5));
    } else if ratio > 0.75 {
        let free = step.influence.is_none();
        point.radius = match point.radius {
            Some(_) if limited => Some(2.0 * step.length),
            // Where the program sees no curvature the region stands in for it.
            Some(radius) if !free => Some(radius),
            _ => None,
        };
    }
}
