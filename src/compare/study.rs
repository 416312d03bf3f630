//! Result lines put in order: by condition (problem, noise, start), by identifier, by seed.

use super::line::{RunKey, RunLine, Source};
use super::profile::Descent;
use super::tolerance::Tolerance;
use crate::solve::registry;
use std::collections::BTreeMap;

/// Lines that do not belong in one table.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("these results do not belong in one table: {what} is {one} in some and {other} in others")]
pub struct Mixed {
    what: String,
    one: String,
    other: String,
}

/// Runs of one problem at one noise from one start, by identifier.
#[derive(Clone, Debug)]
pub struct Condition<'a> {
    /// The problem.
    pub problem: &'a str,
    /// Factor on its noise.
    pub noise: f64,
    /// Start, in tolerances.
    pub start: f64,
    /// Runs of each identifier of [`Study::solvers`], by seed; none where it did not run.
    pub runs: Vec<Vec<&'a RunLine>>,
}

/// Lines in order.
#[derive(Clone, Debug)]
pub struct Study<'a> {
    /// Labels of the identifiers, in the order of the registry, then of their settings.
    pub solvers: Vec<String>,
    /// Conditions, in the order in which the lines first name their problems, then by noise and start.
    pub conditions: Vec<Condition<'a>>,
    /// A line, for what all have in common.
    pub sample: &'a RunLine,
}

impl<'a> Study<'a> {
    /// Puts lines in order; `None` of no lines.
    pub fn new(lines: &'a [RunLine]) -> Result<Option<Self>, Mixed> {
        let Some(sample) = lines.first() else { return Ok(None) };
        check(lines)?;
        let known: Vec<&str> = registry::all().iter().map(|identifier| identifier.name()).collect();
        let rank = |line: &RunLine| known.iter().position(|name| *name == line.run.solver.name);
        let mut solvers: Vec<(Option<usize>, String)> =
            lines.iter().map(|line| (rank(line), line.run.solver.label())).collect();
        // Identifiers that this version does not know stand last.
        solvers.sort_by_key(|(rank, label)| (rank.is_none(), *rank, label.clone()));
        solvers.dedup();
        let solvers: Vec<String> = solvers.into_iter().map(|(_, label)| label).collect();
        let mut problems: Vec<&str> = Vec::new();
        for line in lines {
            let name = line.run.problem.name.as_str();
            if !problems.contains(&name) {
                problems.push(name);
            }
        }
        let index: BTreeMap<&str, usize> = solvers.iter().enumerate().map(|(i, s)| (s.as_str(), i)).collect();
        let mut conditions: Vec<Condition<'a>> = Vec::new();
        for line in lines {
            let run = &line.run;
            let same = |c: &&mut Condition| {
                c.problem == run.problem.name && c.noise == run.noise && c.start == run.start
            };
            let Some(&solver) = index.get(run.solver.label().as_str()) else { continue };
            if let Some(condition) = conditions.iter_mut().find(same) {
                condition.runs[solver].push(line);
                continue;
            }
            let mut runs = vec![Vec::new(); solvers.len()];
            runs[solver].push(line);
            let (problem, noise, start) = (run.problem.name.as_str(), run.noise, run.start);
            conditions.push(Condition { problem, noise, start, runs });
        }
        let place = |name: &str| problems.iter().position(|problem| *problem == name);
        conditions.sort_by(|a, b| {
            let problems = place(a.problem).cmp(&place(b.problem));
            problems.then(b.noise.total_cmp(&a.noise)).then(a.start.total_cmp(&b.start))
        });
        for runs in conditions.iter_mut().flat_map(|condition| &mut condition.runs) {
            runs.sort_by_key(|line| line.run.seed);
        }
        Ok(Some(Self { solvers, conditions, sample }))
    }

