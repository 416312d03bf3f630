//! What is run: problems by noises by starts by seeds by identifiers, in this order.

use super::dependencies;
use super::line::{ProblemKey, RunKey, SolverKey, Source};
use super::tolerance::Tolerance;
use crate::files::ProblemFile;
use crate::solve::Identifier;
use sha2::{Digest, Sha256};

/// A problem that takes part.
pub struct Subject {
    /// As read.
    pub problem: ProblemFile,
    /// Name and content.
    pub key: ProblemKey,
}

/// An identifier that takes part.
pub struct Contestant {
    /// With its settings.
    pub identifier: Box<dyn Identifier>,
    /// Name and settings.
    pub key: SolverKey,
}

/// Part `index` of `count`, from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Which part.
    pub index: usize,
    /// Of how many.
    pub count: usize,
}

/// A cross product of runs.
pub struct Campaign {
    /// Problems.
    pub subjects: Vec<Subject>,
    /// Identifiers.
    pub contestants: Vec<Contestant>,
    /// Where data come from.
    pub source: Source,
    /// Factors on the noise.
    pub noises: Vec<f64>,
    /// Starts in tolerances from nominal; those that problems state for themselves, or nominal, where there are none.
    pub starts: Vec<f64>,
    /// Seeds `1..=seeds`.
    pub seeds: u64,
    /// When to stop, and what passes.
    pub tolerance: Tolerance,
    /// Most evaluations.
    pub limit: Option<usize>,
    /// The part that is run.
    pub shard: Option<Shard>,
}

/// Runs that share truth, data and start.
#[derive(Clone, Debug)]
pub struct Cell {
    /// Index of the problem.
    pub subject: usize,
    /// Index of each identifier, and its run.
    pub runs: Vec<(usize, RunKey)>,
}

impl Subject {
    /// The problem with the key to its content: machine, tolerances, noise, data and recipe, but no words on it.
    pub fn new(problem: ProblemFile) -> Self {
        let mut drawing = problem.drawing.clone();
        drawing.description = None;
        if let Some(benchmark) = &mut drawing.benchmark {
            benchmark.purpose.clear();
            benchmark.stresses.clear();
            benchmark.reference = None;
        }
        let mut hash = Sha256::new();
        hash.update(serde_json::to_vec(&drawing).unwrap_or_default());
        // Data that stand in a file of their own.
        for data in [&problem.data, &problem.holdout] {
            for (sample, measured) in data.samples.iter().zip(&data.measured) {
                hash.update(format!("{:?} {measured:?}", sample.actuators));
            }
        }
        let hash = hash.finalize().iter().take(8).map(|byte| format!("{byte:02x}")).collect();
        let key = ProblemKey { name: problem.name.clone(), hash };
        Self { problem, key }
    }
}

impl Contestant {
    /// The identifier with the settings that it has now.
    pub fn new(identifier: Box<dyn Identifier>) -> Self {
        let settings =
            identifier.settings().into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
        let key = SolverKey { name: identifier.name().to_owned(), settings };
        Self { identifier, key }
    }
}

impl Shard {
    /// `k/n` with k in 1..=n.
    pub fn parse(text: &str) -> Result<Self, String> {
        let wrong = || format!("{text}: write it as k/n, such as 1/4");
        let (index, count) = text.split_once('/').ok_or_else(wrong)?;
        let index: usize = index.trim().parse().map_err(|_| wrong())?;
        let count: usize = count.trim().parse().map_err(|_| wrong())?;
        match (1..=count).contains(&index) {
            true => Ok(Self { index, count }),
            false => Err(format!("{text}: there is no such part; parts are 1/{count} to {count}/{count}")),
        }
    }
}

impl Campaign {
    /// The cells of this part, in order.
    pub fn cells(&self) -> Vec<Cell> {
        let mut cells = Vec::new();
        for (index, subject) in self.subjects.iter().enumerate() {
            let own = subject.problem.drawing.benchmark.as_ref().and_then(|b| b.start).unwrap_or(0.0);
            let starts = if self.starts.is_empty() { vec![own] } else { self.starts.clone() };
            for &noise in &self.noises {
                for &start in &starts {
                    // Own data from nominal are the same for every seed.
                    let seeds = if self.source == Source::Own && start == 0.0 { 1 } else { self.seeds };
                    for seed in 1..=seeds {
                        cells.push(self.cell(index, noise, start, seed));
                    }
                }
            }
        }
        if let Some(shard) = self.shard {
            let mut position = 0;
            cells.retain(|_| {
                position += 1;
                (position - 1) % shard.count == shard.index - 1
            });
        }
        cells
    }

    fn cell(&self, subject: usize, noise: f64, start: f64, seed: u64) -> Cell {
        let run = |(index, contestant): (usize, &Contestant)| {
            let key = RunKey {
                problem: self.subjects[subject].key.clone(),
                data: self.source,
                noise,
                start,
                seed,
                solver: contestant.key.clone(),
                tolerance: self.tolerance.clone(),
                limit: self.limit,
                version: env!("CARGO_PKG_VERSION").to_owned(),
                dependencies: dependencies::versions().clone(),
            };
            (index, key)
        };
        Cell { subject, runs: self.contestants.iter().enumerate().map(run).collect() }
    }
}
