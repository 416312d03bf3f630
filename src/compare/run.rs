//! One run: an identifier on what was drawn, watched and scored.

use super::bound::{Bound, bound};
use super::draw::{Drawn, draw};
use super::line::{Claimed, Cost, Effort, Ended, RUN_FORMAT, RunKey, RunLine, Score};
use super::machine::{Machine, peak_memory};
use super::score;
use super::watch::{Fall, Seen, Watched};
use crate::calibration::Coordinates;
use crate::files::ProblemFile;
use crate::identify::{Identification, identify_from};
use crate::problem::Form;
use crate::solve::{Failure, Identifier, Outcome, Report};

/// Truth, data and bound: the same for every identifier of a run.
pub struct Stage {
    drawn: Drawn,
    bound: Option<Bound>,
    before: Score,
}

impl Stage {
    /// Draws what the key says; the reason where it cannot be drawn.
    pub fn set(problem: &ProblemFile, key: &RunKey) -> Result<Self, String> {
        let drawn = draw(problem, key.data, key.noise, key.start, key.seed).map_err(|why| why.to_string())?;
        let bound = bound(&drawn);
        let before = score::before(&drawn, bound.as_ref());
        Ok(Self { drawn, bound, before })
    }
}

/// Runs the identifier of the key on the stage; a stage that could not be set gives a line that says so.
pub fn run(
    key: RunKey,
    problem: &ProblemFile,
    identifier: &dyn Identifier,
    stage: &Result<Stage, String>,
    machine: &Machine,
) -> RunLine {
    let watched = Watched::new(identifier, key.limit);
    let ran = stage.as_ref().map_err(Clone::clone).and_then(|stage| {
        let Drawn { samples, from, .. } = &stage.drawn;
        let found = identify_from(&problem.mechanism, samples, &watched, &key.tolerance.stop, from);
        found.map(|found| (stage, found)).map_err(|why| why.to_string())
    });
    let seen = watched.seen();
    let cost = Cost {
        wall: seen.wall.as_secs_f64(),
        cpu: seen.cpu.map(|cpu| cpu.as_secs_f64()),
        memory: peak_memory(),
        threads: machine.threads,
        machine: machine.name.clone(),
    };
    let format = RUN_FORMAT.to_owned();
    match ran {
        Ok((stage, found)) => {
            let form = identifier.form();
            let score = score::after(&stage.before, &stage.drawn, stage.bound.as_ref(), &found, form);
            let verified = score::verify(&score, &key.tolerance);
            let effort = effort(&seen, &found, stage, form, score.cost);
            RunLine {
                format,
                claimed: claimed(&found.report, &seen),
                verified,
                score,
                effort,
                cost,
                run: key,
            }
        }
        Err(reason) => {
            let score = stage.as_ref().map(|stage| stage.before.clone()).unwrap_or_default();
            let mut verified = score::verify(&score, &key.tolerance);
            (verified.success, verified.reason) = (false, reason.clone());
            let claimed = Claimed { ended: Ended::Refused, reason };
            RunLine { format, claimed, verified, score, effort: Effort::default(), cost, run: key }
        }
    }
}

fn claimed(report: &Report, seen: &Seen) -> Claimed {
    let ended = match &report.outcome {
        Outcome::Converged(_) => Ended::Converged,
        _ if seen.limited => Ended::Limit,
        Outcome::OutOfIterations => Ended::Limit,
        Outcome::Failed(Failure::Start(_) | Failure::Unsuited(_)) => Ended::Refused,
        Outcome::Failed(_) => Ended::Failed,
    };
    let reason = match (seen.limited, ended) {
        (true, Ended::Limit) => "evaluation limit reached".into(),
        _ => report.outcome.to_string(),
    };
    Claimed { ended, reason }
}

/// What was evaluated, with costs in the stated noise.
fn effort(seen: &Seen, found: &Identification, stage: &Stage, form: Form, cost: Option<f64>) -> Effort {
    let evaluations = seen.residuals + seen.jacobians;
    let mut falls: Vec<(f64, f64)> = match form {
        Form::Minimal | Form::Complete => seen.falls.iter().map(|f| (f.evaluations, f.cost)).collect(),
        Form::Plain => {
            seen.falls.iter().filter_map(|f| Some((f.evaluations, whitened(f, found, stage)?))).collect()
        }
    };
    if let Some(cost) = cost {
        falls.push((evaluations, cost));
    }
    falls.retain(|(_, cost)| cost.is_finite());
    Effort { iterations: found.trace.len(), residuals: seen.residuals, jacobians: seen.jacobians, falls }
}

/// Cost in the stated noise at a point in plain coordinates.
fn whitened(fall: &Fall, found: &Identification, stage: &Stage) -> Option<f64> {
    let at = Coordinates::new(&found.start, Form::Plain).deviations(fall.at.as_ref()?);
    score::cost(&found.start, &found.start.deviated(&at), &stage.drawn.samples)
}
