//! `gough compare`: identifiers side by side.

use super::dispatch::Ending;
use super::error::CliError;
use crate::compare::campaign::{Campaign, Cell, Contestant, Shard, Subject};
use crate::compare::draw::check_recipe;
use crate::compare::execute::execute;
use crate::compare::line::{RunKey, RunLine, Source};
use crate::compare::publish;
use crate::compare::store::{self, Store};
use crate::compare::study::{Mixed, belong};
use crate::compare::tolerance::Tolerance;
use crate::files::{DataPlaces, FileError, Output, read_problem};
use crate::model::mobility;
use crate::solve::registry;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Identifier that only runs where it is asked for: its linear programs do not see the curvature of the flat valleys of
/// closed loops, and minutes go by there.
const SLOW: &str = "conic-minimax";

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Problem files: machines, tolerances and noise; each run draws its own truth and data
    #[arg(required_unless_present = "merge")]
    problems: Vec<PathBuf>,
    /// Identifiers, divided by commas, or `all`; all but conic-minimax, which takes minutes on closed loops, where this
    /// is left out (see `gough solvers`)
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    solvers: Vec<String>,
    /// Setting of an identifier, such as minimal.threshold=3; may be repeated
    #[arg(long = "set", value_name = "SOLVER.KEY=VALUE")]
    settings: Vec<String>,
    /// Runs of each kind, with seeds 1 to N
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    seeds: u64,
    /// Factors on the noise, of which the instrument knows
    #[arg(
        long,
        value_name = "1,0.1",
        value_delimiter = ',',
        default_value = "1",
        allow_negative_numbers = true
    )]
    noise: Vec<f64>,
    /// Starts, in tolerances from nominal; what the problem recommends, or nominal, where this is left out
    #[arg(long, value_name = "0,1,5", value_delimiter = ',', allow_negative_numbers = true)]
    start: Vec<f64>,
    /// When identifiers stop, and what passes as success
    #[arg(long, value_name = "NAME", default_value = "default", value_parser = Tolerance::NAMES)]
    tolerance: String,
    /// Most evaluations of a run; 0 for no limit
    #[arg(long, value_name = "N", default_value_t = 1000)]
    evaluations: usize,
    /// Run part K of N only
    #[arg(long, value_name = "K/N", value_parser = Shard::parse)]
    shard: Option<Shard>,
    /// Identify from the problems' own data instead of simulated ones
    #[arg(long)]
    own_data: bool,
    /// Further folder in which data files are looked for
    #[arg(long, value_name = "DIR")]
    data_dir: Option<PathBuf>,
    /// Make the tables and figures of these result files instead of running anything
    #[arg(long, value_name = "FILE", num_args = 1.., conflicts_with_all = ["problems", "shard"])]
    merge: Vec<PathBuf>,
    /// Folder for results, tables and figures; a campaign that was interrupted goes on from there
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
}

/// Runs what is not there yet, or merges, and writes tables and figures.
pub fn run(args: &Args) -> Result<Ending, CliError> {
    let folder = args.output.as_deref();
    if let Some(folder) = folder {
        std::fs::create_dir_all(folder).map_err(|why| {
            CliError::Usage(format!("-o {}: the folder cannot be made: {why}", folder.display()))
        })?;
    }
    let lines = if args.merge.is_empty() { campaign(args, folder)? } else { merged(args, folder)? };
    let mixed = |why: Mixed| CliError::Usage(format!("{why}; compare them in folders of their own"));
    if let Some(Shard { index, count }) = args.shard {
        let files = format!("runs-*-of-{count}.jsonl");
        eprintln!("part {index} of {count} is done; tables: gough compare --merge {files} -o DIR");
        if folder.is_some() {
            return Ok(Ending::Done);
        }
    }
    if let Some(folder) = folder {
        for (name, text) in publish::files(&lines).map_err(mixed)? {
            Output::File(folder.join(name)).write(text.as_bytes())?;
        }
    }
    Output::Stdout.write(publish::markdown(&lines).map_err(mixed)?.as_bytes())?;
    Ok(Ending::Done)
}

