//! The conic identifiers: one method, registered under the names of its usual compositions.

use super::arrival::ARRIVED;
use super::descent::Descent;
use super::least_squares::LeastSquares;
use super::limits::Limits;
use super::loss::{Loss, loss};
use super::options::{Options, Regulariser};
use super::penalty::Penalty;
use super::step::Model;
use super::weight::{self, WeightRule};
use crate::problem::{Form, Problem};
use crate::solve::anchored::{Anchored, SETTLED, settle};
use crate::solve::identifier::{Identifier, SettingError, Stop};
use crate::solve::objective::Objective;
use crate::solve::reduced::Reduced;
use crate::solve::report::{Criterion, Estimate, Failure, Outcome, Report};
use crate::solve::settings;

/// Ridge, in tolerance units, that chooses the smallest among solutions that data and penalty cannot tell apart.
const TIE: f64 = 1e-8;
/// The same among equivalent descriptions within limits, where far ones may gain a last trifle: they are curved.
const TIE_WITHIN_LIMITS: f64 = 1e-7;
/// Signal-to-noise ratio up to which, without a penalty, a direction has the prior's full weight (see `minimal`).
const THRESHOLD: f64 = 1.0;

/// The same as [`SETTLED`] for a loss without derivative, whose runs end within a thousandth of the merit.
const COARSE: f64 = 0.1;

/// A sequence of conic programs about the current point, in complete coordinates with the gauge left free: a limit
/// excludes a machine only if no equivalent description of it fits.
#[derive(Clone, Debug)]
pub struct Conic {
    name: &'static str,
    summary: &'static str,
    /// What is composed.
    pub options: Options,
}

impl Conic {
    /// `conic-bounded`: least squares within limits.
    pub fn bounded() -> Self {
        Self {
            name: "conic-bounded",
            summary: "least squares within hard limits on single deviations (bounds) or whole links (cone)",
            options: Options::default(),
        }
    }

    /// `conic-ridge`: least squares and squared deviation.
    pub fn ridge() -> Self {
        Self {
            name: "conic-ridge",
            summary: "least squares with a ridge about nominal in tolerances, within limits",
            options: Options { regulariser: Regulariser::Ridge, ..Options::default() },
        }
    }

    /// `conic-lasso`: least squares and sum of magnitudes.
    pub fn lasso() -> Self {
        Self {
            name: "conic-lasso",
            summary: "least squares that leaves most single deviations at exactly zero",
            options: Options { regulariser: Regulariser::Lasso, ..Options::default() },
        }
    }

    /// `conic-group-lasso`: least squares and sum of link deviations.
    pub fn group_lasso() -> Self {
        Self {
            name: "conic-group-lasso",
            summary: "least squares that leaves most links at exactly nominal: which few are off?",
            options: Options { regulariser: Regulariser::GroupLasso, ..Options::default() },
        }
    }

    /// `conic-huber`: residuals beyond a threshold count linearly.
    pub fn huber() -> Self {
        Self {
            name: "conic-huber",
            summary: "Huber's loss: gross errors in some poses do not carry the others away",
            options: Options { loss: "huber", ..Options::default() },
        }
    }

    /// `conic-minimax`: the largest residual.
    pub fn minimax() -> Self {
        Self {
            name: "conic-minimax",
            summary: "the least largest residual, for accuracy that must hold everywhere",
            options: Options { loss: "minimax", ..Options::default() },
        }
    }

    fn penalty(&self, weight: f64, prior: bool) -> Penalty {
        let tie = if prior { TIE } else { 0.0 };
        match self.options.regulariser {
            Regulariser::None => Penalty::default(),
            Regulariser::Ridge => Penalty { ridge: weight, ..Penalty::default() },
            Regulariser::Lasso => Penalty { ridge: tie, lasso: weight, group: 0.0 },
            Regulariser::GroupLasso => Penalty { ridge: tie, lasso: 0.0, group: weight },
        }
    }

