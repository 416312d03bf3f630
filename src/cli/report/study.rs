//! The problem that a result belongs to, and what follows from both.

use crate::calibration::{Calibration, Sample};
use crate::cli::error::CliError;
use crate::cli::identify::divided;
use crate::cli::wording::{counted, listed};
use crate::files::noise::PostureNoiseDrawing;
use crate::files::place::Place;
use crate::files::summary::{MountResult, PoseErrors};
use crate::files::{DataPlaces, Model, ProblemFile, ResultFile, read_problem};
use crate::identify::counts::visibility;
use crate::identify::posture_noise::sharing;
use crate::identify::residuals::{Residual, residuals};
use crate::identify::run::placed;
use crate::identify::{Covariance, NoiseEstimate, Visibility, score};
use crate::lie::Se3;
use crate::model::mechanism::pose_difference;
use crate::model::{Constant, Geometry, Mechanism, Quantity, mobility};
use crate::problem::Form;
use crate::simulate::close;
use crate::solve::Estimate;
use crate::statistics::median;
use faer::Mat;
use std::path::{Path, PathBuf};

/// Relative difference at which recomputed errors are those of the result.
const SAME: f64 = 1e-6;
/// Samples at which the machine of the problem is compared with that of the result.
const COMPARED: usize = 10;
/// Difference of poses, rad or machine sizes, at which they are two machines.
const OTHER: f64 = 1e-6;

/// A result seen with its problem.
pub(super) struct Study {
    /// The machine about which was linearised: as drawn, with free ends registered.
    pub(super) start: Mechanism,
    /// The same under the tolerances that the data support: the covariance is in these.
    pub(super) supported: Mechanism,
    /// The drawing where the result says that it was placed, with its tool as mounted.
    pub(super) placed: Mechanism,
    /// The machine as identified.
    pub(super) geometry: Geometry,
    /// Its deviations from `start`, rad and m.
    pub(super) at: Vec<f64>,
    /// Postures that were used.
    pub(super) training: Vec<Sample>,
    /// Their residuals before and after.
    pub(super) residuals: Vec<(Option<Residual>, Option<Residual>)>,
    /// What they can see at the solution.
    pub(super) seen: Option<Visibility>,
    /// Square root of the covariance of the minimal coordinates.
    pub(super) root: Option<Mat<f64>>,
    /// Whether each limb was estimated by itself.
    pub(super) decoupled: bool,
    /// Whether the errors that the result states came out again.
    pub(super) reproduced: bool,
}

impl Study {
    /// Why there is no covariance, in a sentence.
    pub(super) fn no_covariance(&self, result: &ResultFile) -> &'static str {
        if !result.converged {
            return "No covariance: the identifier did not converge.";
        }
        "No covariance: linear theory does not describe what this identifier estimates, or the result does not say how it \
         leans on the tolerances."
    }
}

/// The problem named by `asked` or else by the result, and what follows. What was asked for must be there and fit;
/// what the result names may be missing, and then the reason is returned.
pub(super) fn find(
    (result, model): (&ResultFile, &Model),
    asked: Option<&Path>,
    folder: &Path,
    places: &DataPlaces,
) -> Result<Result<Study, String>, CliError> {
    if let Some(path) = asked {
        let problem = read_problem(path, places)?;
        let file = problem.file.clone();
        let (result_of, name) = (result.problem.clone(), problem.name.clone());
        return match study(result, model, problem) {
            Ok(study) if !study.reproduced && name != result_of => Err(CliError::Usage(format!(
                "--problem {file}: it is called {name} and gives other errors than the result, which is of {result_of}; \
                 give the problem that was identified"
            ))),
            Ok(study) => Ok(Ok(study)),
            Err(why) => Err(CliError::Usage(format!("--problem {file}: {why}"))),
        };
    }
    let Some(source) = &result.source else {
        return Ok(Err("the result does not name its problem; give it with --problem".into()));
    };
    let named = Path::new(&source.problem_file);
    let candidates: [PathBuf; 2] = [named.to_owned(), folder.join(named)];
    let Some(path) = candidates.iter().find(|path| path.is_file()) else {
        let file = &source.problem_file;
        return Ok(Err(format!("there is no file {file}; give the problem with --problem")));
    };
    Ok(read_problem(path, places).map_err(|why| why.to_string()).and_then(|problem| {
        study(result, model, problem).map_err(|why| format!("{}: {why}", path.display()))
    }))
}

