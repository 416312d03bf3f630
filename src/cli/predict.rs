//! `gough predict`: forward kinematics.

use super::dispatch::Ending;
use super::elsewhere::warn_of_modes;
use super::error::CliError;
use super::progress::with_spinner;
use super::ranges::{out_of_range, warn_unless_converged};
use super::wording::{counted, reason};
use crate::files::{
    Model, Output, PosesFormat, poses_text, read_actuators, read_model, uncertain_poses_text,
};
use crate::identify::{LinkRoot, pose_covariances};
use crate::model::mobility;
use crate::simulate::close;
use faer::Mat;
use rayon::prelude::*;
use std::path::PathBuf;

/// Postures that a message names.
const SHOWN: usize = 5;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Problem or result file: its machine predicts
    model: PathBuf,
    /// Actuator readings: CSV with a column each, or JSON with samples (a problem file: those of its data, all sets)
    #[arg(long, value_name = "FILE")]
    actuators: PathBuf,
    /// State the standard deviation of every component and the covariance (results only)
    #[arg(long)]
    uncertainty: bool,
    /// Leave out postures whose loops do not close instead of refusing all
    #[arg(long)]
    skip_unreachable: bool,
    /// Where to write the poses (.json or .csv; standard output if left out)
    #[arg(short, long, value_name = "POSES")]
    output: Option<PathBuf>,
}

/// Predicts the pose of every posture, on home's assembly branch.
pub fn run(args: &Args) -> Result<Ending, CliError> {
    let output = Output::named(args.output.as_deref());
    output.check()?;
    let model = read_model(&args.model)?;
    warn_unless_converged(&model);
    warn_of_modes(&model.file, model.elsewhere);
    let geometry = model.mechanism.nominal();
    mobility::check(&model.mechanism, &geometry)
        .map_err(|why| CliError::Mobility { file: model.file.clone(), why })?;
    let links = args.uncertainty.then(|| link_root(&model)).transpose()?;
    let rows = read_actuators(&args.actuators, &model)?;
    let closed: Vec<_> = with_spinner(format!("closing {} postures", rows.len()), || {
        rows.par_iter().map(|row| close(&model.mechanism, &geometry, &row.variables)).collect()
    });
    let (mut poses, mut postures) = (Vec::with_capacity(rows.len()), Vec::new());
    let mut unreachable = Vec::new();
    for (row, posture) in rows.iter().zip(closed) {
        match posture {
            Ok(posture) => {
                poses.push((row.readings.clone(), posture.tool()));
                if links.is_some() {
                    postures.push((row.variables.clone(), posture));
                }
            }
            Err(why) => unreachable.push(format!("{}: {}", row.name, reason(&why, model.units))),
        }
    }
    if !unreachable.is_empty() {
        let file = args.actuators.display();
        let which = unreachable.iter().take(SHOWN).map(String::as_str).collect::<Vec<_>>().join("; ");
        let more = if unreachable.len() > SHOWN { "; ..." } else { "" };
        let number = counted(unreachable.len(), "posture");
        let message = format!("{file}: {number} of {} cannot be reached: {which}{more}", rows.len());
        if poses.is_empty() || !args.skip_unreachable {
            return Err(CliError::Usage(format!("{message} (--skip-unreachable leaves such postures out)")));
        }
        eprintln!("warning: left out: {message}");
    }
    let outside = out_of_range(&model.mechanism, rows.iter().map(|row| row.variables.as_slice()));
    if !outside.is_empty() {
        eprintln!("warning: readings outside the stated range of {}", outside.join(", "));
    }
    let format = args.output.as_deref().map_or(PosesFormat::default(), PosesFormat::of);
    let names = model.mechanism.actuator_names();
    let text = match links {
        None => poses_text(format, &names, &poses, model.units),
        Some(links) => {
            let covariances = pose_covariances(&model.mechanism, &postures, &links)
                .map_err(|why| CliError::Evaluate { file: args.actuators.display().to_string(), why })?;
            let covariances: Vec<_> = covariances.iter().map(|c| c.total).collect();
            uncertain_poses_text(format, &names, &poses, &covariances, model.units)
        }
    };
    let text = text.map_err(|why| CliError::Usage(format!("poses cannot be written: {why}")))?;
    output.write(&text)?;
    Ok(Ending::Done)
}

/// What the result says of its machine's covariance.
fn link_root(model: &Model) -> Result<LinkRoot, CliError> {
    let stated = model.uncertainty.as_ref().ok_or_else(|| {
        CliError::Usage(format!(
            "{}: --uncertainty: it states none; give the result of `gough identify` with an identifier that linear \
             theory describes (minimal, map, argmin-*, limbwise)",
            model.file
        ))
    })?;
    let root =
        Mat::from_fn(model.mechanism.link_component_count(), stated.root.len(), |i, j| stated.root[j][i]);
    Ok(LinkRoot { root, prior_share: stated.prior_share.clone() })
}