fn merged(args: &Args, folder: Option<&Path>) -> Result<Vec<RunLine>, CliError> {
    let mut files = Vec::with_capacity(args.merge.len());
    for path in &args.merge {
        let found = store::read(path)?;
        if let Some(line) = found.torn {
            eprintln!("warning: {}: line {line} is torn and left out", path.display());
        }
        files.push((path.clone(), found));
    }
    let lines = store::merge(&files)?;
    if lines.is_empty() {
        return Err(CliError::Usage("--merge: there are no results in these files".into()));
    }
    if let Some(folder) = folder {
        let path = folder.join("runs.jsonl");
        Output::File(path.clone()).write(&store::text(&path, &lines)?)?;
    }
    Ok(lines)
}

fn campaign(args: &Args, folder: Option<&Path>) -> Result<Vec<RunLine>, CliError> {
    let campaign = planned(args)?;
    let cells = campaign.cells();
    let order: Vec<RunKey> = cells.iter().flat_map(|c| c.runs.iter().map(|(_, key)| key.clone())).collect();
    let Some(folder) = folder else {
        let lines = Mutex::new(Vec::with_capacity(order.len()));
        made(&campaign, &cells, order.len(), |line| {
            lines.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).push(line);
            Ok(())
        })?;
        let lines = lines.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
        return Ok(store::in_order(lines, &order));
    };
    let path = folder.join(match args.shard {
        None => "runs.jsonl".to_owned(),
        Some(Shard { index, count }) => format!("runs-{index}-of-{count}.jsonl"),
    });
    let (store, found) = Store::open(&path)?;
    let lines: Vec<RunLine> = found.lines.into_iter().map(|(_, line)| line).collect();
    belong(&lines, &order).map_err(|why| {
        CliError::Usage(format!(
            "{}: {why}; give -o a folder of its own, or remove this file",
            path.display()
        ))
    })?;
    let there: HashMap<String, RunLine> = lines.into_iter().map(|line| (line.run.text(), line)).collect();
    let pending = missing(&cells, &there);
    let count: usize = pending.iter().map(|cell| cell.runs.len()).sum();
    if count < order.len() {
        eprintln!("{}: {} of {} runs are there already", path.display(), order.len() - count, order.len());
    }
    let state = Mutex::new((store, there));
    made(&campaign, &pending, count, |line| {
        let (store, there) = &mut *state.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        store.add(&line)?;
        there.insert(line.run.text(), line);
        Ok(())
    })?;
    let (store, there) = state.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
    let mut by_key: Vec<(String, RunLine)> = there.into_iter().collect();
    by_key.sort_by(|(a, _), (b, _)| a.cmp(b));
    let mut lines = store::in_order(by_key.into_iter().map(|(_, line)| line).collect(), &order);
    // In the order of the campaign, whatever order the runs ended in.
    Output::File(path.clone()).write(&store::text(&path, &lines)?)?;
    drop(store);
    lines.truncate(order.len());
    Ok(lines)
}

/// The cells without the runs whose lines are there.
fn missing(cells: &[Cell], there: &HashMap<String, RunLine>) -> Vec<Cell> {
    let mut pending = cells.to_vec();
    for cell in &mut pending {
        cell.runs.retain(|(_, key)| !there.contains_key(&key.text()));
    }
    pending.retain(|cell| !cell.runs.is_empty());
    pending
}

/// Makes the runs under a bar that says how long it will take.
fn made(
    campaign: &Campaign,
    cells: &[Cell],
    count: usize,
    done: impl Fn(RunLine) -> Result<(), FileError> + Sync,
) -> Result<(), FileError> {
    let bar = super::progress::bar(count as u64);
    let outcome = execute(campaign, cells, |line| {
        done(line)?;
        bar.inc(1);
        Ok(())
    });
    bar.finish_and_clear();
    outcome
}

