//! `gough import`: problems from other formats.

use super::dispatch::Ending;
use super::error::CliError;
use super::import_csv;
use super::wording::counted;
use crate::files::tolerance::{Spread, ToleranceDrawing};
use crate::files::{
    AngleUnit, DataPlaces, LengthUnit, Output, ProblemDrawing, Units, json, problem::parse_problem, read_text,
};
use crate::formats::dh::Convention;
use crate::formats::{Imported, dh, mjcf, urdf};
use crate::model::mobility;
use clap::{Subcommand, ValueEnum};
use std::path::{Path, PathBuf};

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    format: Format,
}

#[derive(Debug, Subcommand)]
enum Format {
    /// A serial chain of a URDF: revolute, continuous, prismatic and fixed joints
    Urdf(Urdf),
    /// A Denavit-Hartenberg table: CSV with columns theta, d, a, alpha, and joint, type (R, P or F), min, max
    Dh(Dh),
    /// A MuJoCo model whose loops, closed by connect or weld, make limbs between base and platform
    Mjcf(Mjcf),
    /// A table of measurements with column names of its own, put into a problem
    Csv(import_csv::Args),
}

/// What every machine needs.
#[derive(Debug, clap::Args)]
struct Machine {
    /// Standard deviation of every link's rotation, in angle units of the problem
    #[arg(long, value_name = "ANGLE", requires = "tolerance_length")]
    tolerance_angle: Option<f64>,
    /// Standard deviation of every link's translation, in length units of the problem
    #[arg(long, value_name = "LENGTH", requires = "tolerance_angle")]
    tolerance_length: Option<f64>,
    /// Where to write the problem (standard output if left out)
    #[arg(short, long, value_name = "PROBLEM")]
    output: Option<PathBuf>,
}

#[derive(Debug, clap::Args)]
struct Urdf {
    /// URDF file (expand xacro first)
    file: PathBuf,
    /// Link whose frame is {S}
    #[arg(long, value_name = "LINK")]
    base: String,
    /// Link whose frame is {T}
    #[arg(long, value_name = "LINK")]
    tool: String,
    #[command(flatten)]
    machine: Machine,
}

#[derive(Debug, clap::Args)]
struct Dh {
    /// CSV file with a header
    file: PathBuf,
    /// Order of the screws of a row
    #[arg(long)]
    convention: ConventionName,
    /// Unit of length of the table and of the problem
    #[arg(long, default_value = "m")]
    length: LengthName,
    /// Unit of angle of the table and of the problem
    #[arg(long, default_value = "rad")]
    angle: AngleName,
    #[command(flatten)]
    machine: Machine,
}

#[derive(Debug, clap::Args)]
struct Mjcf {
    /// MJCF file, self-contained
    file: PathBuf,
    /// Body or site of the platform whose frame is {T}
    #[arg(long, value_name = "NAME")]
    tool: String,
    /// Body whose frame is {S}; the world if left out
    #[arg(long, value_name = "BODY")]
    base: Option<String>,
    /// Driven joints, instead of those that the model's actuators drive
    #[arg(long, value_name = "JOINT,...", value_delimiter = ',')]
    actuated: Option<Vec<String>>,
    #[command(flatten)]
    machine: Machine,
}

/// Convention of a table, on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ConventionName {
    /// Rz(theta) Tz(d) Tx(a) Rx(alpha)
    Standard,
    /// Rx(alpha) Tx(a) Rz(theta) Tz(d), after Craig
    Modified,
}

impl From<ConventionName> for Convention {
    fn from(name: ConventionName) -> Self {
        match name {
            ConventionName::Standard => Convention::Standard,
            ConventionName::Modified => Convention::Modified,
        }
    }
}

/// Unit of length, on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LengthName {
    /// metres
    M,
    /// millimetres
    Mm,
}

/// Unit of angle, on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum AngleName {
    /// radians
    Rad,
    /// degrees
    Deg,
}

