//! The default: Gauss-Newton that leaves to the data what the data knows better than the tolerance.

use super::bend::bent;
use super::identifier::{Identifier, SettingError, Stop};
use super::map::ridge;
use super::report::{Criterion, Estimate, Failure, Iterate, Outcome, Report};
use super::split::{Model, Split};
use super::valley::floor;
use crate::linalg::{self, norm};
use crate::problem::{Compressed, EvalError, Problem};

/// Gauss-Newton on the minimal coordinates.
///
/// The whitened Jacobian `J = U S V'` splits the coordinates: *kept* directions, with `s > threshold`, follow the
/// data alone; on the others, which the tolerance knows better than the data, stands the unit prior. The
/// iteration minimises `|r|^2 / 2 + |P x|^2 / 2`, `P` the projector on the directions that are not kept, and takes
/// a step only if that merit falls at its end; until then damping shortens it (docs/theory.md section 6).
///
/// Split and curvature are renewed where the last step was long or not as good as promised, and kept otherwise,
/// with the exact gradient: the end of an iteration costs no factorisation, and a singular value near the
/// threshold cannot make it swing.
///
/// A step that a curved valley spoils is corrected before it is damped. After fifteen iterations the weak directions have
/// the curvature of the merit itself, which second derivatives of the residual decide there. Where the iteration ends
/// nowhere all the same, valleys that the prior leaves to the data lead out of reach: then the full prior stands on every
/// direction, as `map` has it.
#[derive(Clone, Copy, Debug)]
pub struct Minimal {
    /// Signal-to-noise ratio above which a direction is kept.
    pub threshold: f64,
    /// Whether the curvature is renewed at every step, not just the long ones.
    renewing: bool,
}

impl Default for Minimal {
    fn default() -> Self {
        Self { threshold: 1.0, renewing: false }
    }
}

impl Minimal {
    /// The same with the curvature renewed at every step: for problems of few coordinates, whose factorisation costs
    /// little beside their rows.
    pub(super) fn renewing() -> Self {
        Self { renewing: true, ..Self::default() }
    }
}

/// First damping after a rejected step, as a part of the prior's weight or of the Jacobian's columns.
const FIRST_DAMPING: f64 = 0.1;
/// Damping beyond which no step is left.
const LARGEST_DAMPING: f64 = 1e16;
/// Singular values at most this, relative to the largest, are zero to rounding.
const ROUNDING: f64 = 1e-13;
/// Promised reduction, relative to the merit, that rounding of the residuals may hide.
const UNJUDGED: f64 = 1e-9;
/// Promised reduction, relative to the merit, that is too little to look for at the end of a short step.
const UNSEEN: f64 = 1e-12;
/// Merit that is nothing where residuals are in standard deviations: 1e-6 of one.
const NOTHING: f64 = 1e-12;
/// Way, in tolerances, up to which split and curvature are kept.
const NEAR: f64 = 0.3;
/// Iterations after which weak directions get the curvature that a linear model does not have.
const SLOW: usize = 15;
/// Residual, standard deviations a reading in the root mean square, up to which it is asked for: beyond, as where a gross error
/// pulls, the residual bends the merit everywhere, and that says nothing of the way.
const SPOILED: f64 = 10.0;
/// Ratio of successive steps up to which such a curvature is kept.
const CONTRACTING: f64 = 0.5;
/// Renewals after which only the curvature is renewed, so that the merit is one and the same from then on.
const SPLITS: usize = 12;

impl Identifier for Minimal {
    fn name(&self) -> &'static str {
        "minimal"
    }

    fn summary(&self) -> &'static str {
        "Gauss-Newton on minimal coordinates; what the tolerance knows better than the data stays near nominal (default)"
    }

    fn set(&mut self, key: &str, value: &str) -> Result<(), SettingError> {
        if key != "threshold" {
            let known = "; it has: threshold".into();
            return Err(SettingError::Unknown { solver: self.name(), key: key.into(), known });
        }
        match value.parse::<f64>() {
            Ok(threshold) if threshold > 0.0 && threshold.is_finite() => {
                self.threshold = threshold;
                Ok(())
            }
            _ => Err(SettingError::Value {
                solver: self.name(),
                key: key.into(),
                value: value.into(),
                why: "it must be a positive number".into(),
            }),
        }
    }

    fn settings(&self) -> Vec<(&'static str, String)> {
        vec![("threshold", self.threshold.to_string())]
    }

    fn identify(&self, problem: &dyn Problem, start: &[f64], stop: &Stop) -> Report {
        let estimate = match problem.has_prior() {
            true => Estimate::Split { threshold: self.threshold },
            false => Estimate::LeastSquares,
        };
        let report = Report::new(self.name(), start, estimate);
        if self.renewing || !problem.has_prior() {
            return self.iterate(problem, None, stop, report);
        }
        // As many iterations are left for the full prior, should it come to that.
        let iterations = stop.iterations.div_ceil(2);
        let report = self.iterate(problem, None, &Stop { iterations, ..*stop }, report);
        if report.outcome.converged() {
            return report;
        }
        self.under_full_prior(problem, start, stop, report)
    }
}