/// The campaign that the arguments ask for.
fn planned(args: &Args) -> Result<Campaign, CliError> {
    let usage = |message: String| Err(CliError::Usage(message));
    for value in &args.noise {
        if !(value.is_finite() && *value > 0.0) {
            return usage(format!("--noise {value}: it must be a number above 0"));
        }
    }
    for value in &args.start {
        if !(value.is_finite() && *value >= 0.0) {
            return usage(format!("--start {value}: it must be a number that is not negative"));
        }
    }
    if args.own_data && args.noise != [1.0] {
        return usage("--noise does not go with --own-data: the noise of measured data is what it is".into());
    }
    let source = if args.own_data { Source::Own } else { Source::Simulated };
    let Some(tolerance) = Tolerance::named(&args.tolerance) else {
        return usage(format!("--tolerance {}: {}", args.tolerance, Tolerance::NAMES.join(", ")));
    };
    let contestants = contestants(args)?;
    let mut subjects: Vec<Subject> = Vec::with_capacity(args.problems.len());
    for path in &args.problems {
        let subject = subject(path, args)?;
        if let Some(other) = subjects.iter().find(|other| other.key.name == subject.key.name) {
            let (a, b) = (&other.problem.file, &subject.problem.file);
            return usage(format!(
                "{a} and {b} are both called {}: give each its own name",
                subject.key.name
            ));
        }
        subjects.push(subject);
    }
    Ok(Campaign {
        subjects,
        contestants,
        source,
        noises: distinct(&args.noise),
        starts: distinct(&args.start),
        seeds: args.seeds,
        tolerance,
        limit: (args.evaluations > 0).then_some(args.evaluations),
        shard: args.shard,
    })
}

fn distinct(values: &[f64]) -> Vec<f64> {
    let mut kept: Vec<f64> = Vec::with_capacity(values.len());
    for value in values {
        // Of -0 and 0 the latter.
        let value = value + 0.0;
        if !kept.contains(&value) {
            kept.push(value);
        }
    }
    kept
}

fn subject(path: &Path, args: &Args) -> Result<Subject, CliError> {
    let problem = read_problem(path, &DataPlaces::from_environment(args.data_dir.clone()))?;
    problem.require_tolerances()?;
    mobility::check(&problem.mechanism, &problem.mechanism.nominal())
        .map_err(|why| CliError::Mobility { file: problem.file.clone(), why })?;
    if args.own_data {
        problem.require_samples()?;
    } else if problem.data.parts().iter().any(|set| set.noise.is_none()) {
        return Err(CliError::Usage(format!(
            "{}: data.noise is not stated: simulation needs to know it; state it, or give --own-data",
            problem.file
        )));
    } else {
        check_recipe(&problem).map_err(|why| CliError::Usage(format!("{}: {why}", problem.file)))?;
    }
    Ok(Subject::new(problem))
}

fn contestants(args: &Args) -> Result<Vec<Contestant>, CliError> {
    let mut identifiers = registry::all();
    match args.solvers.as_slice() {
        [] => identifiers.retain(|identifier| identifier.name() != SLOW),
        [all] if all == "all" => {}
        names => {
            identifiers = names.iter().map(|name| registry::find(name.trim())).collect::<Result<_, _>>()?;
        }
    }
    let mut names: Vec<&str> = identifiers.iter().map(|identifier| identifier.name()).collect();
    names.sort_unstable();
    if let Some(pair) = names.windows(2).find(|pair| pair[0] == pair[1]) {
        return Err(CliError::Usage(format!("--solvers: {} is named twice", pair[0])));
    }
    for setting in &args.settings {
        let form = || CliError::Usage(format!("--set {setting}: write it as SOLVER.KEY=VALUE"));
        let (name, rest) = setting.split_once('.').ok_or_else(form)?;
        let (key, value) = rest.split_once('=').ok_or_else(form)?;
        registry::find(name)?;
        let identifier = identifiers.iter_mut().find(|identifier| identifier.name() == name);
        let missing = || CliError::Usage(format!("--set {setting}: {name} is not among the --solvers"));
        identifier.ok_or_else(missing)?.set(key, value)?;
    }
    Ok(identifiers.into_iter().map(Contestant::new).collect())
}