    /// Names of the problems, in order.
    pub fn problems(&self) -> Vec<&'a str> {
        let mut names: Vec<&str> = self.conditions.iter().map(|condition| condition.problem).collect();
        names.dedup();
        names
    }

    /// All runs of identifier `solver`.
    pub fn runs(&self, solver: usize) -> impl Iterator<Item = &'a RunLine> + '_ {
        self.conditions.iter().flat_map(move |condition| condition.runs[solver].iter().copied())
    }

    /// Distinct values of a number of the conditions, ascending.
    pub fn values(&self, of: impl Fn(&Condition) -> f64) -> Vec<f64> {
        let mut values: Vec<f64> = self.conditions.iter().map(of).collect();
        values.sort_by(f64::total_cmp);
        values.dedup();
        values
    }

    /// The runs that every identifier made: one of each, in order.
    pub fn matched(&self) -> Vec<Vec<&'a RunLine>> {
        let mut rows = Vec::new();
        for condition in &self.conditions {
            let Some(first) = condition.runs.first() else { continue };
            for line in first {
                let same = |runs: &Vec<&'a RunLine>| {
                    runs.iter().find(|other| other.run.seed == line.run.seed).copied()
                };
                rows.extend(condition.runs.iter().map(same).collect::<Option<Vec<_>>>());
            }
        }
        rows
    }

    /// Whether the true machine of some problem is not known.
    pub fn without_truth(&self) -> bool {
        let runs = || self.conditions.iter().flat_map(|condition| &condition.runs).flatten();
        runs().any(|line| line.score.samples > 0 && !line.score.truth)
    }

    /// What people must know to read the tables.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        for problem in self.problems() {
            let mut runs =
                self.conditions.iter().filter(|c| c.problem == problem).flat_map(|c| &c.runs).flatten();
            let Some(line) = runs.find(|line| line.score.samples > 0) else { continue };
            if !line.score.truth {
                let scored = if line.score.before.poses > 0 { "the hold-out alone" } else { "its fit alone" };
                notes.push(format!("{problem}: the true machine is not known: scored on {scored}"));
            }
        }
        if self.sample.run.data == Source::Own {
            notes.push("data are the problems' own; seeds are those of the start".into());
        }
        notes
    }
}

/// How the cost of a run fell.
pub fn descent(line: &RunLine) -> Descent {
    Descent { falls: line.effort.falls.clone() }
}

/// Refuses runs of a file that do not belong in one table with those that are planned: another content of a problem,
/// another version, another tolerance.
pub fn belong(there: &[RunLine], planned: &[RunKey]) -> Result<(), Mixed> {
    alike(planned.iter().chain(there.iter().map(|line| &line.run)))
}

/// Refuses lines that differ in what a table has in common.
fn check(lines: &[RunLine]) -> Result<(), Mixed> {
    alike(lines.iter().map(|line| &line.run))
}

fn alike<'k>(mut keys: impl Iterator<Item = &'k RunKey> + Clone) -> Result<(), Mixed> {
    let mut hashes: BTreeMap<&str, &str> = BTreeMap::new();
    let all = keys.clone();
    let Some(a) = keys.next() else { return Ok(()) };
    for b in all {
        let tolerance = |of: &Tolerance| match a.tolerance.name == b.tolerance.name {
            true => serde_json::to_string(of).unwrap_or_default(),
            false => of.name.clone(),
        };
        let limit = |limit: Option<usize>| limit.map_or_else(|| "none".into(), |n| n.to_string());
        let pairs = [
            ("the tolerance", tolerance(&a.tolerance), tolerance(&b.tolerance)),
            ("the limit of evaluations", limit(a.limit), limit(b.limit)),
            ("the version", a.version.clone(), b.version.clone()),
            ("the set of numerical crates", a.dependencies_text(), b.dependencies_text()),
            ("the source of data", format!("{:?}", a.data), format!("{:?}", b.data)),
        ];
        for (what, one, other) in pairs {
            if one != other {
                return Err(Mixed { what: what.into(), one, other });
            }
        }
        let first = hashes.entry(&b.problem.name).or_insert(&b.problem.hash);
        if *first != b.problem.hash {
            let what = format!("the content of problem {}", b.problem.name);
            return Err(Mixed { what, one: (*first).to_owned(), other: b.problem.hash.clone() });
        }
    }
    Ok(())
}