/// Units named on the command line.
pub(super) fn units(length: LengthName, angle: AngleName) -> Units {
    Units {
        length: match length {
            LengthName::M => LengthUnit::Metre,
            LengthName::Mm => LengthUnit::Millimetre,
        },
        angle: match angle {
            AngleName::Rad => AngleUnit::Radian,
            AngleName::Deg => AngleUnit::Degree,
        },
    }
}

/// Reads the foreign file and writes a problem.
pub fn run(args: &Args) -> Result<Ending, CliError> {
    let (file, machine): (&Path, &Machine) = match &args.format {
        Format::Csv(args) => return import_csv::run(args),
        Format::Urdf(args) => (&args.file, &args.machine),
        Format::Dh(args) => (&args.file, &args.machine),
        Format::Mjcf(args) => (&args.file, &args.machine),
    };
    let output = Output::named(machine.output.as_deref());
    output.check()?;
    let tolerance = machine.tolerance()?;
    let name = file.display().to_string();
    let text = read_text(file)?;
    let imported = match &args.format {
        Format::Urdf(args) => urdf::read(&name, &text, &args.base, &args.tool)?,
        Format::Dh(args) => dh::read(&name, &text, args.convention.into(), units(args.length, args.angle))?,
        Format::Mjcf(args) => {
            let (base, actuated) = (args.base.as_deref(), args.actuated.as_deref());
            mjcf::read(&name, &text, &mjcf::Request { base, tool: &args.tool, actuated })?
        }
        Format::Csv(args) => return import_csv::run(args),
    };
    write(imported, file, tolerance, &output)
}

impl Machine {
    fn tolerance(&self) -> Result<Option<ToleranceDrawing>, CliError> {
        let (Some(angle), Some(length)) = (self.tolerance_angle, self.tolerance_length) else {
            return Ok(None);
        };
        for (name, value) in [("--tolerance-angle", angle), ("--tolerance-length", length)] {
            if !value.is_finite() || value < 0.0 {
                return Err(CliError::Usage(format!("{name} must be a number that is not negative")));
            }
        }
        Ok(Some(ToleranceDrawing { angle: Spread::Sigma(angle), length: Spread::Sigma(length) }))
    }
}

fn write(
    imported: Imported,
    source: &Path,
    tolerance: Option<ToleranceDrawing>,
    output: &Output,
) -> Result<Ending, CliError> {
    let stem = source.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let notes = imported.notes.clone();
    let drawing = imported.problem(stem, tolerance);
    let text = problem_text(&drawing)?;
    // What is written is what a reader of it will find: the drawing must be a machine.
    let problem = parse_problem(source, &text, &DataPlaces::from_environment(None))?;
    mobility::check(&problem.mechanism, &problem.mechanism.nominal())
        .map_err(|why| CliError::Mobility { file: source.display().to_string(), why })?;
    output.write(&text)?;
    for note in notes {
        eprintln!("note: {note}");
    }
    eprintln!("{}", summary(&drawing, &problem.mechanism.actuator_names()));
    if tolerance.is_none() {
        eprintln!(
            "to identify, add \"tolerance\": {{\"angle\": .., \"length\": ..}} to the mechanism (or import with \
             --tolerance-angle and --tolerance-length), and \"data\""
        );
    } else {
        eprintln!("to identify, add \"data\": measured poses and their noise (gough import csv)");
    }
    Ok(Ending::Done)
}

/// Text of a problem file.
pub(super) fn problem_text(drawing: &ProblemDrawing) -> Result<Vec<u8>, CliError> {
    json::text(drawing).map_err(|why| CliError::Usage(format!("the problem cannot be written: {why}")))
}

fn summary(drawing: &ProblemDrawing, actuators: &[String]) -> String {
    let limbs = drawing.mechanism.limbs.len();
    let name = drawing.name.as_deref().unwrap_or_default();
    let (limbs, driven) = (counted(limbs, "limb"), counted(actuators.len(), "actuator"));
    format!("{name}: {limbs}, {driven}: {}", actuators.join(", "))
}
