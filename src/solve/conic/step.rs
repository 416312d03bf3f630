//! One step: the conic program about a point, solved, polished and checked.

use super::faces::walk;
use super::here::Here;
use super::kkt::{self, Stationarity};
use super::limits::Limits;
use super::loss::{Frame, Loss};
use super::penalty::Penalty;
use super::polish::polish;
use super::program::{Program, Solution};
use super::trust;
use crate::linalg;
use crate::problem::Group;
use crate::solve::damped::column_norms;
use clarabel::solver::SolverStatus;

/// Everything that a step is made of.
#[derive(Clone, Debug)]
pub struct Model<'a> {
    /// Cost of residuals.
    pub loss: &'a dyn Loss,
    /// Cost of deviations.
    pub penalty: Penalty,
    /// Limits of deviations.
    pub limits: &'a Limits,
    /// Groups of the problem.
    pub groups: &'a [Group],
    /// Metric of the trust region, one factor per coordinate.
    pub metric: &'a [f64],
}

/// A step found.
#[derive(Clone, Debug)]
pub struct Step {
    /// The point it leads to, within all limits.
    pub u: Vec<f64>,
    /// Reduction of the merit that the linear model promises.
    pub predicted: f64,
    /// Length in the metric of the trust region.
    pub length: f64,
    /// Derivative of the loss by the residual where only the program's duals know it.
    pub influence: Option<Vec<f64>>,
    /// How clarabel ended; `None` where it was not asked.
    pub status: Option<SolverStatus>,
}

/// No usable step: how clarabel ended.
#[derive(Clone, Debug, PartialEq)]
pub struct NoStep(pub String);

impl NoStep {
    /// Why a program that ended so gives no step. The point that a program is posed about satisfies it: what clarabel
    /// takes for infeasible is rounding.
    pub fn of(status: SolverStatus) -> Self {
        match status {
            SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible => {
                Self(format!("numerical failure ({status:?}, although the point itself is feasible)"))
            }
            SolverStatus::DualInfeasible | SolverStatus::AlmostDualInfeasible => {
                Self(format!("numerical failure ({status:?}, although the objective is bounded below)"))
            }
            _ => Self(format!("{status:?}")),
        }
    }
}

/// Programs with a growing working set before its last answer is taken as it is.
const ROUNDS: usize = 12;
/// Newton steps of a polish, each with one look at the active set.
const PASSES: usize = 30;
/// The same from the active set of the point itself, before clarabel is asked.
const WARM_PASSES: usize = 25;
/// Passes, in coordinates, with one limit changed each.
const LIMITS: usize = 3;
/// KKT residual from which on a polished point is not the program's solution: its active set did not settle.
const UNSETTLED: f64 = 1e-9;
/// KKT residual of a program's solution that needs no other witness.
const VERIFIED: f64 = 1e-11;
/// Nearness to a limit, in units of the program, from which an unpolished point is put on it.
const SNAP: f64 = 1e-7;

