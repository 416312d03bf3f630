//! The default: Gauss-Newton that leaves to the data what the data knows better than the tolerance.

use super::identifier::{Identifier, SettingError, Stop};
use super::report::{Criterion, Estimate, Failure, Iterate, Outcome, Report};
use super::split::{Split, Step};
use crate::linalg::{self, norm};
use crate::problem::{Compressed, Problem, cost};

/// Gauss-Newton on the minimal coordinates.
///
/// The whitened Jacobian `J = U S V'` splits the coordinates: *kept* directions, with `s > threshold`, follow the
/// data alone; on the others, which the tolerance knows better than the data, stands the unit prior. The
/// iteration minimises `|r|^2 / 2 + |P x|^2 / 2`, `P` the projector on the directions that are not kept, and takes
/// a step only if that merit falls at its end; until then damping shortens it (docs/theory.md section 6).
///
/// The split is settled as soon as the kept number repeats, and looked at again once converged, a few times at
/// most: a singular value near the threshold cannot make the iteration swing.
#[derive(Clone, Copy, Debug)]
pub struct Minimal {
    /// Signal-to-noise ratio above which a direction is kept.
    pub threshold: f64,
}

impl Default for Minimal {
    fn default() -> Self {
        Self { threshold: 1.0 }
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
/// Step, in tolerances, below which a kept number that repeats is settled.
const SMALL_STEP: f64 = 0.3;
/// Iterations after which the split is settled whatever it does.
const SETTLED_AFTER: usize = 10;
/// How often the split may change after convergence.
const RESPLITS: usize = 3;

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
        let mut report = Report::new(self.name(), start, estimate);
        let mut here = match problem.compress(start) {
            Ok(here) => here,
            Err(why) => return report.fail(Failure::Start(why.0)),
        };
        report.cost = here.cost;
        let mut damping = 0.0;
        let mut last: Option<Split> = None;
        let mut settled = false;
        let mut resplits = 0;
        let mut promised = f64::INFINITY;
        while report.trace.len() < stop.iterations {
            let split = match last.take() {
                Some(split) if settled => split,
                before => match self.split(problem, &here) {
                    Some(split) => {
                        let near = report.trace.last().is_some_and(|last| last.step < SMALL_STEP);
                        let long = report.trace.len() >= SETTLED_AFTER;
                        settled = before.is_some_and(|b| near && b.kept() == split.kept()) || long;
                        split
                    }
                    None => return report.fail(Failure::Evaluation("the Jacobian is not finite".into())),
                },
            };
            let merit = here.cost + split.penalty(&report.x);
            let step = match self.descend(problem, &split, &here, &report.x, merit, &mut damping) {
                Ok(step) => step,
                Err(failure) => return report.fail(failure),
            };
            report.x = report.x.iter().zip(&step.dx).map(|(x, dx)| x + dx).collect();
            here = match problem.compress(&report.x) {
                Ok(here) => here,
                Err(why) => return report.fail(Failure::Evaluation(why.0)),
            };
            report.cost = here.cost;
            let length = norm(&step.dx);
            report.trace.push(Iterate { cost: here.cost, step: length, kept: Some(split.kept()) });
            // Steps whose promise no longer shrinks are rounding.
            let at_rounding = step.predicted <= UNJUDGED * merit && step.predicted > 0.25 * promised;
            promised = step.predicted;
            let criterion = if damping > 0.0 {
                None
            } else if here.cost == 0.0 {
                Some(Criterion::Zero)
            } else if length <= stop.step * (norm(&report.x) + stop.step) {
                Some(Criterion::Step)
            } else if step.predicted <= stop.cost * merit || at_rounding {
                Some(Criterion::Cost)
            } else {
                None
            };
            last = Some(split);
            let Some(criterion) = criterion else { continue };
            let Some(anew) = self.split(problem, &here) else { continue };
            if last.as_ref().is_some_and(|last| last.kept() != anew.kept()) && resplits < RESPLITS {
                resplits += 1;
                promised = f64::INFINITY;
                last = Some(anew);
                settled = true;
                continue;
            }
            report.outcome = Outcome::Converged(criterion);
            return report;
        }
        report
    }
}

impl Minimal {
    fn split(&self, problem: &dyn Problem, here: &Compressed) -> Option<Split> {
        if problem.has_prior() {
            return Split::at(here, self.threshold, true);
        }
        let largest = linalg::singular_values(here.jac.as_ref())?.first().copied().unwrap_or(0.0);
        Split::at(here, ROUNDING * largest, false)
    }

    /// The first of ever more damped steps that lowers the merit.
    fn descend(
        &self,
        problem: &dyn Problem,
        split: &Split,
        here: &Compressed,
        x: &[f64],
        merit: f64,
        damping: &mut f64,
    ) -> Result<Step, Failure> {
        let mut why = None;
        loop {
            if let Some(step) = split.step(here, x, *damping) {
                let trial: Vec<f64> = x.iter().zip(&step.dx).map(|(x, dx)| x + dx).collect();
                match problem.residual(&trial) {
                    Ok(r) => {
                        let gained = merit - cost(&r) - split.penalty(&trial);
                        if gained >= 0.0 || step.predicted <= UNJUDGED * merit {
                            let ratio = gained / step.predicted;
                            if ratio > 0.75 || step.predicted <= UNJUDGED * merit {
                                *damping = if *damping <= FIRST_DAMPING { 0.0 } else { 0.3 * *damping };
                            } else if ratio < 0.25 {
                                *damping = (*damping * 2.0).max(FIRST_DAMPING);
                            }
                            return Ok(step);
                        }
                    }
                    Err(error) => why = Some(error.0),
                }
            }
            *damping = (*damping * 4.0).max(FIRST_DAMPING);
            if *damping > LARGEST_DAMPING {
                return Err(why.map_or(Failure::NoDescent, Failure::Evaluation));
            }
        }
    }
}
