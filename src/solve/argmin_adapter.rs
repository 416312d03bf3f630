//! Between a [`Problem`] and argmin's own methods: cost, gradient and `J'J` on one side, stopping on the other.

use super::anchored::{SETTLED, settle};
use super::damped::gradient_cosine;
use super::identifier::Stop;
use super::report::{Criterion, Failure, Iterate, Outcome, Report};
use super::settings;
use crate::linalg::{self, norm};
use crate::problem::{Compressed, Problem, cost};
use argmin::core::{
    CostFunction, Error, Executor, Gradient, Hessian, IterState, KV, Solver, State, TerminationReason,
    TerminationStatus,
};
use std::cell::{Cell, RefCell};

/// Cosine between residual and Jacobian above which a stalled run has not arrived.
const NOT_STATIONARY: f64 = 1e-4;
/// Iterations without progress that end a run.
const STALLED: usize = 60;
/// Cost, relative to the start, that argmin's line search can still calculate with.
const LARGEST: f64 = 1e100;
/// Evaluations an iteration, on average, beyond which a line search is lost.
const EVALUATIONS: usize = 50;

/// What argmin sees of a problem: everything divided by the cost at the start.
pub struct Adapter<'p> {
    problem: &'p dyn Problem,
    start_cost: f64,
    /// Whether a point that cannot be evaluated costs infinitely much; else it ends the run.
    wall: bool,
    budget: Cell<usize>,
    last: RefCell<Option<(Vec<f64>, Compressed)>>,
    refused: RefCell<Option<String>>,
    watch: RefCell<Watch>,
}

/// What was seen of a run, kept where an argmin error cannot lose it.
#[derive(Default)]
struct Watch {
    x: Vec<f64>,
    cost: f64,
    cosine: f64,
    stalled: usize,
    trace: Vec<Iterate>,
    outcome: Option<Outcome>,
}

impl Adapter<'_> {
    fn compressed(&self, x: &[f64]) -> Result<Compressed, Error> {
        if let Some((at, here)) = self.last.borrow().as_ref()
            && at == x
        {
            return Ok(here.clone());
        }
        self.spend()?;
        let here = self.problem.compress(x)?;
        if !(here.jac.is_all_finite() && here.r.iter().all(|v| v.is_finite())) {
            return Err(Error::msg("residual or Jacobian is not finite"));
        }
        *self.last.borrow_mut() = Some((x.to_vec(), here.clone()));
        Ok(here)
    }

    fn spend(&self) -> Result<(), Error> {
        let left = self.budget.get().checked_sub(1).ok_or_else(|| Error::msg("line search without end"))?;
        self.budget.set(left);
        Ok(())
    }

    /// Looks at the point that an iteration ended at.
    fn look(&self, x: &[f64], stop: &Stop) -> Result<(), Error> {
        let mut watch = self.watch.borrow_mut();
        if watch.x == x {
            watch.stalled += 1;
            if watch.stalled >= STALLED {
                watch.outcome = Some(self.stuck(watch.cosine, Failure::NoDescent));
            }
            return Ok(());
        }
        let here = self.compressed(x)?;
        let step = norm(&x.iter().zip(&watch.x).map(|(a, b)| a - b).collect::<Vec<_>>());
        let reduction = (watch.cost - here.cost) / watch.cost;
        watch.cosine = gradient_cosine(&here);
        watch.trace.push(Iterate { cost: here.cost, step, kept: None });
        watch.outcome = if here.cost == 0.0 {
            Some(Outcome::Converged(Criterion::Zero))
        } else if watch.cosine <= stop.gradient {
            Some(Outcome::Converged(Criterion::Gradient))
        } else if stop.by_step(step, x) {
            Some(Outcome::Converged(Criterion::Step))
        } else if reduction.abs() <= stop.cost {
            Some(Outcome::Converged(Criterion::Cost))
        } else {
            None
        };
        (watch.x, watch.cost, watch.stalled) = (x.to_vec(), here.cost, 0);
        Ok(())
    }

    fn stuck(&self, cosine: f64, otherwise: Failure) -> Outcome {
        match self.refused.borrow().as_ref() {
            _ if cosine <= NOT_STATIONARY => Outcome::Converged(Criterion::Step),
            Some(why) => Outcome::Failed(Failure::Evaluation(why.clone())),
            None => Outcome::Failed(otherwise),
        }
    }
}

