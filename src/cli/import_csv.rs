//! `gough import csv`: measurements of a table with names and units of its own, put into a problem.

use super::dispatch::Ending;
use super::error::CliError;
use super::import::{AngleName, LengthName, problem_text, units};
use super::wording::counted;
use crate::files::columns::ColumnsDrawing;
use crate::files::table::{self, OtherColumns, PoseColumns, TableRequest, TableRow};
use crate::files::{
    DataDrawing, DataPlaces, Kind, Output, PoseDrawing, ProblemFile, SampleDrawing, Units, read_problem,
};
use crate::model::Motion;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Our name of the column of weights.
const WEIGHT: &str = "weight";

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// CSV file with a header, one posture a row
    table: PathBuf,
    /// Problem file that the measurements belong to; its samples, if any, are replaced
    #[arg(long, value_name = "PROBLEM")]
    problem: PathBuf,
    /// What the columns are called: actuators as limb.joint or q1, q2.., then x, y, z and rx, ry, rz or qw, qx, qy, qz
    #[arg(long, value_name = "OURS=THEIRS,...", value_delimiter = ',')]
    map: Vec<String>,
    /// Only rows with this text in this column; may be repeated
    #[arg(long = "where", value_name = "COLUMN=TEXT")]
    filter: Vec<String>,
    /// Unit of length of the table, where it is not the problem's
    #[arg(long)]
    length: Option<LengthName>,
    /// Unit of angle of the table, where it is not the problem's
    #[arg(long)]
    angle: Option<AngleName>,
    /// The rows become the hold-out instead of the samples
    #[arg(long)]
    holdout: bool,
    /// Where to write the problem (standard output if left out)
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// Writes the problem with the rows of the table as its samples.
pub fn run(args: &Args) -> Result<Ending, CliError> {
    let output = Output::named(args.output.as_deref());
    output.check()?;
    let problem = read_problem(&args.problem, &DataPlaces::from_environment(None))?;
    let names = problem.mechanism.actuator_names();
    let file = args.table.display().to_string();
    let header = header(&args.table)?;
    let columns = Map::read(&args.map)?.columns(&names, &header, &file)?;
    let filter = pairs("--where", &args.filter)?;
    let position_only = problem.data.kind == Kind::Position || !columns_have_rotation(&columns, &header);
    let request = TableRequest {
        actuators: &names,
        columns: Some(&columns),
        filter: Some(&filter),
        poses: if position_only { PoseColumns::Position } else { PoseColumns::Complete },
        others: OtherColumns::default(),
    };
    let rows = table::parse(&file, &table::read(&args.table)?, &request)?;
    let theirs = stated_units(&problem, args);
    let convert = Conversion::between(theirs, problem.units);
    let motions: Vec<Motion> = problem
        .mechanism
        .limbs
        .iter()
        .flat_map(|limb| &limb.joints)
        .filter(|joint| joint.actuated)
        .map(|joint| joint.motion)
        .collect();
    let samples: Vec<SampleDrawing> = rows.into_iter().map(|row| convert.sample(&motions, row)).collect();
    let count = samples.len();
    let mut drawing = problem.drawing.clone();
    let stated = drawing.data.take().unwrap_or_default();
    let kind = if position_only { Some(Kind::Position.name().to_owned()) } else { stated.kind.clone() };
    let origin = Some(format!("{file}, {}", counted(count, "row")));
    drawing.data = Some(if args.holdout {
        let holdout = DataDrawing { kind, origin, samples: Some(samples), ..DataDrawing::default() };
        DataDrawing { holdout: Some(Box::new(holdout)), ..stated }
    } else {
        DataDrawing {
            kind,
            origin,
            samples: Some(samples),
            file: None,
            columns: None,
            filter: None,
            ..stated
        }
    });
    output.write(&problem_text(&drawing)?)?;
    eprintln!("{} of {file}; `gough check` says whether they fit the machine", counted(count, "row"));
    Ok(Ending::Done)
}

fn header(path: &std::path::Path) -> Result<Vec<String>, CliError> {
    let record = table::header(&path.display().to_string(), &table::read(path)?)?;
    Ok(record.iter().map(|name| name.trim_start_matches('\u{feff}').to_owned()).collect())
}

fn stated_units(problem: &ProblemFile, args: &Args) -> Units {
    let named = units(args.length.unwrap_or(LengthName::M), args.angle.unwrap_or(AngleName::Rad));
    Units {
        length: if args.length.is_some() { named.length } else { problem.units.length },
        angle: if args.angle.is_some() { named.angle } else { problem.units.angle },
    }
}

/// Pairs `a=b` of an option.
fn pairs(option: &str, list: &[String]) -> Result<BTreeMap<String, String>, CliError> {
    let mut pairs = BTreeMap::new();
    for text in list {
        let (left, right) = text
            .split_once('=')
            .filter(|(left, right)| !left.trim().is_empty() && !right.trim().is_empty())
            .ok_or_else(|| CliError::Usage(format!("{option} {text}: write it as NAME=NAME")))?;
        if pairs.insert(left.trim().to_owned(), right.trim().to_owned()).is_some() {
            return Err(CliError::Usage(format!("{option}: {} is given twice", left.trim())));
        }
    }
    Ok(pairs)
}

