//! What an identifier hands back: the point, why it stopped, and the way there.

use super::objective::Objective;

/// Why an identifier calls its point a solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Criterion {
    /// The gradient, scaled by column norms and residual, is at most [`super::Stop::gradient`].
    Gradient,
    /// The step, relative to the point, is at most [`super::Stop::step`].
    Step,
    /// Actual and predicted reduction of the cost are at most [`super::Stop::cost`] of it.
    Cost,
    /// The cost is zero to rounding.
    Zero,
    /// Weak duality proves that, to first order, no point within a tolerance costs less by more than a thousandth.
    Gap,
}

/// Why an identifier gave up.
#[derive(Clone, Debug, PartialEq)]
pub enum Failure {
    /// The start cannot be evaluated.
    Start(String),
    /// The iteration left the region where the problem can be evaluated.
    Evaluation(String),
    /// Cost or step grew without limit.
    Diverged,
    /// No step, however short, lowers the cost although the gradient is not small.
    NoDescent,
    /// The steps still lower the merit, but by less than this part of it over the last iterations.
    Stalled(f64),
    /// Steps no longer lower the cost, but the conditions of an optimum within the limits are violated by this residual.
    NotStationary(f64),
    /// The constraints contradict each other; the names of those in conflict.
    Infeasible(Vec<String>),
    /// The inner solver ended with this status.
    Inner(String),
    /// The run ended, but what it found tells nothing of the machine, and why.
    Meaningless(String),
    /// The identifier needs something that this problem does not have.
    Unsuited(String),
}

/// How a run ended.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// At a solution.
    Converged(Criterion),
    /// At the iteration limit.
    OutOfIterations,
    /// Not at a solution.
    Failed(Failure),
}

impl Outcome {
    /// Whether the run ended at a solution.
    pub fn converged(&self) -> bool {
        matches!(self, Outcome::Converged(_))
    }
}

impl std::fmt::Display for Outcome {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Outcome::Converged(Criterion::Gradient) => write!(f, "converged: gradient is zero to tolerance"),
            Outcome::Converged(Criterion::Step) => write!(f, "converged: step below tolerance"),
            Outcome::Converged(Criterion::Cost) => write!(f, "converged: cost reduction below tolerance"),
            Outcome::Converged(Criterion::Zero) => write!(f, "converged: residual is zero to rounding"),
            Outcome::Converged(Criterion::Gap) => {
                write!(f, "converged: nothing within a tolerance is better by more than 1e-3, to first order")
            }
            Outcome::OutOfIterations => write!(f, "iteration limit reached"),
            Outcome::Failed(Failure::Start(why)) => write!(f, "the start cannot be evaluated: {why}"),
            Outcome::Failed(Failure::Evaluation(why)) => {
                write!(f, "left the region that can be evaluated: {why}")
            }
            Outcome::Failed(Failure::Diverged) => write!(f, "diverged: cost or step grew without limit"),
            Outcome::Failed(Failure::NoDescent) => write!(f, "no step lowers the cost"),
            Outcome::Failed(Failure::Stalled(part)) => {
                write!(f, "stalled: the last iterations lowered the merit by less than {part:e} of it")
            }
            Outcome::Failed(Failure::NotStationary(residual)) => {
                write!(
                    f,
                    "not converged: steps no longer lower the cost, but the KKT residual is {residual:.1e}"
                )
            }
            Outcome::Failed(Failure::Infeasible(names)) => {
                write!(f, "constraints contradict each other: {}", names.join(", "))
            }
            Outcome::Failed(Failure::Inner(status)) => write!(f, "inner solver: {status}"),
            Outcome::Failed(Failure::Meaningless(why)) => write!(f, "nothing was identified: {why}"),
            Outcome::Failed(Failure::Unsuited(why)) => write!(f, "does not suit this problem: {why}"),
        }
    }
}

/// One accepted iteration.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Iterate {
    /// Merit after the step (`|r|^2 / 2` plus whatever the identifier penalises).
    pub cost: f64,
    /// Euclidean length of the step in units of `x`.
    pub step: f64,
    /// Directions kept, for identifiers that choose.
    pub kept: Option<usize>,
}

/// How much the estimate leans on the prior, which decides its covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Estimate {
    /// Data only: covariance `(J'J)^+`.
    LeastSquares,
    /// Data on the directions with singular value above the threshold, prior on the others.
    Split {
        /// Signal-to-noise ratio above which a direction is left to the data.
        threshold: f64,
    },
    /// Like `Split`, each part of the problem by itself, blind to noise that the parts have in common.
    Decoupled {
        /// Signal-to-noise ratio above which a direction of a part is left to the data.
        threshold: f64,
    },
    /// Unit prior on every direction, times this weight.
    Ridge {
        /// Factor on `|x|^2 / 2`.
        weight: f64,
    },
    /// Constrained or robust: linear covariance does not apply.
    Other,
}

/// A limit that holds with equality at the solution.
#[derive(Clone, Debug, PartialEq)]
pub struct ActiveBound {
    /// Name of the parameter or group.
    pub name: String,
    /// The limit, in units of `x`.
    pub limit: f64,
    /// Lagrange multiplier, nonnegative: decrease of the cost per unit that the limit gives way.
    pub multiplier: f64,
}

/// One point of the curve from which a regularisation weight was chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WeightPoint {
    /// The weight tried.
    pub weight: f64,
    /// Its score: mean squared prediction error, or `|r|^2 / m` for the discrepancy principle.
    pub score: f64,
}

/// Result of one run.
#[derive(Clone, Debug)]
pub struct Report {
    /// Name of the identifier.
    pub identifier: &'static str,
    /// The point, in the coordinates of the problem that was solved.
    pub x: Vec<f64>,
    /// `|r(x)|^2 / 2` (of the parts, where a problem was solved in parts), infinite where `x` cannot be evaluated.
    pub cost: f64,
    /// How it ended.
    pub outcome: Outcome,
    /// Accepted iterations, in order.
    pub trace: Vec<Iterate>,
    /// Role of the prior.
    pub estimate: Estimate,
    /// Limits that are active at `x`.
    pub active: Vec<ActiveBound>,
    /// KKT residual of the nonlinear problem at `x`, for constrained identifiers.
    pub kkt: Option<f64>,
    /// What was minimised, where an identifier can be told to minimise different things.
    pub objective: Option<Objective>,
    /// The curve from which a weight was chosen, empty where none was.
    pub weights: Vec<WeightPoint>,
}

impl Report {
    /// A report at `start` before anything was done: out of iterations, infinite cost.
    pub fn new(identifier: &'static str, start: &[f64], estimate: Estimate) -> Self {
        Self {
            identifier,
            x: start.to_vec(),
            cost: f64::INFINITY,
            outcome: Outcome::OutOfIterations,
            trace: Vec::new(),
            estimate,
            active: Vec::new(),
            kkt: None,
            objective: None,
            weights: Vec::new(),
        }
    }

    /// The same report, ended by a failure.
    pub fn fail(mut self, failure: Failure) -> Self {
        self.outcome = Outcome::Failed(failure);
        self
    }
}
