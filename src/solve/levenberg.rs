//! Levenberg-Marquardt as an [`argmin::core::Solver`]: argmin 0.11 ships none (argmin-rs/argmin#591).
//!
//! Put it under an `argmin::core::Executor` of your own for observers, timers and checkpoints; [`minimise`]
//! is the plain run that identifiers use.

use super::damped::{DampedStep, gradient_cosine};
use super::identifier::Stop;
use super::radius::Region;
use super::report::{Criterion, Failure, Iterate, Outcome};
use crate::linalg::norm;
use crate::problem::{Compressed, Problem, cost};
use argmin::core::{Error, Executor, IterState, KV, Solver, TerminationReason, TerminationStatus};
use serde::{Deserialize, Serialize};

/// argmin's state as this solver uses it: the point and its cost.
pub type LevenbergState = IterState<Vec<f64>, (), (), (), (), f64>;

/// Gain ratio, actual to predicted reduction, from which a step is accepted (MINPACK's value).
const ACCEPT: f64 = 1e-4;
/// Relative predicted reduction below which rounding in the cost may hide that a step is good.
const FLAT: f64 = 1e-6;
/// Relative predicted reduction below which nothing that a cost could show remains.
const NOTHING_LEFT: f64 = 1e-14;
/// Trial steps from one point before giving up: damping has grown beyond every scale by then.
const TRIALS: usize = 60;
/// Cost, as a part of that at the start, that is rounding: residuals of 1e-12.
const ROUNDING: f64 = 1e-24;
/// Cost that is nothing where residuals are in standard deviations: 1e-9 of one.
const NOTHING: f64 = 1e-18;
/// Cosine between residual and Jacobian above which a point is certainly not stationary.
const NOT_STATIONARY: f64 = 1e-4;

/// Levenberg-Marquardt after Moré 1978: running column norms as scale (tolerances where the coordinates have them),
/// a radius that follows the gain ratio, and the damping that belongs to the radius.
///
/// Where the reduction of the cost drowns in rounding, a step is judged by the next step instead (the idea of
/// Hager and Zhang 2005, section 2.1): that is what carries the solution to the last digits.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct LevenbergMarquardt {
    stop: Stop,
    region: Region,
    trace: Vec<Iterate>,
    /// Cost that is rounding.
    nothing: f64,
    #[serde(skip)]
    outcome: Option<Outcome>,
    #[serde(skip)]
    here: Option<Compressed>,
}

/// One accepted step, or why there is none.
enum Trial {
    Accepted { x: Vec<f64>, there: Compressed, ratio: f64, actual: f64, step: DampedStep },
    Ended(Outcome),
}

impl LevenbergMarquardt {
    /// A solver at its first damping.
    pub fn new(stop: Stop) -> Self {
        Self { stop, region: Region::default(), trace: Vec::new(), nothing: 0.0, outcome: None, here: None }
    }

    /// Accepted iterations so far.
    pub fn trace(&self) -> &[Iterate] {
        &self.trace
    }

    /// Why it stopped; `None` while it runs or where the executor stopped it.
    pub fn outcome(&self) -> Option<&Outcome> {
        self.outcome.as_ref()
    }

    fn stationary(&self, here: &Compressed) -> Option<Outcome> {
        if here.cost == 0.0 {
            Some(Outcome::Converged(Criterion::Zero))
        } else if gradient_cosine(here) <= self.stop.gradient {
            Some(Outcome::Converged(Criterion::Gradient))
        } else {
            None
        }
    }

    /// Shrinks the radius until a step is accepted.
    fn search(&mut self, problem: &dyn Problem, x: &[f64], here: &Compressed) -> Trial {
        let mut refused = None;
        for _ in 0..TRIALS {
            let Some(step) = self.region.step(x, here) else {
                return Trial::Ended(Outcome::Failed(Failure::Diverged));
            };
            let trial: Vec<f64> = x.iter().zip(&step.dx).map(|(x, dx)| x + dx).collect();
            if trial == x {
                break;
            }
            let predicted = step.predicted / here.cost;
            let mut ratio = f64::NEG_INFINITY;
            match problem.residual(&trial).map(|r| cost(&r)) {
                Ok(there) if there.is_finite() => {
                    let actual = (here.cost - there) / here.cost;
                    ratio = actual / predicted;
                    let flat = predicted <= FLAT && actual.abs() <= FLAT;
                    if ratio > ACCEPT || flat {
                        match compress_finite(problem, &trial) {
                            Ok(there) if ratio > ACCEPT || self.region.contracts(&there, &step) => {
                                let ratio = if flat { 1.0 } else { ratio };
                                return Trial::Accepted { x: trial, there, ratio, actual, step };
                            }
                            Ok(_) => {}
                            Err(why) => refused = Some(why),
                        }
                    }
                    if flat && predicted <= NOTHING_LEFT && self.plausible(x, here) {
                        return Trial::Ended(Outcome::Converged(Criterion::Cost));
                    }
                }
                Ok(_) => refused = Some("the residual is not finite".into()),
                Err(why) => refused = Some(why.0),
            }
            self.region.resize(ratio, &step);
        }
        Trial::Ended(if self.plausible(x, here) {
            Outcome::Converged(Criterion::Step)
        } else if let Some(why) = refused {
            Outcome::Failed(Failure::Evaluation(why))
        } else {
            Outcome::Failed(Failure::NoDescent)
        })
    }

