//! `gough analyze`: what poses can reveal.

use super::dispatch::Ending;
use super::error::CliError;
use super::progress::with_spinner;
use crate::calibration::{Coordinates, Sample};
use crate::design::Observability;
use crate::files::{DataPlaces, Kind, Output, ProblemFile, json, read_problem};
use crate::identify::Visibility;
use crate::identify::counts::visibility;
use crate::model::mobility;
use crate::problem::Form;
use crate::simulate::{draw_postures, read};
use serde::Serialize;
use std::path::PathBuf;

/// Postures drawn where a problem holds none.
const PLANNED: usize = 60;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Problem file; without samples, random postures in the actuators' ranges stand in for them
    problem: PathBuf,
    /// Print counts and singular values as JSON
    #[arg(long)]
    json: bool,
    /// Further folder in which data files are looked for
    #[arg(long, value_name = "DIR")]
    data_dir: Option<PathBuf>,
}

#[derive(Serialize)]
struct Analysis<'a> {
    counts: crate::files::summary::Counts,
    singular_values: &'a [f64],
    observability: Option<Indices>,
}

/// Observability indices in the analysis, over the directions that beat the tolerances.
#[derive(Serialize)]
struct Indices {
    directions: usize,
    poses: usize,
    o1: f64,
    o2: f64,
    o3: f64,
    o4: f64,
    o5: f64,
}

impl From<Observability> for Indices {
    fn from(of: Observability) -> Self {
        let Observability { directions, poses, o1, o2, o3, o4, o5 } = of;
        Self { directions, poses, o1, o2, o3, o4, o5 }
    }
}

/// Prints the three counts, at nominal.
pub fn run(args: &Args) -> Result<Ending, CliError> {
    let problem = read_problem(&args.problem, &DataPlaces::from_environment(args.data_dir.clone()))?;
    problem.require_tolerances()?;
    mobility::check(&problem.mechanism, &problem.mechanism.nominal())
        .map_err(|why| CliError::Mobility { file: problem.file.clone(), why })?;
    let planned = problem.data.is_empty();
    let samples = if planned { planned_samples(&problem)? } else { problem.data.samples.clone() };
    let zero = vec![0.0; problem.mechanism.component_count()];
    let seen = with_spinner(format!("analysing {}", problem.name), || {
        visibility(&problem.mechanism, &samples, &zero)
    })
    .map_err(|why| CliError::Evaluate { file: problem.file.clone(), why })?;
    let indices = Observability::of(&seen.singular_values, samples.len());
    let text = if args.json {
        let counts = seen.counts.into();
        let observability = indices.map(Indices::from);
        json::text(&Analysis { counts, singular_values: &seen.singular_values, observability })
            .map_err(|why| CliError::Usage(format!("the analysis cannot be written: {why}")))?
    } else {
        let mut text = words(&problem, &samples, planned, &seen);
        text.push_str(&indices.map(observability).unwrap_or_default());
        text.into_bytes()
    };
    Output::Stdout.write(&text)?;
    Ok(Ending::Done)
}

/// Random postures at which the instrument is taken to measure with the stated noise.
fn planned_samples(problem: &ProblemFile) -> Result<Vec<Sample>, CliError> {
    let mechanism = &problem.mechanism;
    let sets = problem.data.parts();
    if sets.iter().any(|set| set.noise.is_none()) {
        return Err(CliError::Usage(format!(
            "{}: neither samples nor data.noise: state the noise to plan with",
            problem.file
        )));
    }
    let simulate = |why| CliError::Simulate { file: problem.file.clone(), why };
    let nominal = mechanism.nominal();
    let mut pool = draw_postures(mechanism, &[&nominal], PLANNED, 0).map_err(simulate)?.into_iter().cycle();
    let mut samples = Vec::with_capacity(PLANNED * sets.len());
    for set in sets {
        for blank in set.blanks.iter().cycle().take(PLANNED) {
            let name = format!("planned posture {}", samples.len() + 1);
            let actuators = pool.next().unwrap_or_default();
            let second =
                if set.kind == Kind::Separation { pool.next().unwrap_or_default() } else { Vec::new() };
            let measurement = read(mechanism, &nominal, &*blank.measurement, &actuators, &second)
                .map_err(|why| CliError::Posture { file: problem.file.clone(), sample: name.clone(), why })?;
            samples.push(Sample { name, actuators, measurement });
        }
    }
    Ok(samples)
}

/// The observability indices in words.
fn observability(of: Observability) -> String {
    format!(
        "\nobservability over the {} values above 1 ({} poses): O1 {:.4}, O2 {:.3e}, O3 {:.4}, O4 {:.3e}, O5 {:.4}\n",
        of.directions, of.poses, of.o1, of.o2, of.o3, of.o4, of.o5
    )
}

fn words(problem: &ProblemFile, samples: &[Sample], planned: bool, seen: &Visibility) -> String {
    let mechanism = &problem.mechanism;
    let (r, p) = mechanism.joint_counts();
    let coordinates = Coordinates::new(mechanism, Form::Minimal);
    let counts = seen.counts;
    let rows: usize = samples.iter().map(|sample| sample.measurement.rows()).sum();
    let what = if planned { "random postures (the problem has no samples)" } else { "measured postures" };
    let mut text = format!(
        "{}: {} limbs, {r} angular and {p} prismatic joints, {} actuated; {} {what}, {rows} readings\n\n",
        problem.name,
        mechanism.limbs.len(),
        mechanism.actuator_count(),
        samples.len(),
    );
    text.push_str(&format!(
        "{:>5}  structural: combinations of link deviations that no pose is blind to by the kind of joints\n",
        counts.structural
    ));
    for (limb, own) in mechanism.limbs.iter().zip(&coordinates.limbs) {
        let angular = limb.joints.iter().filter(|joint| joint.motion.is_angular()).count();
        let prismatic = limb.joints.len() - angular;
        let held = own.sigma.len() - own.free.len();
        let sensed = limb.joints.iter().filter(|joint| joint.sensed).count();
        let sum = format!("4*{angular} + 2*{prismatic} + 6 - {} passive", limb.passive_count());
        text.push_str(&match held {
            0 if sensed > 0 => {
                format!("         {}: {} = {sum} + {sensed} sensed\n", limb.name, own.slice.len())
            }
            0 => format!("         {}: {} = {sum}\n", limb.name, own.slice.len()),
            _ => format!("         {}: {} of {sum}, {held} components held\n", limb.name, own.slice.len()),
        });
    }
    if !mechanism.instrument.is_empty() {
        text.push_str(&format!("         instrument: {} unknown constants\n", mechanism.instrument.len()));
    }
    text.push_str(&format!(
        "{:>5}  first order: rank at the nominal geometry over these postures; {} combinations have no \
         first-order effect there\n         (axes that meet, or stand square or parallel), but appear once the \
         machine deviates\n",
        counts.first_order,
        counts.structural - counts.first_order,
    ));
    text.push_str(&format!(
        "{:>5}  practical: singular values above 1, where these readings know more than the tolerances\n\n",
        counts.practical
    ));
    for line in problem.data.kind_notes().into_iter().chain(problem.data.point_note()) {
        text.push_str(&format!("       {line}\n"));
    }
    text.push_str("whitened singular values (signal-to-noise ratio of one tolerance), at nominal:\n");
    for chunk in seen.singular_values.chunks(10) {
        let line: Vec<String> = chunk.iter().map(|s| format!("{s:9.3e}")).collect();
        text.push_str(&format!("  {}\n", line.join(" ")));
    }
    text
}
