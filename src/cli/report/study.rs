//! The problem that a result belongs to, and what follows from both.

use crate::calibration::Sample;
use crate::cli::error::CliError;
use crate::cli::identify::divided;
use crate::files::{DataPlaces, ProblemFile, ResultFile, read_problem};
use crate::identify::counts::visibility;
use crate::identify::residuals::{Residual, residuals};
use crate::identify::run::placed;
use crate::identify::{Covariance, NoiseEstimate, Visibility, score};
use crate::model::{Constant, Geometry, Mechanism, Quantity};
use crate::solve::Estimate;
use faer::Mat;
use std::path::{Path, PathBuf};

/// Relative difference at which recomputed errors are those of the result.
const SAME: f64 = 1e-6;

/// A result seen with its problem.
pub(super) struct Study {
    /// The machine about which was linearised: as drawn, with free ends registered.
    pub(super) start: Mechanism,
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
    /// Whether the errors that the result states came out again.
    pub(super) reproduced: bool,
}

/// The problem named by `asked` or else by the result, and what follows. What was asked for must be there and fit;
/// what the result names may be missing, and then the reason is returned.
pub(super) fn find(
    result: &ResultFile,
    asked: Option<&Path>,
    folder: &Path,
    places: &DataPlaces,
) -> Result<Result<Study, String>, CliError> {
    if let Some(path) = asked {
        let problem = read_problem(path, places)?;
        let file = problem.file.clone();
        return match study(result, problem) {
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
    Ok(read_problem(path, places)
        .map_err(|why| why.to_string())
        .and_then(|problem| study(result, problem).map_err(|why| format!("{}: {why}", path.display()))))
}

fn study(result: &ResultFile, problem: ProblemFile) -> Result<Study, String> {
    let drawn = &problem.mechanism;
    let names = drawn.limbs.iter().flat_map(|limb| limb.links.iter().map(|link| (&limb.name, &link.name)));
    if !names.eq(result.links.iter().map(|link| (&link.limb, &link.link))) {
        return Err("it draws another machine than that of the result (other limbs or links)".into());
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
    if problem.data.is_empty() {
        return Err("it has no samples".into());
    }
    let source = result.source.as_ref();
    let chosen = source.and_then(|source| Some((source.holdout?, source.seed.unwrap_or(0))));
    let (mut training, _) = divided(&problem, chosen).map_err(|why| why.to_string())?;
    if let Some(noise) = &result.noise_estimate {
        let noise = NoiseEstimate {
            angle: noise.angle.map(|v| units.to_radians(v)),
            length: noise.length.map(|v| units.to_metres(v)),
        };
        training = noise.weigh(&training);
    }
    let start = placed(drawn, &training).ok_or("its samples do not place base, tool and instrument")?;
    let geometry = drawn.deviated(&deviations);
    let at = geometry.deviations_from(&start.nominal());
    let before = residuals(&start, &start.nominal(), &training);
    let after = residuals(&start, &geometry, &training);
    let seen = visibility(&start, &training, &at).ok();
    let estimate = result.estimate.map(Into::into);
    let root = seen
        .as_ref()
        .zip(estimate)
        .filter(|(_, estimate)| !matches!(estimate, Estimate::Decoupled { .. }))
        .and_then(|(seen, estimate)| Covariance::joint(estimate, seen))
        .map(|c| c.root);
    let fit = score::score(&start, &geometry, &training);
    let stated = result.fit.map(|fit| fit.after);
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
    let residuals = before.into_iter().zip(after).collect();
    Ok(Study { start, geometry, at, training, residuals, seen, root, reproduced })
}