impl Minimal {
    /// The estimate with the full prior on every direction, from where the iteration of `report` stood, or from `start` where
    /// it could go no further; `report` where that is not found either.
    fn under_full_prior(
        &self,
        problem: &dyn Problem,
        start: &[f64],
        stop: &Stop,
        mut report: Report,
    ) -> Report {
        let left = Stop { iterations: stop.iterations.saturating_sub(report.trace.len()), ..*stop };
        let from = if report.outcome == Outcome::OutOfIterations { &report.x } else { start };
        let under = Report::new(self.name(), from, Estimate::Ridge { weight: 1.0 });
        let found = ridge(problem, 1.0, from, &left, under);
        report.trace.extend_from_slice(&found.trace);
        match found.outcome.converged() {
            true => Report { trace: report.trace, ..found },
            false => report,
        }
    }

    /// Iterates from `report.x`, under the split `fixed` where one is given.
    pub(super) fn iterate(
        &self,
        problem: &dyn Problem,
        fixed: Option<Split>,
        stop: &Stop,
        mut report: Report,
    ) -> Report {
        let nothing = if problem.has_prior() { NOTHING } else { 0.0 };
        let mut damping = 0.0;
        let mut model: Option<Model> = None;
        let mut settled = fixed.clone();
        let mut splits = 0;
        let (mut cost, mut gradient) = (f64::INFINITY, Vec::new());
        let (mut promised_before, mut length_before) = (f64::INFINITY, f64::INFINITY);
        let mut reached: Option<Compressed> = None;
        let mut bends = problem.has_prior() && !self.renewing;
        let mut rows: Option<usize> = None;
        while report.trace.len() < stop.iterations {
            let late = bends && report.trace.len() >= SLOW;
            if late && rows.is_none() {
                rows = problem.residual(&report.x).ok().map(|r| r.len());
            }
            let slow = late && rows.is_some_and(|rows| 2.0 * cost <= SPOILED.powi(2) * rows as f64);
            if let Some(straight) = model.take_if(|kept| slow && !kept.is_bent()) {
                settled = Some(straight.split);
            }
            let fresh = model.is_none();
            let current = match model.take() {
                Some(kept) => kept,
                None => match self.model(problem, &report.x, settled.take(), reached.take()) {
                    Ok((renewed, at)) => {
                        splits += 1;
                        let renewed = match slow {
                            true => bent(problem, &report.x, &at, renewed, self.threshold),
                            false => renewed,
                        };
                        // Where there is none to be had, it is not asked for again.
                        bends &= !slow || renewed.is_bent();
                        cost = at.cost;
                        gradient = linalg::mul_transpose(at.jac.as_ref(), &at.r);
                        renewed
                    }
                    Err(why) if report.trace.is_empty() => return report.fail(Failure::Start(why)),
                    Err(why) => return report.fail(Failure::Evaluation(why)),
                },
            };
            report.cost = cost;
            let merit = cost + current.split.penalty(&report.x);
            let origin = Origin { x: &report.x, gradient: &gradient, merit };
            let step = loop {
                let dx = match fresh && !current.is_bent() {
                    true => current.fresh_step(damping),
                    false => current.stale_step(&report.x, &gradient, damping),
                };
                let undamped = (damping == 0.0).then_some(stop);
                match self.try_step(problem, &current, &origin, dx, undamped, (fresh, damping)) {
                    Ok(step) => break step,
                    // A stale model is renewed before it is damped.
                    Err(_) if !fresh => break None,
                    Err(_) if damping < LARGEST_DAMPING => damping = (damping * 4.0).max(FIRST_DAMPING),
                    Err(failure) => return report.fail(failure),
                }
            };
            settled = (fixed.is_some() || slow || splits >= SPLITS).then(|| current.split.clone());
            let Some(step) = step else { continue };
            let unjudged = step.promised <= UNJUDGED * merit;
            let ratio = if unjudged { 1.0 } else { step.gained / step.promised };
            let length = norm(&step.dx);
            report.x = report.x.iter().zip(&step.dx).map(|(x, dx)| x + dx).collect();
            (cost, gradient, reached) = (step.cost, step.gradient, step.reached);
            report.cost = cost;
            let left = merit - step.gained;
            report.trace.push(Iterate { cost: left, step: length, kept: current.split.kept() });
            // Steps whose promise no longer shrinks are rounding.
            let at_rounding = unjudged && step.promised > 0.25 * promised_before;
            promised_before = step.promised;
            let criterion = step.ends.or_else(|| match damping > 0.0 {
                true => None,
                false if cost == 0.0 || left <= nothing => Some(Criterion::Zero),
                false => at_rounding.then_some(Criterion::Cost),
            });
            if let Some(criterion) = criterion {
                report.outcome = Outcome::Converged(criterion);
                return report;
            }
            if ratio > 0.75 {
                damping = if damping <= FIRST_DAMPING { 0.0 } else { 0.3 * damping };
            } else if ratio < 0.25 {
                damping = (damping * 2.0).max(FIRST_DAMPING);
            }
            let contracting = !current.is_bent() || length <= CONTRACTING * length_before;
            length_before = length;
            if length <= NEAR && contracting && (0.5..1.5).contains(&ratio) {
                match self.renewing {
                    true => settled = Some(current.split),
                    false => model = Some(current),
                }
            }
        }
        report
    }
}

