//! `gough plan`: which postures to measure.

use super::at::{registered, require_size_of, with_links_of};
use super::details::digits;
use super::dispatch::Ending;
use super::error::CliError;
use super::progress::with_spinner;
use super::wording::{share_reached, unfit};
use crate::design::candidates::MOST;
use crate::design::{
    Candidates, Criterion, DesignError, Expected, Instrument, Plan, ReachedPlan, RealMachines, Request,
    Settings, Unfit, reached_plan,
};
use crate::files::{
    DataPlaces, DataSet, Kind, Model, Output, ProblemFile, SampleDrawing, Units, planned_text,
    read_actuators, read_model, read_problem, readings,
};
use crate::model::{Mechanism, Prior, mobility};
use std::io;
use std::path::{Path, PathBuf};

/// Random candidates where none are stated.
const RANDOM: u32 = 2000;
/// Postures of a workspace that is not stated.
const WORKSPACE: usize = 200;

/// What samples refer to by name, besides their readings.
const NAMES: [&str; 4] = ["target", "point", "plane", "gauge"];

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Problem file: machine, tolerances and noise
    problem: PathBuf,
    /// Number of postures to choose
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    poses: u32,
    /// Plan for the machine of this result, whose postures are those of the real one, instead of the drawing
    #[arg(long, value_name = "RESULT")]
    at: Option<PathBuf>,
    /// Choose among the actuator readings of this file (CSV, or JSON with samples)
    #[arg(long, value_name = "FILE", conflicts_with_all = ["grid", "random"])]
    candidates: Option<PathBuf>,
    /// Choose among K values of every actuator, evenly over its range
    #[arg(long, value_name = "K", conflicts_with = "random", value_parser = clap::value_parser!(u32).range(1..=1000))]
    grid: Option<u32>,
    /// Choose among M random postures in the actuators' ranges (2000 if nothing is said)
    #[arg(long, value_name = "M", value_parser = clap::value_parser!(u32).range(1..=MOST as i64))]
    random: Option<u32>,
    /// What to optimise: D (volume of confidence), A (sum of variances), E (worst combination of deviations), G (worst
    /// posture of the workspace)
    #[arg(long, value_name = "D|A|E|G", default_value = "D")]
    criterion: String,
    /// Readings of the postures in which the machine has to be accurate (200 random ones if left out)
    #[arg(long, value_name = "FILE")]
    workspace: Option<PathBuf>,
    /// Add to the postures that the problem holds, as measured
    #[arg(long)]
    add_to_measured: bool,
    /// Least ratio of the extreme singular values of the wrench matrix, away from singularities
    #[arg(long, value_name = "RATIO", default_value_t = 0.01)]
    regularity: f64,
    /// Sets of postures to begin from: the best result counts
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=1000))]
    starts: u32,
    /// Seed of everything random
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Further folder in which data files are looked for
    #[arg(long, value_name = "DIR")]
    data_dir: Option<PathBuf>,
    /// Where to write the readings (CSV; standard output if left out, the summary then goes to standard error)
    #[arg(short, long, value_name = "PLAN.csv")]
    output: Option<PathBuf>,
}

