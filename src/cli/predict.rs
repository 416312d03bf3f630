//! `gough predict`: forward kinematics.

use super::dispatch::Ending;
use super::error::CliError;
use super::progress::with_spinner;
use crate::files::{Output, PosesFormat, poses_text, read_actuators, read_model};
use crate::model::mobility;
use crate::simulate::close;
use rayon::prelude::*;
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Problem or result file: its machine predicts
    model: PathBuf,
    /// Actuator readings: CSV with a column each, or JSON with samples
    #[arg(long, value_name = "FILE")]
    actuators: PathBuf,
    /// Where to write the poses (.json or .csv; standard output if left out)
    #[arg(short, long, value_name = "POSES")]
    output: Option<PathBuf>,
}

/// Predicts the pose of every posture, on home's assembly branch.
pub fn run(args: &Args) -> Result<Ending, CliError> {
    let output = Output::named(args.output.as_deref());
    output.check()?;
    let model = read_model(&args.model)?;
    let geometry = model.mechanism.nominal();
    mobility::check(&model.mechanism, &geometry)
        .map_err(|why| CliError::Mobility { file: model.file.clone(), why })?;
    let rows = read_actuators(&args.actuators, &model)?;
    let closed: Vec<_> = with_spinner(format!("closing {} postures", rows.len()), || {
        rows.par_iter().map(|row| close(&model.mechanism, &geometry, &row.variables)).collect()
    });
    let mut poses = Vec::with_capacity(rows.len());
    for (row, posture) in rows.iter().zip(closed) {
        let posture = posture.map_err(|why| CliError::Posture {
            file: args.actuators.display().to_string(),
            sample: row.name.clone(),
            why,
        })?;
        poses.push((row.readings.clone(), posture.tool()));
    }
    let format = args.output.as_deref().map_or(PosesFormat::default(), PosesFormat::of);
    let text = poses_text(format, &model.mechanism.actuator_names(), &poses, model.units)
        .map_err(|why| CliError::Usage(format!("poses cannot be written: {why}")))?;
    output.write(&text)?;
    Ok(Ending::Done)
}
