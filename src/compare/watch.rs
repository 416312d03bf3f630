//! Looks over an identifier's shoulder: what it evaluates, how long it takes, how the cost falls.

use crate::problem::{
    Compressed, EvalError, Form, Group, Linearized, Param, Part, Problem, Representative, cost,
};
use crate::solve::{Identifier, Report, Stop};
use faer::Mat;
use std::ops::Range;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Part of its value by which the cost must fall to be noted again.
const NOTED: f64 = 1e-3;

/// Where the cost fell.
#[derive(Clone, Debug, PartialEq)]
pub struct Fall {
    /// Evaluations until then, of residual and Jacobian.
    pub evaluations: f64,
    /// Cost in the weights of the identifier's form.
    pub cost: f64,
    /// The point, for forms whose weights are not those of the noise.
    pub at: Option<Vec<f64>>,
}

/// What was seen of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Seen {
    /// Evaluations of the residual alone; that of a part of the problem counts by the part's share of parameters.
    pub residuals: f64,
    /// Evaluations of residual and Jacobian.
    pub jacobians: f64,
    /// Falls of the cost in the last round, first evaluation first.
    pub falls: Vec<Fall>,
    /// Whether an evaluation was refused because there had been as many as allowed.
    pub limited: bool,
    /// Wall time of the identifier.
    pub wall: Duration,
    /// Its processor time, where the system tells that of a thread.
    pub cpu: Option<Duration>,
}

/// An identifier that is watched. Evaluations beyond the limit are refused, so that every identifier ends.
pub struct Watched<'a> {
    identifier: &'a dyn Identifier,
    limit: Option<usize>,
    seen: Mutex<Tally>,
}

#[derive(Default)]
struct Tally {
    /// Residuals and Jacobians, of the whole problem and of its parts.
    counts: Vec<(usize, usize)>,
    shares: Vec<f64>,
    seen: Seen,
}

impl Tally {
    fn totals(&self) -> (f64, f64) {
        let add = |(r, j): (f64, f64), ((residuals, jacobians), share): (&(usize, usize), &f64)| {
            (r + *residuals as f64 * share, j + *jacobians as f64 * share)
        };
        self.counts.iter().zip(&self.shares).fold((0.0, 0.0), add)
    }

    /// Index of the counts of a part with this share.
    fn part(&mut self, index: usize, share: f64) -> usize {
        if self.counts.len() <= index {
            self.counts.resize(index + 1, (0, 0));
            self.shares.resize(index + 1, 0.0);
        }
        self.shares[index] = share;
        index
    }
}

impl<'a> Watched<'a> {
    /// Watches `identifier`, which may evaluate the problem `limit` times.
    pub fn new(identifier: &'a dyn Identifier, limit: Option<usize>) -> Self {
        Self { identifier, limit, seen: Mutex::default() }
    }

    /// What was seen.
    pub fn seen(self) -> Seen {
        let tally = self.seen.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
        let (residuals, jacobians) = tally.totals();
        Seen { residuals, jacobians, ..tally.seen }
    }

    fn tally(&self) -> std::sync::MutexGuard<'_, Tally> {
        self.seen.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }
}

impl Identifier for Watched<'_> {
    fn name(&self) -> &'static str {
        self.identifier.name()
    }

    fn summary(&self) -> &'static str {
        self.identifier.summary()
    }

    fn form(&self) -> Form {
        self.identifier.form()
    }

    fn settings(&self) -> Vec<(&'static str, String)> {
        self.identifier.settings()
    }

    fn identify(&self, problem: &dyn Problem, start: &[f64], stop: &Stop) -> Report {
        let index = {
            let mut tally = self.tally();
            tally.seen.falls.clear();
            tally.part(0, 1.0)
        };
        let keeps_points = self.identifier.form() == Form::Plain;
        let counted = Counted { inner: Inner::Whole(problem), watched: self, index, keeps_points };
        let (wall, cpu) = (Instant::now(), thread_time());
        let report = self.identifier.identify(&counted, start, stop);
        let (wall, after) = (wall.elapsed(), thread_time());
        let mut tally = self.tally();
        tally.seen.wall += wall;
        if let (Some(before), Some(after)) = (cpu, after) {
            let spent = after.saturating_sub(before);
            tally.seen.cpu = Some(tally.seen.cpu.unwrap_or_default() + spent);
        }
        report
    }
}

