//! `gough export`: a calibrated machine for other programs.

use super::dispatch::Ending;
use super::error::CliError;
use super::import::ConventionName;
use super::ranges::warn_unless_converged;
use crate::files::result::RESULT_FORMAT;
use crate::files::{Model, Output, ResultFile, deviations_text, json, problem::parse_model, read_text};
use crate::formats::{FormatError, Wrong, dh, urdf};
use clap::ValueEnum;
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Result file, or a problem file to export its drawing
    model: PathBuf,
    /// urdf and dh: a serial machine; csv: the deviations of a result, a row a link
    #[arg(long)]
    format: FormatName,
    /// URDF that the machine was imported from: everything but the chain's origins stays (urdf)
    #[arg(long, value_name = "URDF", requires_all = ["base", "tool"])]
    template: Option<PathBuf>,
    /// Link whose frame is {S} in the template (urdf)
    #[arg(long, value_name = "LINK")]
    base: Option<String>,
    /// Link whose frame is {T} in the template (urdf)
    #[arg(long, value_name = "LINK")]
    tool: Option<String>,
    /// Order of the screws of a row (dh)
    #[arg(long, default_value = "standard")]
    convention: ConventionName,
    /// Write axes within this angle of each other as parallel, in angle units of the model (dh)
    #[arg(long, value_name = "ANGLE", default_value_t = 0.0)]
    parallel: f64,
    /// Leave out the fixed rows at base and tool (dh)
    #[arg(long)]
    joint_rows_only: bool,
    /// Where to write it (standard output if left out)
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum FormatName {
    Urdf,
    Dh,
    Csv,
}

/// Writes the machine in the format asked for.
pub fn run(args: &Args) -> Result<Ending, CliError> {
    let output = Output::named(args.output.as_deref());
    output.check()?;
    if args.template.is_some() && args.format != FormatName::Urdf {
        return Err(CliError::Usage("--template goes with --format urdf".into()));
    }
    let file = args.model.display().to_string();
    let bytes = json::read(&args.model)?;
    let model = parse_model(&args.model, &bytes)?;
    warn_unless_converged(&model);
    let text = match args.format {
        FormatName::Urdf => urdf_text(args, &model)?,
        FormatName::Dh => dh_text(args, &model, &file)?,
        FormatName::Csv => {
            let result: ResultFile = json::parse(&file, &bytes).map_err(|_| {
                CliError::Usage(format!(
                    "{file}: a problem has no deviations; export a result ({RESULT_FORMAT}) as csv"
                ))
            })?;
            deviations_text(&result)
        }
    };
    output.write(text.as_bytes())?;
    Ok(Ending::Done)
}

fn urdf_text(args: &Args, model: &Model) -> Result<String, CliError> {
    let (Some(template), Some(base), Some(tool)) = (&args.template, &args.base, &args.tool) else {
        let wrong = |wrong| FormatError { at: model.file.clone(), wrong };
        return Ok(urdf::write(&model.name, &model.mechanism).map_err(wrong)?);
    };
    let text = read_text(template)?;
    Ok(urdf::rewrite(&template.display().to_string(), &text, base, tool, &model.mechanism)?)
}

fn dh_text(args: &Args, model: &Model, file: &str) -> Result<String, CliError> {
    if !(0.0..=0.2).contains(&model.units.to_radians(args.parallel)) {
        return Err(CliError::Usage("--parallel must be an angle from 0 to 0.2 rad".into()));
    }
    let parallel = model.units.to_radians(args.parallel);
    let wrong = |wrong: Wrong| FormatError { at: file.to_owned(), wrong };
    let table =
        dh::table(&model.mechanism, args.convention.into(), parallel, args.joint_rows_only).map_err(wrong)?;
    let (length, angle) = (model.units.length_symbol(), model.units.angle_symbol());
    eprintln!(
        "largest error of the table over the joints' ranges: {:.2e} {length}, {:.2e} {angle}",
        model.units.from_metres(table.position),
        model.units.from_radians(table.rotation),
    );
    for (axes, apart) in &table.taken_for_parallel {
        eprintln!(
            "note: {axes} are written as parallel; they are {:.2e} {angle} apart",
            model.units.from_radians(*apart)
        );
    }
    for (axes, apart, d) in &table.nearly_parallel {
        eprintln!(
            "warning: {axes} are {:.2e} {angle} from parallel: their common normal lies {:.3e} {length} along the axis, \
             and the table has that as an offset d, which small errors of the angle change by as much; write them as \
             parallel with --parallel {:.2e} (it says what that costs), or keep the machine as a result or as URDF",
            model.units.from_radians(*apart),
            model.units.from_metres(*d),
            model.units.from_radians(*apart) * 1.01,
        );
    }
    Ok(table.text(model.units))
}