/// Where a step starts.
struct Origin<'a> {
    x: &'a [f64],
    /// Of the cost.
    gradient: &'a [f64],
    merit: f64,
}

/// A step that was taken, and what it led to.
struct Taken {
    dx: Vec<f64>,
    promised: f64,
    gained: f64,
    cost: f64,
    gradient: Vec<f64>,
    /// The linearised problem there, where it was computed.
    reached: Option<Compressed>,
    /// Why it is the last, where it is.
    ends: Option<Criterion>,
}

impl Minimal {
    /// Gauss-Newton model at `x`, under the given split or a new one, from the linearised problem there if it is known.
    fn model(
        &self,
        problem: &dyn Problem,
        x: &[f64],
        settled: Option<Split>,
        known: Option<Compressed>,
    ) -> Result<(Model, Compressed), String> {
        let here = match known {
            Some(known) => known,
            None => problem.compress(x).map_err(|why| why.0)?,
        };
        let prior = problem.has_prior();
        let threshold = match prior || settled.is_some() {
            true => Some(self.threshold),
            false => linalg::singular_values(here.jac.as_ref())
                .map(|s| ROUNDING * s.first().copied().unwrap_or(0.0)),
        };
        let model = threshold.and_then(|threshold| Model::at(&here, x, threshold, prior, settled));
        Ok((model.ok_or("the Jacobian is not finite")?, here))
    }

    /// Takes the step if the merit falls at its end, or if it promises less than rounding can show. An undamped
    /// step that ends the iteration is taken unseen where no cost could show what it does: its end costs what the model
    /// says, to rounding.
    ///
    /// Where an undamped step is long, its end is linearised at once: the model will be renewed there.
    fn try_step(
        &self,
        problem: &dyn Problem,
        model: &Model,
        origin: &Origin<'_>,
        dx: Option<Vec<f64>>,
        undamped: Option<&Stop>,
        (fresh, damping): (bool, f64),
    ) -> Result<Option<Taken>, Failure> {
        let dx = dx.ok_or(Failure::NoDescent)?;
        let promised = model.promise(origin.x, origin.gradient, &dx);
        let trial: Vec<f64> = origin.x.iter().zip(&dx).map(|(x, dx)| x + dx).collect();
        let length = norm(&dx);
        let negligible = |part: f64| (0.0..=part * origin.merit).contains(&promised);
        let short = undamped.is_some_and(|stop| stop.by_step(length, origin.x));
        let ends = match undamped {
            Some(stop) if negligible(stop.cost) => Some(Criterion::Cost),
            _ => short.then_some(Criterion::Step),
        };
        if short || (ends.is_some() && length <= NEAR && negligible(UNSEEN)) {
            let cost = (origin.merit - promised - model.split.penalty(&trial)).max(0.0);
            let (gained, gradient) = (promised, origin.gradient.to_vec());
            return Ok(Some(Taken { dx, promised, gained, cost, gradient, reached: None, ends }));
        }
        let failed = |why: EvalError| Failure::Evaluation(why.0);
        let (cost, gradient, reached) = if undamped.is_some() && (self.renewing || length > NEAR) {
            let there = problem.compress(&trial).map_err(failed)?;
            (there.cost, linalg::mul_transpose(there.jac.as_ref(), &there.r), Some(there))
        } else {
            let (cost, gradient) = problem.gradient(&trial).map_err(failed)?;
            (cost, gradient, None)
        };
        let gained = origin.merit - cost - model.split.penalty(&trial);
        if gained >= 0.0 || promised <= UNJUDGED * origin.merit {
            return Ok(Some(Taken { dx, promised, gained, cost, gradient, reached, ends }));
        }
        if !fresh || !problem.has_prior() {
            return Err(Failure::NoDescent);
        }
        let Some((dx, end)) = floor(problem, model, (origin.x, origin.merit), dx, damping) else {
            return Err(Failure::NoDescent);
        };
        let gained = origin.merit - end.cost - model.split.penalty(&end.x);
        let (cost, gradient) = (end.cost, end.gradient);
        Ok(Some(Taken { dx, promised, gained, cost, gradient, reached: None, ends: None }))
    }
}