impl CostFunction for &Adapter<'_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, x: &Vec<f64>) -> Result<f64, Error> {
        self.spend()?;
        let (value, why) = match self.problem.residual(x) {
            Ok(r) => (cost(&r) / self.start_cost, "the residual is not finite".into()),
            Err(why) => (f64::NAN, why.0),
        };
        if value < LARGEST {
            return Ok(value);
        }
        *self.refused.borrow_mut() = Some(why.clone());
        if self.wall { Ok(f64::INFINITY) } else { Err(Error::msg(why)) }
    }
}

impl Gradient for &Adapter<'_> {
    type Param = Vec<f64>;
    type Gradient = Vec<f64>;

    fn gradient(&self, x: &Vec<f64>) -> Result<Vec<f64>, Error> {
        let here = self.compressed(x)?;
        let g = linalg::mul_transpose(here.jac.as_ref(), &here.r);
        Ok(g.iter().map(|v| v / self.start_cost).collect())
    }
}

impl Hessian for &Adapter<'_> {
    type Param = Vec<f64>;
    type Hessian = Vec<Vec<f64>>;

    /// `J'J`: argmin's methods know no square root, and what that costs is part of the comparison.
    fn hessian(&self, x: &Vec<f64>) -> Result<Vec<Vec<f64>>, Error> {
        let here = self.compressed(x)?;
        let n = here.jac.ncols();
        let column = |j: usize| here.jac.col(j).iter().map(|v| v / self.start_cost).collect::<Vec<f64>>();
        Ok((0..n).map(|j| linalg::mul_transpose(here.jac.as_ref(), &column(j))).collect())
    }
}

/// One of argmin's methods, stopped by [`Stop`] instead of its own absolute tolerances.
struct Watched<S> {
    method: S,
    stop: Stop,
}

impl<'a, 'p, S, H> Solver<&'a Adapter<'p>, IterState<Vec<f64>, Vec<f64>, (), H, (), f64>> for Watched<S>
where
    S: Solver<&'a Adapter<'p>, IterState<Vec<f64>, Vec<f64>, (), H, (), f64>>,
    IterState<Vec<f64>, Vec<f64>, (), H, (), f64>: State<Param = Vec<f64>>,
{
    fn name(&self) -> &str {
        self.method.name()
    }

    fn init(
        &mut self,
        problem: &mut argmin::core::Problem<&'a Adapter<'p>>,
        state: IterState<Vec<f64>, Vec<f64>, (), H, (), f64>,
    ) -> Result<(IterState<Vec<f64>, Vec<f64>, (), H, (), f64>, Option<KV>), Error> {
        self.method.init(problem, state)
    }

    fn next_iter(
        &mut self,
        problem: &mut argmin::core::Problem<&'a Adapter<'p>>,
        state: IterState<Vec<f64>, Vec<f64>, (), H, (), f64>,
    ) -> Result<(IterState<Vec<f64>, Vec<f64>, (), H, (), f64>, Option<KV>), Error> {
        let (state, kv) = self.method.next_iter(problem, state)?;
        let stop = self.stop;
        let Some(x) = state.get_param() else { return Ok((state, kv)) };
        problem.problem("look_count", |adapter| adapter.look(x, &stop))?;
        if let Some(outcome) = problem.problem("look_count", |a| Ok(a.watch.borrow().outcome.clone()))? {
            let reason = TerminationReason::SolverExit(outcome.to_string());
            return Ok((state.terminate_with(reason), kv));
        }
        Ok((state, kv))
    }

    fn terminate(&mut self, _state: &IterState<Vec<f64>, Vec<f64>, (), H, (), f64>) -> TerminationStatus {
        TerminationStatus::NotTerminated
    }
}

