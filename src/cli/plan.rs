//! `gough plan`: which postures to measure.

use super::details::digits;
use super::dispatch::Ending;
use super::error::CliError;
use super::progress::with_spinner;
use crate::design::candidates::MOST;
use crate::design::{
    Candidates, Criterion, DesignError, Expected, Information, Instrument, Plan, Settings, plan,
};
use crate::files::{
    DataPlaces, Kind, Model, Output, ProblemFile, actuators_text, read_actuators, read_model, read_problem,
    readings,
};
use crate::model::mobility;
use std::path::{Path, PathBuf};

/// Random candidates where none are stated.
const RANDOM: u32 = 2000;
/// Postures of a workspace that is not stated.
const WORKSPACE: usize = 200;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Problem file: machine, tolerances and noise
    problem: PathBuf,
    /// Number of postures to choose
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    poses: u32,
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
    let mechanism = &problem.mechanism;
    mobility::check(mechanism, &mechanism.nominal())
        .map_err(|why| CliError::Mobility { file: problem.file.clone(), why })?;
    let covariance = problem.data.noise.ok_or_else(|| {
        CliError::Usage(format!("{}: data.noise is not stated: a plan needs to know it", problem.file))
    })?;
    if args.add_to_measured {
        problem.require_samples()?;
    }
    let known = matches!(problem.data.kind, Kind::Pose | Kind::Position);
    if !known || !problem.data.sets.is_empty() || !mechanism.instrument.is_empty() {
        return Err(CliError::Usage(format!(
            "{}: plans are made for poses, and for positions of the tool point; other measurements and unknown \
             constants of the instrument cannot be planned for",
            problem.file
        )));
    }
    let rotation = problem.data.kind == Kind::Pose;
    let instrument = Instrument { seen: [rotation, rotation, rotation, true, true, true], covariance };
    let design = |why| CliError::Design { file: problem.file.clone(), why };
    let poses = args.poses as usize;
    let model = read_model(&args.problem)?;
    let message = format!("choosing {poses} postures for {}", problem.name);
    let (candidates, workspace, left_out, plan) = with_spinner(message, || {
        let candidates = candidates(args, &model)?;
        candidates.require(poses).map_err(design)?;
        let workspace = workspace(args, &model)?;
        workspace.require(1).map_err(design)?;
        let measured: &[_] = if args.add_to_measured { &problem.data.samples } else { &[] };
        let info = Information::new(mechanism, &instrument, &candidates.fit, measured, &workspace.fit, poses)
            .map_err(design)?;
        let settings = Settings { poses, criterion, starts: args.starts.into(), seed: args.seed };
        let plan = plan(mechanism, &candidates.fit, &info, &settings).map_err(design)?;
        Ok::<_, CliError>((candidates, workspace, info.left_out, plan))
    })?;
    let rows: Vec<Vec<f64>> = plan
        .chosen
        .iter()
        .map(|&i| readings(mechanism, problem.units, &candidates.fit[i].actuators))
        .collect();
    let text = actuators_text(&mechanism.actuator_names(), &rows)
        .map_err(|why| CliError::Usage(format!("the plan cannot be written: {why}")))?;
    output.write(&text)?;
    let told = summary(args, &problem, criterion, (candidates.fit.len(), workspace.fit.len()), &plan);
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
    warn("candidates", args.candidates.as_deref(), &candidates);
    warn("postures of the workspace", args.workspace.as_deref(), &workspace);
    if let Some(wanted) = args.random.filter(|wanted| candidates.fit.len() < *wanted as usize) {
        eprintln!(
            "warning: only {} of {wanted} random candidates were found: the workspace is a small part of the ranges",
            candidates.fit.len()
        );
    }
    Ok(Ending::Done)
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
fn warn(what: &str, file: Option<&Path>, found: &Candidates) {
    if let (Some(file), Some((name, why))) = (file, found.unfit.first()) {
        eprintln!(
            "warning: {}: {} of {} {what} are left out; {name}: {why}",
            file.display(),
            found.unfit.len(),
            found.unfit.len() + found.fit.len()
        );
    }
}

fn summary(
    args: &Args,
    problem: &ProblemFile,
    criterion: Criterion,
    (candidates, workspace): (usize, usize),
    plan: &Plan,
) -> String {
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
    let added = match args.add_to_measured {
        true => format!(", added to the {} measured ones", problem.data.samples.len()),
        false => String::new(),
    };
    // Rounded down: it is a bound.
    let percent = (plan.efficiency * 1000.0).floor() / 10.0;
    let mut text = format!(
        "{}: {} of {candidates} postures{added}; {} directions beat the tolerances\n{} criterion: {judged}\n\
         the plan is >= {percent:.1} % {}-efficient\n\n",
        problem.name,
        args.poses,
        plan.kept,
        criterion.name(),
        criterion.name(),
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