impl Model<'_> {
    /// Merit at a point with residual `r`.
    pub fn merit(&self, r: &[f64], x: &[f64]) -> f64 {
        self.loss.merit(r) + self.penalty.merit(x, self.groups)
    }

    /// Gradient of the loss at `u` under the linear model.
    pub fn program_gradient(&self, here: &Here, u: &[f64]) -> Vec<f64> {
        linalg::mul_transpose(here.jac.as_ref(), &self.loss.influence(&here.predict(u)))
    }

    /// The scale of [`Self::program_gradient`].
    ///
    /// The last digit of `u` changes what the model predicts: influences below that are none, however small the
    /// compressed residual is.
    pub fn program_measure(&self, here: &Here, u: &[f64]) -> Vec<f64> {
        let influence = linalg::norm(&self.loss.influence(&here.predict(u)));
        let columns = column_norms(&here.jac);
        let digit: Vec<f64> = columns.iter().zip(u).map(|(c, u)| f64::EPSILON * c * u).collect();
        kkt::measure(&columns, influence.max(linalg::norm(&digit) / VERIFIED), &self.penalty, u)
    }

    /// The conditions of the program, not of the nonlinear problem, at `u`.
    pub fn program_stationarity(&self, here: &Here, u: &[f64]) -> Stationarity {
        let gradient = self.program_gradient(here, u);
        let measure = self.program_measure(here, u);
        kkt::stationarity(&gradient, &measure, u, &self.penalty, self.limits, self.groups)
    }

    /// Units of the step variables: what the residual asks of a coordinate, or what its limits leave if less.
    ///
    /// In these units steps and limits are of order one, as clarabel's tolerances suppose.
    fn units(&self, here: &Here, radius: Option<f64>) -> Vec<f64> {
        let residual = linalg::norm(&here.r);
        let columns = column_norms(&here.jac);
        let largest = columns.iter().fold(0.0f64, |a, v| a.max(*v));
        let ridge = self.penalty.ridge.sqrt();
        let wide = residual + ridge * linalg::norm(&here.x);
        (0..here.x.len())
            .map(|i| {
                let asked = wide / columns[i].max(ridge).max(1e-6 * largest);
                let box_reach = (self.limits.upper[i] - here.x[i]).max(here.x[i] - self.limits.lower[i]);
                let reach = box_reach
                    .min(2.0 * self.limits.cone)
                    .min(radius.map_or(f64::INFINITY, |radius| radius / self.metric[i]));
                let unit = if reach > 0.0 { asked.min(reach) } else { asked };
                if unit > 0.0 && unit.is_finite() { unit } else { 1.0 }
            })
            .collect()
    }

    /// The best step from `here`, at most `radius` long where one is given.
    pub fn step(&self, here: &Here, radius: Option<f64>) -> Result<Step, NoStep> {
        self.step_near(here, radius, &here.x, WARM_PASSES)
    }

    /// The same, where `near` is a point whose active set may be that of the solution, and `passes` the Newton steps
    /// spent on finding out.
    pub fn step_near(
        &self,
        here: &Here,
        radius: Option<f64>,
        near: &[f64],
        passes: usize,
    ) -> Result<Step, NoStep> {
        let frame = Frame { here, unit: self.units(here, radius) };
        if let Some(step) = self.warm(&frame, radius, near, passes) {
            return Ok(step);
        }
        let mut working = self.loss.working_set(here);
        let mut round = 1;
        let (mut u, solution) = loop {
            let program = self.program(&frame, radius, &working);
            let solution = program.solve().map_err(NoStep)?;
            let u = usable(&solution, &frame).ok_or_else(|| NoStep::of(solution.status))?;
            let missing = self.loss.missing(&here.predict(&u), &working);
            if missing.is_empty() || round == ROUNDS {
                break (u, solution);
            }
            round += 1;
            working.extend(missing);
            working.sort_unstable();
        };
        self.limits.clamp(&mut u);
        self.snap(&mut u, &frame.unit);
        let length = trust::length(self.metric, &here.x, &u);
        // A polish forgets the trust region: it is for steps that are free of it.
        if radius.is_none_or(|radius| length < 0.99 * radius) {
            if let Some(polished) = polish(self, here, &u, &frame.unit, PASSES)
                && self.better(here, &polished, &u, radius)
            {
                u = polished;
            }
            if self.program_stationarity(here, &u).residual > UNSETTLED
                && let Some(walked) = walk(self, here, &u, &frame.unit, LIMITS * u.len())
                && self.better(here, &walked, &u, radius)
            {
                u = walked;
            }
        }
        let predicted = self.merit(&here.r, &here.x) - self.merit(&here.predict(&u), &u);
        Ok(Step {
            length: trust::length(self.metric, &here.x, &u),
            predicted,
            influence: self.loss.dual_influence(here, &working, &solution),
            status: Some(solution.status),
            u,
        })
    }

    /// The solution of the program about `here`, if Newton steps from `near` reach it.
    pub fn solution_near(&self, here: &Here, near: &[f64], passes: usize) -> Option<Vec<f64>> {
        let frame = Frame { here, unit: self.units(here, None) };
        self.warm(&frame, None, near, passes).map(|step| step.u)
    }

    /// The step on the active set of `near`, if it satisfies the program's conditions: those are sufficient, the
    /// program being convex, so that clarabel need not be asked. Near a solution it never is.
    fn warm(&self, frame: &Frame, radius: Option<f64>, near: &[f64], passes: usize) -> Option<Step> {
        let here = frame.here;
        let u = polish(self, here, near, &frame.unit, passes)?;
        let length = trust::length(self.metric, &here.x, &u);
        let inside = self.limits.violation(&u, self.groups) <= 1e-14 * linalg::norm(&u).max(1.0);
        let solved = inside
            && radius.is_none_or(|radius| length <= radius)
            && self.program_stationarity(here, &u).residual <= VERIFIED;
        let predicted = self.merit(&here.r, &here.x) - self.merit(&here.predict(&u), &u);
        solved.then_some(Step { u, predicted, length, influence: None, status: None })
    }

    /// The program about `frame`; the rows of the loss come first.
    pub fn program(&self, frame: &Frame, radius: Option<f64>, working: &[usize]) -> Program {
        let mut program = Program::new(frame.unit.len());
        self.loss.pose(&mut program, frame, working);
        self.penalty.pose(&mut program, frame, self.groups);
        self.limits.pose(&mut program, frame, self.groups);
        if let Some(radius) = radius {
            trust::pose(&mut program, frame, self.metric, radius);
        }
        program
    }

    fn snap(&self, u: &mut [f64], unit: &[f64]) {
        for i in 0..u.len() {
            let near = SNAP * unit[i];
            if self.limits.upper[i] - u[i] <= near {
                u[i] = self.limits.upper[i];
            } else if u[i] - self.limits.lower[i] <= near {
                u[i] = self.limits.lower[i];
            } else if self.penalty.lasso > 0.0 && u[i].abs() <= near {
                u[i] = 0.0;
            }
        }
        for group in self.groups {
            let reach = group.length(u);
            let size = group.members.iter().fold(0.0f64, |a, &i| a.max(unit[i]));
            if self.penalty.group > 0.0 && reach <= SNAP * size {
                group.members.iter().for_each(|&i| u[i] = 0.0);
            } else if reach > self.limits.cone {
                // What is at its bound stays there exactly: a hair beside it, its multiplier would count as an error.
                let limits = self.limits;
                let at_bound = |i: usize, u: f64| u >= limits.upper[i] || u <= limits.lower[i];
                if !limits.onto_cone(u, group, at_bound) {
                    group.members.iter().for_each(|&i| u[i] *= limits.cone / reach);
                }
            }
        }
    }

    /// Whether the polished point is within all limits and nearer to the program's solution.
    fn better(&self, here: &Here, polished: &[f64], plain: &[f64], radius: Option<f64>) -> bool {
        let slack = 1e-12 * self.limits.cone.min(1e3);
        let size = linalg::norm(polished).max(1.0);
        radius.is_none_or(|radius| trust::length(self.metric, &here.x, polished) <= 1.1 * radius)
            && self.limits.violation(polished, self.groups) <= slack.max(1e-14 * size)
            && self.program_stationarity(here, polished).residual
                <= self.program_stationarity(here, plain).residual
    }
}