    /// What is minimised with this weight in force.
    fn objective(&self, weight: f64) -> Objective {
        let Options { loss, delta, regulariser, bounds, cone, .. } = self.options;
        let on = |of: Regulariser| if regulariser == of { weight } else { 0.0 };
        Objective {
            loss,
            delta,
            ridge: on(Regulariser::Ridge),
            lasso: on(Regulariser::Lasso),
            group: on(Regulariser::GroupLasso),
            threshold: (regulariser == Regulariser::None).then_some(THRESHOLD),
            bounds,
            cone,
        }
    }

    fn unsuited(&self, problem: &dyn Problem) -> Option<&'static str> {
        let grouped =
            self.options.cone < f64::INFINITY || self.options.regulariser == Regulariser::GroupLasso;
        if grouped && problem.groups().is_empty() {
            Some("its parameters are not grouped into links")
        } else if self.options.weight == WeightRule::Discrepancy && !problem.has_prior() {
            Some("the discrepancy principle needs a stated noise")
        } else if self.options.regulariser == Regulariser::None
            && self.options.weight != WeightRule::Given(1.0)
        {
            Some("a weight is set, but no regulariser that it could weigh (ridge, lasso or group-lasso)")
        } else {
            None
        }
    }

    /// Linear theory covers least squares without limits only.
    fn estimate(&self, problem: &dyn Problem, limits: &Limits, weight: f64) -> Estimate {
        match self.options.regulariser {
            _ if !limits.none() || self.options.loss != "least-squares" => Estimate::Other,
            Regulariser::None => settings::estimate(problem, THRESHOLD),
            Regulariser::Ridge => Estimate::Ridge { weight },
            Regulariser::Lasso | Regulariser::GroupLasso => Estimate::Other,
        }
    }

    /// The weight in force, after a run with weight 1 where it must be chosen.
    fn weigh(
        &self,
        descent: &Descent,
        start: &[f64],
        mut report: Report,
    ) -> Result<(f64, Report), Box<Report>> {
        let rule = self.options.weight;
        if let WeightRule::Given(weight) = rule {
            return Ok((weight, report));
        }
        let pilot = descent.run(start, report.clone());
        if !pilot.cost.is_finite() {
            return Err(Box::new(pilot));
        }
        let metric = vec![1.0; start.len()];
        let prior = descent.problem.has_prior();
        let chosen = weight::choose(rule, descent.problem, &pilot.x, |weight| Model {
            loss: descent.loss,
            penalty: self.penalty(weight, prior),
            limits: descent.limits,
            groups: descent.problem.groups(),
            metric: &metric,
        });
        match chosen {
            Ok((weight, curve)) => {
                report.x = pilot.x;
                report.weights = curve;
                Ok((weight, report))
            }
            Err(why) => Err(Box::new(report.fail(Failure::Inner(why)))),
        }
    }
}

impl Identifier for Conic {
    fn name(&self) -> &'static str {
        self.name
    }

    fn summary(&self) -> &'static str {
        self.summary
    }

    fn form(&self) -> Form {
        Form::Complete
    }

    fn frame_free(&self) -> bool {
        let Options { loss, regulariser, bounds, .. } = self.options;
        loss != "minimax" && regulariser != Regulariser::Lasso && bounds == f64::INFINITY
    }

    fn set(&mut self, key: &str, value: &str) -> Result<(), SettingError> {
        self.options.set(self.name, key, value)
    }

    fn settings(&self) -> Vec<(&'static str, String)> {
        self.options.list()
    }

    fn identify(&self, problem: &dyn Problem, start: &[f64], stop: &Stop) -> Report {
        let report =
            Report { objective: Some(self.objective(0.0)), ..Report::new(self.name, start, Estimate::Other) };
        if let Some(why) = self.unsuited(problem) {
            return report.fail(Failure::Unsuited(why.into()));
        }
        let limits = match Limits::of(problem, self.options.bounds, self.options.cone) {
            Ok(limits) => limits,
            Err(names) => return report.fail(Failure::Infeasible(names)),
        };
        let Some(loss): Option<Box<dyn Loss>> = loss(self.options.loss, self.options.delta) else {
            return report.fail(Failure::Unsuited(format!("there is no loss '{}'", self.options.loss)));
        };
        if self.options.regulariser == Regulariser::None {
            let estimate = |limits: &Limits| self.estimate(problem, limits, 1.0);
            let free = estimate(&Limits::unlimited(problem.params().len()));
            let report = Report { estimate: estimate(&limits), ..report };
            return unpenalised(problem, loss.as_ref(), &limits, stop, report, free);
        }
        let mut descent = Descent {
            problem,
            loss: loss.as_ref(),
            penalty: self.penalty(1.0, problem.has_prior()),
            limits: &limits,
            stop,
        };
        let (weight, mut report) = match self.weigh(&descent, start, report) {
            Ok(weighed) => weighed,
            Err(failed) => return *failed,
        };
        descent.penalty = self.penalty(weight, problem.has_prior());
        report.estimate = self.estimate(problem, &limits, weight);
        report.objective = Some(self.objective(weight));
        let from = report.x.clone();
        descent.run(&from, report)
    }
}