    /// Whether this may be a solution: a short step or a flat cost alone may also come of a short radius. A residual that
    /// is rounding has a gradient that says nothing.
    fn plausible(&self, x: &[f64], here: &Compressed) -> bool {
        gradient_cosine(here) <= NOT_STATIONARY || self.region.arrived(x, here) || here.cost <= self.nothing
    }

    fn judge(
        &self,
        x: &[f64],
        there: &Compressed,
        actual: f64,
        predicted: f64,
        length: f64,
    ) -> Option<Outcome> {
        if let Some(outcome) = self.stationary(there) {
            return Some(outcome);
        }
        let criterion = if actual.abs() <= self.stop.cost && predicted <= self.stop.cost {
            Criterion::Cost
        } else if self.stop.by_step(length, x) {
            Criterion::Step
        } else {
            return None;
        };
        self.plausible(x, there).then_some(Outcome::Converged(criterion))
    }
}

fn compress_finite(problem: &dyn Problem, x: &[f64]) -> Result<Compressed, String> {
    let here = problem.compress(x).map_err(|why| why.0)?;
    if here.cost.is_finite() && here.jac.is_all_finite() && here.r.iter().all(|v| v.is_finite()) {
        Ok(here)
    } else {
        Err("residual or Jacobian is not finite".into())
    }
}

impl<'p> Solver<&'p dyn Problem, LevenbergState> for LevenbergMarquardt {
    fn name(&self) -> &str {
        "Levenberg-Marquardt"
    }

    fn init(
        &mut self,
        problem: &mut argmin::core::Problem<&'p dyn Problem>,
        mut state: LevenbergState,
    ) -> Result<(LevenbergState, Option<KV>), Error> {
        let x = state.take_param().ok_or_else(|| Error::msg("no starting point"))?;
        let at_start = |p: &&dyn Problem| Ok((p.has_prior(), compress_finite(*p, &x)));
        let (tolerances, start) = problem.problem("jacobian_count", at_start)?;
        self.region = Region::new(tolerances);
        match start {
            Ok(here) => {
                self.outcome = self.stationary(&here);
                self.nothing = if tolerances { NOTHING } else { ROUNDING * here.cost };
                self.region.see(&here);
                state = state.cost(here.cost);
                self.here = Some(here);
            }
            Err(why) => self.outcome = Some(Outcome::Failed(Failure::Start(why))),
        }
        Ok((state.param(x), None))
    }

    fn next_iter(
        &mut self,
        problem: &mut argmin::core::Problem<&'p dyn Problem>,
        mut state: LevenbergState,
    ) -> Result<(LevenbergState, Option<KV>), Error> {
        let x = state.take_param().ok_or_else(|| Error::msg("no point"))?;
        let here = match self.here.take() {
            Some(here) => here,
            // After a checkpoint: the factor is not stored, it is cheaper to compute again than to write.
            None => match problem.problem("jacobian_count", |p| Ok(compress_finite(*p, &x)))? {
                Ok(here) => here,
                Err(why) => {
                    self.outcome = Some(Outcome::Failed(Failure::Start(why)));
                    return Ok((state.param(x), None));
                }
            },
        };
        match problem.problem("step_count", |p| Ok(self.search(*p, &x, &here)))? {
            Trial::Ended(outcome) => {
                self.outcome = Some(outcome);
                Ok((state.param(x).cost(here.cost), None))
            }
            Trial::Accepted { x, there, ratio, actual, step } => {
                let length = norm(&step.dx);
                self.outcome = self.judge(&x, &there, actual, step.predicted / here.cost, length);
                let kv = argmin::kv!("damping" => step.damping; "radius" => self.region.radius(); "ratio" => ratio;);
                self.region.resize(ratio, &step);
                self.trace.push(Iterate { cost: there.cost, step: length, kept: None });
                self.region.see(&there);
                state = state.param(x).cost(there.cost);
                self.here = Some(there);
                Ok((state, Some(kv)))
            }
        }
    }

    fn terminate(&mut self, _state: &LevenbergState) -> TerminationStatus {
        match &self.outcome {
            None => TerminationStatus::NotTerminated,
            Some(Outcome::Converged(_)) => TerminationStatus::Terminated(TerminationReason::SolverConverged),
            Some(other) => TerminationStatus::Terminated(TerminationReason::SolverExit(other.to_string())),
        }
    }
}

/// Where a run ended.
pub struct Minimum {
    /// The last accepted point.
    pub x: Vec<f64>,
    /// Merit there; infinite where the start cannot be evaluated.
    pub cost: f64,
    /// How it ended.
    pub outcome: Outcome,
    /// Accepted iterations.
    pub trace: Vec<Iterate>,
}

/// Runs [`LevenbergMarquardt`] under argmin's executor from `start` until `stop`.
pub fn minimise(problem: &dyn Problem, start: &[f64], stop: &Stop) -> Minimum {
    let run = Executor::new(problem, LevenbergMarquardt::new(*stop))
        .configure(|state| state.param(start.to_vec()).max_iters(stop.iterations as u64))
        .ctrlc(false)
        .timer(false)
        .run();
    match run {
        Ok(mut result) => Minimum {
            x: result.state.take_param().unwrap_or_else(|| start.to_vec()),
            cost: result.state.get_cost(),
            outcome: result.solver.outcome.unwrap_or(Outcome::OutOfIterations),
            trace: result.solver.trace,
        },
        Err(why) => Minimum {
            x: start.to_vec(),
            cost: f64::INFINITY,
            outcome: Outcome::Failed(Failure::Inner(why.to_string())),
            trace: Vec::new(),
        },
    }
}
