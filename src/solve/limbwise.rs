//! The parts of a problem one by one.

use super::identifier::{Identifier, Stop};
use super::minimal::Minimal;
use super::report::{Criterion, Estimate, Failure, Iterate, Outcome, Report};
use crate::linalg::norm;
use crate::problem::Problem;
use rayon::prelude::*;

/// Runs [`Minimal`] on every independent part of the problem: for a parallel machine measured in whole poses, on one
/// limb after the other, a fraction of the coordinates each.
#[derive(Clone, Copy, Debug, Default)]
pub struct Limbwise;

impl Identifier for Limbwise {
    fn name(&self) -> &'static str {
        "limbwise"
    }

    fn summary(&self) -> &'static str {
        "minimal on each limb by itself (whole poses only): fastest with many poses, blind to correlations between limbs"
    }

    fn identify(&self, problem: &dyn Problem, start: &[f64], stop: &Stop) -> Report {
        let estimate = Estimate::Decoupled { threshold: Minimal::default().threshold };
        let mut report = Report::new(self.name(), start, estimate);
        let Some(parts) = problem.parts() else {
            let why = "it does not fall into independent parts: every sample must be a whole pose, and limbs must share no \
                       unknown motion (placement, tool_mounting)";
            return report.fail(Failure::Unsuited(why.into()));
        };
        let solved: Vec<Report> = parts
            .par_iter()
            .map(|part| {
                let own: Vec<f64> = part.members.iter().map(|&i| start[i]).collect();
                Minimal::renewing().identify(part.problem.as_ref(), &own, stop)
            })
            .collect();
        for (part, solution) in parts.iter().zip(&solved) {
            for (&i, value) in part.members.iter().zip(&solution.x) {
                report.x[i] = *value;
            }
        }
        report.trace = merged(&solved);
        let failed = solved.iter().find(|solution| !solution.outcome.converged());
        report.outcome = match failed {
            Some(failed) => failed.outcome.clone(),
            None => Outcome::Converged(Criterion::Cost),
        };
        report.cost = solved.iter().map(|solution| solution.cost).sum();
        report
    }
}

/// Iteration k of all parts together; a part that has ended stays where it is.
fn merged(solved: &[Report]) -> Vec<Iterate> {
    let longest = solved.iter().map(|solution| solution.trace.len()).max().unwrap_or(0);
    let mut trace = Vec::with_capacity(longest);
    for k in 0..longest {
        let at = |solution: &Report| solution.trace.get(k.min(solution.trace.len().max(1) - 1)).copied();
        let steps: Vec<f64> = solved.iter().filter_map(|s| s.trace.get(k)).map(|t| t.step).collect();
        trace.push(Iterate {
            cost: solved.iter().filter_map(at).map(|t| t.cost).sum(),
            step: norm(&steps),
            kept: Some(solved.iter().filter_map(at).filter_map(|t| t.kept).sum()),
        });
    }
    trace
}