/// The optimum without a penalty: that without limits, an estimate of its own (`free`), where it keeps them, for limits
/// that change nothing have no say. Where it does not, the search within them starts anew: the optimum without limits of
/// a strongly curved problem may be far from any within.
fn unpenalised(
    problem: &dyn Problem,
    loss: &dyn Loss,
    limits: &Limits,
    stop: &Stop,
    report: Report,
    free: Estimate,
) -> Report {
    if limits.none() {
        return unlimited(problem, loss, stop, report);
    }
    // Linear programs are too dear to be solved for nothing.
    if loss.smooth() {
        let free = unlimited(problem, loss, stop, Report { estimate: free, ..report.clone() });
        if free.outcome.converged() && limits.violation(&free.x, problem.groups()) == 0.0 {
            return free;
        }
    }
    settled(problem, loss, limits, stop, report)
}

/// The optimum without limits. The redundancy serves limits and sparse penalties; here it only makes programs larger.
fn unlimited(problem: &dyn Problem, loss: &dyn Loss, stop: &Stop, report: Report) -> Report {
    let Some(reduced) = Reduced::new(problem) else {
        return settled(problem, loss, &Limits::unlimited(problem.params().len()), stop, report);
    };
    let limits = Limits::unlimited(reduced.params().len());
    let from = Report { x: reduced.coordinates(&report.x), ..report };
    let found = settled(&reduced, loss, &limits, stop, from);
    Report { x: reduced.point(&found.x), ..found }
}

/// The optimum from `report.x`, the prior's weights those that belong to it.
fn settled(problem: &dyn Problem, loss: &dyn Loss, limits: &Limits, stop: &Stop, report: Report) -> Report {
    // Along what is redundant nothing but the limits decides: of all equals the smallest.
    let ties = problem.has_prior() && loss.smooth() && !limits.none();
    let penalty = Penalty { ridge: if ties { TIE_WITHIN_LIMITS } else { 0.0 }, ..Penalty::default() };
    let to = |loss: &dyn Loss, way: f64, report: Report| {
        let start = report.x.clone();
        settle(problem, &start, THRESHOLD, way, stop, report.clone(), |problem, from, stop| {
            let report = Report { x: from.to_vec(), ..report.clone() };
            Descent { problem, loss, penalty, limits, stop }.run(from, report)
        })
    };
    if loss.smooth() {
        let mut report = to(loss, SETTLED, report);
        if report.outcome.converged()
            && problem.has_prior()
            && let Ok(here) = problem.compress(&report.x)
            && let Some(anchored) = Anchored::at(problem, &report.x, &here, THRESHOLD)
        {
            // Of the weights that belong to the solution, not of those under which it was found.
            Descent { problem: &anchored, loss, penalty, limits, stop }.judge(&mut report);
        }
        // Whatever ended the run: within limits a small step or gain is no proof, the conditions are.
        if let (false, Outcome::Converged(criterion), Some(residual)) =
            (limits.none(), &report.outcome, report.kkt)
            && *criterion != Criterion::Zero
            && residual > ARRIVED
        {
            return report.fail(Failure::NotStationary(residual));
        }
        return report;
    }
    // Linear programs are dear: least squares leads near the solution.
    let near = to(&LeastSquares, COARSE, report.clone());
    let x = if near.outcome.converged() { near.x } else { report.x };
    to(loss, COARSE, Report { x, ..report })
}