/// Writes the readings of the postures to measure, and says what to expect of them.
pub fn run(args: &Args) -> Result<Ending, CliError> {
    let output = Output::named(args.output.as_deref());
    output.check()?;
    let criterion = Criterion::find(&args.criterion).ok_or_else(|| {
        let known = Criterion::ALL.map(Criterion::name).join(", ");
        CliError::Usage(format!("unknown criterion {}; known criteria: {known}", args.criterion))
    })?;
    if !(0.0..1.0).contains(&args.regularity) {
        return Err(CliError::Usage("--regularity must be a ratio of at least 0 and below 1".into()));
    }
    let problem = read_problem(&args.problem, &DataPlaces::from_environment(args.data_dir.clone()))?;
    problem.require_tolerances()?;
    let mut model = read_model(&args.problem)?;
    model.mechanism = machine(args, &problem)?;
    let mechanism = &model.mechanism;
    mobility::check(mechanism, &mechanism.nominal())
        .map_err(|why| CliError::Mobility { file: problem.file.clone(), why })?;
    if args.add_to_measured {
        problem.require_samples()?;
    }
    let set = planned_set(&problem)?;
    let instrument =
        Instrument { blanks: set.blanks.iter().map(|blank| blank.measurement.clone()).collect() };
    let design = |why| CliError::Design { file: problem.file.clone(), why };
    let told = |why: &Unfit| unfit(why, problem.units);
    let poses = args.poses as usize;
    let message = format!("choosing {poses} postures for {}", problem.name);
    // A touch happens where the machine is led to the surface.
    let contact = set.blanks.iter().any(|blank| blank.measurement.is_contact());
    let led = |found: Candidates| match contact {
        true => found.touching(mechanism, &instrument.blanks, args.regularity),
        false => found,
    };
    // Two postures are compared: there must be two.
    let least = if set.kind == Kind::Separation { 2 } else { 1 };
    let (workspace, found) = with_spinner(message, || {
        let candidates = led(candidates(args, &model)?);
        candidates.require(poses.max(least), &told).map_err(design)?;
        let workspace = led(workspace(args, &model)?);
        workspace.require(least, &told).map_err(design)?;
        let request = Request {
            mechanism,
            instrument: &instrument,
            measured: if args.add_to_measured { &problem.data.samples } else { &[] },
            workspace: &workspace.fit,
            settings: Settings { poses, criterion, starts: args.starts.into(), seed: args.seed },
            group: if contact { set.blanks.len() } else { 1 },
        };
        let real = RealMachines::drawn(mechanism);
        let found = reached_plan(&request, &real, candidates, &told).map_err(design)?;
        Ok::<_, CliError>((workspace, found))
    })?;
    let ReachedPlan { candidates, plan, left_out, .. } = &found;
    let text = written(mechanism, &problem, set, &instrument, candidates, plan)
        .map_err(|why| CliError::Usage(format!("the plan cannot be written: {why}")))?;
    output.write(&text)?;
    let added = args.add_to_measured.then(|| problem.data.samples.len() - left_out.len());
    let told = summary(args, &problem, criterion, (workspace.fit.len(), added), &found);
    match output {
        Output::Stdout => eprint!("{told}"),
        Output::File(_) => Output::Stdout.write(told.as_bytes())?,
    }
    if !left_out.is_empty() {
        eprintln!(
            "warning: {} measured postures do not close as drawn and are not counted: {}",
            left_out.len(),
            left_out.join(", ")
        );
    }
    warn("candidates", args.candidates.as_deref(), candidates, problem.units);
    warn("postures of the workspace", args.workspace.as_deref(), &workspace, problem.units);
    if let Some(wanted) = args.random.filter(|wanted| candidates.fit.len() < *wanted as usize) {
        eprintln!(
            "warning: only {} of {wanted} random candidates were found: the workspace is a small part of the ranges",
            candidates.fit.len()
        );
    }
    Ok(Ending::Done)
}

/// The machine to plan for: the drawing, where the postures measured so far say that it stands if these count, or that of a
/// result in its place.
fn machine(args: &Args, problem: &ProblemFile) -> Result<Mechanism, CliError> {
    let drawn = problem.mechanism.clone();
    let Some(path) = &args.at else {
        return if args.add_to_measured { Ok(registered(problem)?.machine) } else { Ok(drawn) };
    };
    let result = read_model(path)?;
    if result.constants.is_none() {
        return Err(CliError::Usage(format!(
            "--at {}: this is a problem file; give the result of an identification",
            result.file
        )));
    }
    let instrument = result.constants_of(&drawn.instrument)?;
    let refused = |why| CliError::Usage(format!("--at {}: {why} ({})", result.file, problem.file));
    let found = Mechanism { instrument, ..result.mechanism.clone() };
    let placed = with_links_of(drawn, &found).map_err(refused)?;
    require_size_of(&problem.mechanism, &placed).map_err(refused)?;
    Ok(placed)
}

/// The data whose kind of measurement is planned for.
fn planned_set(problem: &ProblemFile) -> Result<&DataSet, CliError> {
    let refused = |why: &str| Err(CliError::Usage(format!("{}: {why}", problem.file)));
    let [set] = problem.data.parts() else {
        return refused("data.sets: a plan is made for one kind of measurement; leave one set in the file");
    };
    if set.noise.is_none() {
        return refused("data.noise is not stated: a plan needs to know it");
    }
    let free = problem.mechanism.instrument.iter().find(|constant| constant.prior == Prior::Free);
    if let Some(constant) = free {
        return refused(&format!(
            "data.instrument: {} is free: a plan needs to know about where it is; state a value and a tolerance",
            constant.name()
        ));
    }
    if set.blanks.is_empty() {
        return refused("data: nothing says what is measured; state data.kind and what it refers to");
    }
    Ok(set)
}

/// The chosen postures as CSV: readings, those of the second posture where two are compared, and the names of what is
/// measured.
fn written(
    mechanism: &Mechanism,
    problem: &ProblemFile,
    set: &DataSet,
    instrument: &Instrument,
    candidates: &Candidates,
    plan: &Plan,
) -> io::Result<Vec<u8>> {
    let shown = |i: usize| readings(mechanism, problem.units, &candidates.fit[i].actuators);
    let mut names = mechanism.actuator_names();
    let two = set.kind == Kind::Separation;
    if two {
        names.extend(mechanism.actuator_names().iter().map(|name| format!("second.{name}")));
    }
    let referred = |i: usize| {
        let SampleDrawing { target, point, plane, gauge, .. } = &set.blanks[instrument.blank(i)].drawing;
        [target, point, plane, gauge].map(|name| name.clone().unwrap_or_default())
    };
    let stated: Vec<usize> =
        (0..NAMES.len()).filter(|&k| plan.chosen.iter().any(|&i| !referred(i)[k].is_empty())).collect();
    let row = |(&i, &reversed): (&usize, &bool)| {
        let mut values = shown(i);
        if two {
            let second = shown(Instrument::second(i, candidates.fit.len()));
            values = if reversed { [second, values].concat() } else { [values, second].concat() };
        }
        (values, stated.iter().map(|&k| referred(i)[k].clone()).collect())
    };
    let rows: Vec<(Vec<f64>, Vec<String>)> = plan.chosen.iter().zip(&plan.reversed).map(row).collect();
    let named: Vec<&str> = stated.iter().map(|&k| NAMES[k]).collect();
    planned_text(&names, &named, &rows)
}