/// Our names of columns and theirs.
struct Map(BTreeMap<String, String>);

const POSITION: [&str; 3] = ["x", "y", "z"];
const ROTATION: [&str; 3] = ["rx", "ry", "rz"];
const QUATERNION: [&str; 4] = ["qw", "qx", "qy", "qz"];

impl Map {
    fn read(list: &[String]) -> Result<Self, CliError> {
        pairs("--map", list).map(Self)
    }

    /// Their name of ours: ours where the map does not say.
    fn theirs(&self, ours: &str) -> String {
        self.0.get(ours).cloned().unwrap_or_else(|| ours.to_owned())
    }

    fn columns(
        &self,
        actuators: &[String],
        header: &[String],
        file: &str,
    ) -> Result<ColumnsDrawing, CliError> {
        let numbers: Vec<String> = (1..=actuators.len()).map(|i| format!("q{i}")).collect();
        let fixed = POSITION.iter().chain(&ROTATION).chain(&QUATERNION).chain(&[WEIGHT]);
        let known: Vec<&str> =
            fixed.copied().chain(actuators.iter().chain(&numbers).map(String::as_str)).collect();
        if let Some(unknown) = self.0.keys().find(|name| !known.contains(&name.as_str())) {
            let known = known.join(", ");
            return Err(CliError::Usage(format!("--map: `{unknown}` is none of our columns: {known}")));
        }
        let has = |name: &str| header.iter().any(|found| found == name);
        if let Some((ours, theirs)) = self.0.iter().find(|(_, theirs)| !has(theirs)) {
            return Err(CliError::Usage(format!(
                "--map {ours}={theirs}: `{theirs}` is not a column of {file}, which are {}",
                header.join(", ")
            )));
        }
        let column = |ours: &[&str]| {
            let named = ours.iter().find(|ours| self.0.contains_key(**ours));
            let present = ours.iter().find(|ours| has(ours));
            named.or(present).map(|ours| self.theirs(ours)).filter(|theirs| has(theirs)).ok_or_else(|| {
                let first = ours.first().copied().unwrap_or_default();
                CliError::Usage(format!(
                    "{file}: no column for `{first}`: map it with --map {first}=NAME; the columns are {}",
                    header.join(", ")
                ))
            })
        };
        let names = actuators.iter().zip(&numbers);
        let actuators = names.map(|(name, number)| column(&[name, number])).collect::<Result<Vec<_>, _>>()?;
        for name in POSITION {
            column(&[name])?;
        }
        let wants = |group: &[&str]| group.iter().any(|name| self.0.contains_key(*name) || has(name));
        let mut columns = ColumnsDrawing {
            actuators: Some(actuators),
            position: Some(POSITION.map(|name| self.theirs(name))),
            ..ColumnsDrawing::default()
        };
        if wants(&ROTATION) {
            for name in ROTATION {
                column(&[name])?;
            }
            columns.rotation = Some(ROTATION.map(|name| self.theirs(name)));
        } else if wants(&QUATERNION) {
            for name in QUATERNION {
                column(&[name])?;
            }
            columns.quaternion = Some(QUATERNION.map(|name| self.theirs(name)));
        }
        if wants(&[WEIGHT]) {
            columns.weight = Some(column(&[WEIGHT])?);
        }
        Ok(columns)
    }
}

fn columns_have_rotation(columns: &ColumnsDrawing, header: &[String]) -> bool {
    let there = |name: &String| header.contains(name);
    columns.rotation.as_ref().is_some_and(|names| names.iter().all(there))
        || columns.quaternion.as_ref().is_some_and(|names| names.iter().all(there))
}

/// Factors from units of the table to those of the problem; 1 exactly where they are the same.
struct Conversion {
    length: f64,
    angle: f64,
}

impl Conversion {
    fn between(theirs: Units, ours: Units) -> Self {
        let same = |same: bool, factor: f64| if same { 1.0 } else { factor };
        Self {
            length: same(theirs.length == ours.length, ours.from_metres(theirs.to_metres(1.0))),
            angle: same(theirs.angle == ours.angle, ours.from_radians(theirs.to_radians(1.0))),
        }
    }

    fn sample(&self, motions: &[Motion], TableRow { readings, pose, weight, .. }: TableRow) -> SampleDrawing {
        let scaled = |values: [Option<f64>; 3], factor: f64| values.map(|v| v.map(|v| v * factor));
        let actuators = readings
            .into_iter()
            .zip(motions)
            .map(|(reading, motion)| reading * if motion.is_angular() { self.angle } else { self.length });
        SampleDrawing {
            actuators: actuators.collect(),
            pose: PoseDrawing {
                position: pose.position.map(|p| scaled(p, self.length)),
                rotation: pose.rotation.map(|w| scaled(w, self.angle)),
                quaternion: pose.quaternion,
            },
            weight,
            ..SampleDrawing::default()
        }
    }
}
