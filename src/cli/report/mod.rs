//! `gough report`: one page about one identification.

mod convergence;
mod deviations;
mod directions;
mod errors;
mod machine;
mod overview;
mod poses;
mod scale;
mod study;
mod weight;
mod workspace;

use super::dispatch::Ending;
use super::error::CliError;
use super::progress::with_spinner;
use crate::files::{DataPlaces, Model, Output, ResultFile, read_model, read_result};
use crate::render::{Page, Part, Section};
use std::path::PathBuf;
use study::Study;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Result file of `gough identify`
    result: PathBuf,
    /// The problem that it is a result of; the one that the result names if left out
    #[arg(long, value_name = "PROBLEM")]
    problem: Option<PathBuf>,
    /// Further folder in which data files are looked for
    #[arg(long, value_name = "DIR")]
    data_dir: Option<PathBuf>,
    /// Where to write the page (standard output if left out)
    #[arg(short, long, value_name = "PAGE.html")]
    output: Option<PathBuf>,
}

/// Writes the page. What the result alone does not hold is recomputed from the problem; without it, the sections that
/// need it say so.
pub fn run(args: &Args) -> Result<Ending, CliError> {
    let output = Output::named(args.output.as_deref());
    output.check()?;
    let result = read_result(&args.result)?;
    let model = read_model(&args.result)?;
    let places = DataPlaces::from_environment(args.data_dir.clone());
    let named = args.result.parent().unwrap_or(std::path::Path::new(""));
    let html = with_spinner(format!("reporting on {}", result.problem), || {
        let study = study::find((&result, &model), args.problem.as_deref(), named, &places)?;
        Ok::<String, CliError>(page(&result, &model, &study).html())
    })?;
    output.write(html.as_bytes())?;
    Ok(Ending::Done)
}

fn page(result: &ResultFile, model: &Model, study: &Result<Study, String>) -> Page {
    let with_problem = |title: &str, section: fn(&ResultFile, &Study) -> Section| match study {
        Ok(study) => section(result, study),
        Err(why) => Section::new(title).with(Part::Text(format!("Needs the problem and its data: {why}."))),
    };
    let sections = vec![
        overview::section(result, study),
        convergence::section(result),
        with_problem("Residuals", poses::section),
        directions::section(result, study),
        deviations::section(result, model),
        with_problem("Predicted poses", workspace::section),
        machine::section(study, model),
    ];
    let versions: Vec<String> =
        result.versions.iter().map(|(name, version)| format!("{name} {version}")).collect();
    Page {
        title: format!("{}: identification by {}", result.problem, result.solver),
        intro: overview::intro(result),
        sections,
        note: format!(
            "Made by gough {} from a result of {}. Lengths in {}, angles in {} unless stated.",
            env!("CARGO_PKG_VERSION"),
            versions.join(", "),
            result.units.length_symbol(),
            result.units.angle_symbol()
        ),
    }
}