/// The point that a solution stands for, where its status and values allow to use it at all.
///
/// Less than `Solved` is tolerated, because every step is judged by the true merit afterwards. Infeasible cannot
/// be right: the point itself is within the limits, and penalties are posed so that it satisfies their rows too.
/// `MaxTime` and `CallbackTerminated` cannot come: there is no time limit and no callback.
pub fn usable(solution: &Solution, frame: &Frame) -> Option<Vec<f64>> {
    match solution.status {
        SolverStatus::Solved
        | SolverStatus::AlmostSolved
        | SolverStatus::InsufficientProgress
        | SolverStatus::MaxIterations => {
            let u: Vec<f64> = frame
                .here
                .x
                .iter()
                .zip(solution.x.iter().zip(&frame.unit))
                .map(|(x, (step, unit))| x + step * unit)
                .collect();
            u.iter().all(|v| v.is_finite()).then_some(u)
        }
        SolverStatus::Unsolved
        | SolverStatus::PrimalInfeasible
        | SolverStatus::DualInfeasible
        | SolverStatus::AlmostPrimalInfeasible
        | SolverStatus::AlmostDualInfeasible
        | SolverStatus::MaxTime
        | SolverStatus::NumericalError
        | SolverStatus::CallbackTerminated => None,
    }
}