fn study(result: &ResultFile, model: &Model, problem: ProblemFile) -> Result<Study, String> {
    let drawn = &problem.mechanism;
    let names = drawn.limbs.iter().flat_map(|limb| limb.links.iter().map(|link| (&limb.name, &link.name)));
    if !names.eq(result.links.iter().map(|link| (&link.limb, &link.link))) {
        let limbs = |machine: &Mechanism| {
            let names: Vec<&str> = machine.limbs.iter().map(|limb| limb.name.as_str()).collect();
            format!("{} ({})", counted(names.len(), "limb"), listed(&names))
        };
        return Err(format!(
            "it draws another machine than that of the result: {} where the result has {}, or other joints in them",
            limbs(drawn),
            limbs(&model.mechanism)
        ));
    }
    let units = result.units;
    let components = result.links.iter().flat_map(|link| {
        let (w, v) = (link.deviation.rotation, link.deviation.translation);
        w.map(|x| units.to_radians(x)).into_iter().chain(v.map(|x| units.to_metres(x)))
    });
    let mut deviations: Vec<f64> = components.collect();
    if !drawn.instrument.iter().map(Constant::name).eq(result.instrument.iter().map(|c| c.name.clone())) {
        return Err("its instrument has other constants than that of the result".into());
    }
    deviations.extend(drawn.instrument.iter().zip(&result.instrument).map(|(constant, found)| {
        let value = match constant.quantity {
            Quantity::Angle => units.to_radians(found.value),
            Quantity::Length => units.to_metres(found.value),
            Quantity::Ratio => found.value,
        };
        value - constant.nominal
    }));
    if !deviations.iter().all(|v| v.is_finite()) {
        return Err("the result's deviations are not finite: the identifier diverged".into());
    }
    mobility::check(drawn, &drawn.nominal()).map_err(|why| format!("mechanism: {why}"))?;
    if problem.data.is_empty() {
        return Err("it has no samples".into());
    }
    let source = result.source.as_ref();
    let chosen = source.and_then(|source| Some((source.holdout?, source.seed.unwrap_or(0))));
    let (mut training, _) = divided(&problem, chosen).map_err(|why| why.to_string())?;
    let known = |name: &str| {
        let data = [&problem.data, &problem.holdout];
        data.iter().any(|set| set.samples.iter().chain(&set.unused).any(|s| s.name == name))
    };
    let mentioned = result.set_aside.iter().map(|s| &s.sample).chain(result.unused.iter().map(|s| &s.sample));
    if let Some(missing) = mentioned.into_iter().find(|name| !known(name)) {
        return Err(format!("the result speaks of {missing}, which it does not have"));
    }
    if predicts_otherwise(drawn, &drawn.deviated(&deviations), model, &training) {
        return Err("it draws another machine than that of the result: with the result's deviations it predicts other poses \
                    than the result's machine does"
            .into());
    }
    if let Some(noise) = &result.noise_estimate {
        let noise = NoiseEstimate {
            angle: noise.angle.map(|v| units.to_radians(v)),
            length: noise.length.map(|v| units.to_metres(v)),
        };
        training = noise.weigh(&training);
    }
    if let Some(common) = &result.posture_noise_estimate {
        let drawn = PostureNoiseDrawing { angle: common.angle, length: common.length };
        let at = Place::file("result");
        let common = drawn.read(units, &at.key("posture_noise_estimate")).map_err(|why| why.to_string())?;
        training = sharing(&training, common);
    }
    let start = placed(drawn, &training).ok_or("its samples do not place base, tool and instrument")?.machine;
    let geometry = drawn.deviated(&deviations);
    let at = geometry.deviations_from(&start.nominal());
    if !start.is_open_chain() {
        training = Calibration::new(&start, &training, Form::Minimal, &at).closed(&training);
    }
    let before = residuals(&start, &start.nominal(), &training);
    let after = residuals(&start, &geometry, &training);
    let seen = visibility(&start, &training, &at).ok();
    let in_force = result.tolerance_factor.as_ref().map_or(1.0, |factor| factor.in_force);
    let supported = if in_force == 1.0 { start.clone() } else { start.with_tolerances(in_force) };
    let estimate = result.estimate.map(Into::into);
    let decoupled = matches!(estimate, Some(Estimate::Decoupled { .. }));
    let covariance = match estimate {
        Some(_) if decoupled && !result.converged => None,
        Some(estimate) if decoupled => {
            let limbs = Calibration::new(&supported, &training, Form::Minimal, &at);
            let x = limbs.coordinates().nearest(&at);
            Covariance::decoupled(estimate, &limbs, &x).ok().flatten()
        }
        Some(estimate) if in_force == 1.0 => seen.as_ref().and_then(|seen| Covariance::joint(estimate, seen)),
        Some(estimate) => {
            let seen = visibility(&supported, &training, &at).ok();
            seen.and_then(|seen| Covariance::joint(estimate, &seen))
        }
        None => None,
    };
    let root = covariance.map(|c| c.root);
    let fit = score::score(&start, &geometry, &training);
    // A run that stayed where it began states none.
    let stated = result.fit.map(|fit| fit.after).filter(|after| *after != PoseErrors::default());
    let same = |a: Option<f64>, b: Option<f64>| match (a, b) {
        (Some(a), Some(b)) => (a - b).abs() <= SAME * a.abs().max(b.abs()) + 1e-12,
        (a, b) => a.is_none() && b.is_none(),
    };
    let position = fit.and_then(|fit| fit.position).map(|p| units.from_metres(p.rms));
    let rotation = fit.and_then(|fit| fit.rotation).map(|r| units.from_radians(r.rms));
    // Of other kinds of measurement the error in noise tells.
    let in_noise = fit.map(|fit| fit.weighted_rms).filter(|_| position.is_none() && rotation.is_none());
    let reproduced = stated.is_none_or(|s| {
        same(s.position_rms, position)
            && same(s.rotation_rms, rotation)
            && (in_noise.is_none() || same(s.weighted_rms, in_noise))
    });
    let moved = |mount: &Option<MountResult>| mount.as_ref().map_or_else(Se3::identity, |m| m.pose(units));
    let placed = match (&result.placement, &result.tool_mounting) {
        (None, None) => start.clone(),
        (base, tool) => drawn.relocated(&moved(base), &moved(tool)),
    };
    let residuals = before.into_iter().zip(after).collect();
    Ok(Study {
        start,
        supported,
        placed,
        geometry,
        at,
        training,
        residuals,
        seen,
        root,
        decoupled,
        reproduced,
    })
}

/// Whether the machine with these links takes other poses than that of the result at the first samples' readings.
fn predicts_otherwise(drawn: &Mechanism, geometry: &Geometry, model: &Model, samples: &[Sample]) -> bool {
    let calibrated = model.mechanism.nominal();
    let apart = samples.iter().take(COMPARED).filter_map(|sample| {
        let ours = close(drawn, geometry, &sample.actuators).ok()?.tool();
        let theirs = close(&model.mechanism, &calibrated, &sample.actuators).ok()?.tool();
        let (w, v) = pose_difference(&ours, &theirs);
        Some((v.norm() / drawn.characteristic_length()).max(w.norm()))
    });
    // Near a singularity single ones may differ.
    median(apart).is_some_and(|apart| apart > OTHER)
}