/// Signal-to-noise ratio up to which the baselines give a direction the prior's full weight, as by default elsewhere.
const THRESHOLD: f64 = 1.0;

/// Runs one of argmin's methods, `method` from its start; `wall` as in [`Adapter`]: infinite cost where it can turn
/// back from it.
pub fn run<S, H>(
    name: &'static str,
    problem: &dyn Problem,
    start: &[f64],
    stop: &Stop,
    wall: bool,
    method: impl Fn(&[f64]) -> Result<S, Error>,
) -> Report
where
    S: for<'a, 'p> Solver<&'a Adapter<'p>, IterState<Vec<f64>, Vec<f64>, (), H, (), f64>>,
    IterState<Vec<f64>, Vec<f64>, (), H, (), f64>: State<Param = Vec<f64>, Float = f64>,
{
    let report = Report::new(name, start, settings::estimate(problem, THRESHOLD));
    settle(problem, start, THRESHOLD, SETTLED, stop, report.clone(), |problem, from, stop| {
        let report = Report { x: from.to_vec(), ..report.clone() };
        match method(from) {
            Ok(method) => run_once(report, problem, from, stop, wall, method),
            Err(why) => report.fail(Failure::Inner(why.to_string())),
        }
    })
}

fn run_once<S, H>(
    mut report: Report,
    problem: &dyn Problem,
    start: &[f64],
    stop: &Stop,
    wall: bool,
    method: S,
) -> Report
where
    S: for<'a, 'p> Solver<&'a Adapter<'p>, IterState<Vec<f64>, Vec<f64>, (), H, (), f64>>,
    IterState<Vec<f64>, Vec<f64>, (), H, (), f64>: State<Param = Vec<f64>, Float = f64>,
{
    let here = match problem.compress(start) {
        Ok(here) if here.cost.is_finite() && here.jac.is_all_finite() => here,
        Ok(_) => return report.fail(Failure::Start("residual or Jacobian is not finite".into())),
        Err(why) => return report.fail(Failure::Start(why.0)),
    };
    report.cost = here.cost;
    let cosine = gradient_cosine(&here);
    if here.cost == 0.0 || cosine <= stop.gradient {
        let criterion = if here.cost == 0.0 { Criterion::Zero } else { Criterion::Gradient };
        report.outcome = Outcome::Converged(criterion);
        return report;
    }
    let adapter = Adapter {
        problem,
        start_cost: here.cost,
        wall,
        budget: Cell::new(EVALUATIONS * (stop.iterations + 2)),
        watch: RefCell::new(Watch { x: start.to_vec(), cost: here.cost, cosine, ..Watch::default() }),
        last: RefCell::new(Some((start.to_vec(), here))),
        refused: RefCell::new(None),
    };
    let ended = Executor::new(&adapter, Watched { method, stop: *stop })
        .configure(|state| state.param(start.to_vec()).max_iters(stop.iterations as u64))
        .ctrlc(false)
        .timer(false)
        .run();
    let unlucky = match ended {
        Err(why) => Some(why.to_string()),
        Ok(result) => match result.state.get_termination_reason() {
            Some(TerminationReason::MaxItersReached) | None => None,
            Some(reason) => Some(reason.text().to_string()),
        },
    };
    let watch = adapter.watch.take();
    report.outcome = match (watch.outcome, unlucky) {
        (Some(outcome), _) => outcome,
        (None, Some(why)) => adapter.stuck(watch.cosine, Failure::Inner(why)),
        (None, None) => Outcome::OutOfIterations,
    };
    (report.x, report.cost, report.trace) = (watch.x, watch.cost, watch.trace);
    report
}