/// Processor time of this thread.
#[cfg(unix)]
fn thread_time() -> Option<Duration> {
    use rustix::time::{ClockId, clock_gettime};
    Duration::try_from(clock_gettime(ClockId::ThreadCPUTime)).ok()
}

#[cfg(not(unix))]
fn thread_time() -> Option<Duration> {
    None
}

enum Inner<'a> {
    Whole(&'a dyn Problem),
    Part(Box<dyn Problem + 'a>),
}

/// A problem whose evaluations are counted.
struct Counted<'a> {
    inner: Inner<'a>,
    watched: &'a Watched<'a>,
    index: usize,
    keeps_points: bool,
}

impl Counted<'_> {
    fn problem(&self) -> &dyn Problem {
        match &self.inner {
            Inner::Whole(problem) => *problem,
            Inner::Part(problem) => problem.as_ref(),
        }
    }

    /// Counts one evaluation; refuses it where there have been enough.
    fn count(&self, jacobian: bool) -> Result<(), EvalError> {
        let mut tally = self.watched.tally();
        let (residuals, jacobians) = tally.totals();
        if let Some(limit) = self.watched.limit
            && residuals + jacobians >= limit as f64
        {
            tally.seen.limited = true;
            return Err(EvalError(format!("the limit of {limit} evaluations is reached")));
        }
        let (residuals, jacobians) = &mut tally.counts[self.index];
        if jacobian {
            *jacobians += 1
        } else {
            *residuals += 1
        }
        Ok(())
    }

    /// Notes the cost at `x` where it fell.
    fn note(&self, x: &[f64], cost: f64) {
        if matches!(self.inner, Inner::Part(_)) {
            return;
        }
        let mut tally = self.watched.tally();
        let (residuals, jacobians) = tally.totals();
        let falls = &mut tally.seen.falls;
        if falls.last().is_none_or(|last| cost < last.cost * (1.0 - NOTED)) {
            let at = self.keeps_points.then(|| x.to_vec());
            falls.push(Fall { evaluations: residuals + jacobians, cost, at });
        }
    }
}

impl Problem for Counted<'_> {
    fn params(&self) -> &[Param] {
        self.problem().params()
    }

    fn groups(&self) -> &[Group] {
        self.problem().groups()
    }

    fn has_prior(&self) -> bool {
        self.problem().has_prior()
    }

    fn residual(&self, x: &[f64]) -> Result<Vec<f64>, EvalError> {
        self.count(false)?;
        let r = self.problem().residual(x)?;
        self.note(x, cost(&r));
        Ok(r)
    }

    fn linearize(&self, x: &[f64]) -> Result<Linearized, EvalError> {
        self.count(true)?;
        let lin = self.problem().linearize(x)?;
        self.note(x, cost(&lin.r));
        Ok(lin)
    }

    fn compress(&self, x: &[f64]) -> Result<Compressed, EvalError> {
        self.count(true)?;
        let here = self.problem().compress(x)?;
        self.note(x, here.cost);
        Ok(here)
    }

    fn gradient(&self, x: &[f64]) -> Result<(f64, Vec<f64>), EvalError> {
        self.count(true)?;
        let (cost, gradient) = self.problem().gradient(x)?;
        self.note(x, cost);
        Ok((cost, gradient))
    }

    fn parts(&self) -> Option<Vec<Part<'_>>> {
        let whole = self.params().len().max(1) as f64;
        let parts = self.problem().parts()?.into_iter().enumerate().map(|(i, part)| {
            let index = self.watched.tally().part(i + 1, part.members.len() as f64 / whole);
            let inner = Inner::Part(part.problem);
            let problem = Counted { inner, watched: self.watched, index, keeps_points: false };
            Part { problem: Box::new(problem), members: part.members }
        });
        Some(parts.collect())
    }

    fn blocks(&self) -> Vec<Range<usize>> {
        self.problem().blocks()
    }

    fn representative(&self, x: &[f64]) -> Option<Representative> {
        self.problem().representative(x)
    }

    fn redundant(&self, x: &[f64]) -> Mat<f64> {
        self.problem().redundant(x)
    }
}