fn candidates(args: &Args, model: &Model) -> Result<Candidates, CliError> {
    let mechanism = &model.mechanism;
    match (&args.candidates, args.grid) {
        (Some(path), _) => from_file(path, model, args.regularity),
        (None, Some(steps)) => Candidates::grid(mechanism, steps as usize, args.regularity)
            .map_err(|why| CliError::Design { file: model.file.clone(), why }),
        (None, None) => {
            let count = args.random.unwrap_or(RANDOM) as usize;
            Ok(Candidates::random(mechanism, count, args.seed, args.regularity))
        }
    }
}

fn workspace(args: &Args, model: &Model) -> Result<Candidates, CliError> {
    match &args.workspace {
        Some(path) => from_file(path, model, args.regularity),
        // The complement of the seed: other postures than the candidates.
        None => Ok(Candidates::random(&model.mechanism, WORKSPACE, !args.seed, args.regularity)),
    }
}

fn from_file(path: &Path, model: &Model, least: f64) -> Result<Candidates, CliError> {
    let rows = read_actuators(path, model)?;
    if rows.len() > MOST {
        let why = DesignError::TooMany { found: rows.len() };
        return Err(CliError::Design { file: path.display().to_string(), why });
    }
    let rows = rows.into_iter().map(|row| (row.name, row.variables)).collect();
    Ok(Candidates::admit(&model.mechanism, rows, least))
}

/// Names what a file offered in vain. Random postures and grids are expected to leave the workspace.
fn warn(what: &str, file: Option<&Path>, found: &Candidates, units: Units) {
    if let (Some(file), Some((name, why))) = (file, found.unfit.first()) {
        eprintln!(
            "warning: {}: {} of {} {what} are left out; {name}: {}",
            file.display(),
            found.unfit.len(),
            found.unfit.len() + found.fit.len(),
            unfit(why, units)
        );
    }
}

fn summary(
    args: &Args,
    problem: &ProblemFile,
    criterion: Criterion,
    (workspace, added): (usize, Option<usize>),
    ReachedPlan { candidates, plan, reached, .. }: &ReachedPlan,
) -> String {
    let candidates = candidates.fit.len();
    let (value, bound) = (digits(plan.value), digits(plan.bound));
    let judged = match criterion {
        Criterion::D => {
            format!("log det(I + J'J) = {value}; no {} of them have more than {bound}", args.poses)
        }
        Criterion::A => {
            format!("sum of the variances {value}; no {} of them have less than {bound}", args.poses)
        }
        Criterion::E => format!("largest variance {value}; no {} of them have less than {bound}", args.poses),
        Criterion::G => {
            format!("variance at the worst posture {value}; no {} of them have less than {bound}", args.poses)
        }
    };
    let measured = problem.data.samples.len();
    let added = match added {
        None => String::new(),
        Some(count) if count == measured => format!(", added to the {measured} measured ones"),
        Some(count) => format!(", added to {count} of the {measured} measured ones"),
    };
    // Rounded down: it is a bound.
    let percent = (plan.efficiency * 1000.0).floor() / 10.0;
    let mut text = format!(
        "{}: {} of {candidates} postures{added}; {} directions beat the tolerances\n{} criterion: {judged}\n\
         the plan is >= {percent:.1} % {}-efficient\n",
        problem.name,
        args.poses,
        plan.kept,
        criterion.name(),
        criterion.name(),
    );
    text.push_str(
        &reached.map_or_else(|| "\n".to_owned(), |reached| format!("{}\n\n", share_reached(&reached))),
    );
    let (length, angle) = (problem.units.length_symbol(), problem.units.angle_symbol());
    text.push_str(&format!(
        "standard error of predicted poses, {workspace} postures\n{:12} {:>12} {:>12} {:>12} {:>12}\n",
        "",
        format!("rms/{length}"),
        format!("max/{length}"),
        format!("rms/{angle}"),
        format!("max/{angle}"),
    ));
    let mut line = |name: &str, expected: &Option<Expected>| {
        let Some(expected) = expected else { return };
        let metres = |v: f64| digits(problem.units.from_metres(v));
        let radians = |v: f64| digits(problem.units.from_radians(v));
        text.push_str(&format!(
            "{name:12} {:>12} {:>12} {:>12} {:>12}\n",
            metres(expected.position.rms),
            metres(expected.position.max),
            radians(expected.rotation.rms),
            radians(expected.rotation.max),
        ));
    };
    line("without it", &plan.accuracy.0);
    line("with it", &plan.accuracy.1);
    text
}
