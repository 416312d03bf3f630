//! Scores of a result, by the problem: whatever the identifier says of itself plays no part.

use super::bound::Bound;
use super::draw::Drawn;
use super::line::{Consistency, Parameters, Prediction, Residual, Score, Verified};
use super::objective::judged;
use super::offset::relative_offset;
use super::tolerance::Tolerance;
use crate::calibration::Sample;
use crate::calibration::representative::representative;
use crate::identify::covariance::variance;
use crate::identify::score::score;
use crate::identify::{Fit, Identification};
use crate::linalg;
use crate::model::mechanism::pose_difference;
use crate::model::{Geometry, Mechanism, Prior};
use crate::problem::Form;
use crate::simulate::close;
use crate::solve::Estimate;
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Probability of the residual's chi-square below which the stated noise does not explain it.
const UNEXPLAINED: f64 = 1e-3;
/// Part by which a loss without a derivative may still fall: twice what `conic-minimax` proves of a result.
const GAIN: f64 = 2e-3;
/// Ratio of the extreme singular values of the wrench matrix above which deviations do not move home far.
const REGULAR: f64 = 0.01;
/// Motion of home, rad or machine sizes, that is another assembly mode.
const ELSEWHERE: f64 = 0.3;

/// Cost `|r|^2 / 2` of the geometry over all samples; `None` where some do not close.
pub fn cost(mechanism: &Mechanism, geometry: &Geometry, samples: &[Sample]) -> Option<f64> {
    let fit = score(mechanism, geometry, samples).filter(|fit| fit.samples == samples.len())?;
    let rows: usize = samples.iter().map(|sample| sample.measurement.rows()).sum();
    finite(0.5 * fit.weighted_rms.powi(2) * rows as f64)
}

/// What can be said before anything is identified.
pub fn before(drawn: &Drawn, bound: Option<&Bound>) -> Score {
    let nominal = drawn.start.nominal();
    let of = |geometry: &Geometry| cost(&drawn.start, geometry, &drawn.samples);
    Score {
        truth: drawn.truth.is_some(),
        samples: drawn.samples.len(),
        cost_nominal: of(&nominal),
        cost_truth: drawn.truth.as_ref().and_then(of),
        prior_truth: bound.map(|b| 0.5 * b.truth.iter().map(|z| z * z).sum::<f64>()),
        before: prediction(score(&drawn.start, &nominal, &drawn.holdout)),
        bound: bound.and_then(|bound| bound.holdout),
        ..Score::default()
    }
}

/// Adds to `before` what came of an identification in coordinates of the given form.
pub fn after(
    before: &Score,
    drawn: &Drawn,
    bound: Option<&Bound>,
    found: &Identification,
    form: Form,
) -> Score {
    let after = prediction(score(&found.start, &found.geometry, &drawn.holdout));
    let ratio = match (after.in_noise, before.bound.and_then(|b| b.in_noise)) {
        (Some(error), Some(bound)) if bound > 0.0 => finite(error / bound),
        _ => None,
    };
    let error = bound.map(|bound| {
        // About the machine that the truth was brought to: registration may have placed free ends elsewhere.
        let found = representative(&drawn.start, &found.geometry);
        found.iter().zip(&bound.truth).map(|(z, truth)| z - truth).collect::<Vec<f64>>()
    });
    let reference = drawn.truth.clone().unwrap_or_else(|| found.start.nominal());
    let judged = match found.report.estimate {
        Estimate::Other if found.set_aside.is_empty() => judged(found, &drawn.samples, &reference),
        Estimate::Other => judged(found, &found.taking, &reference),
        _ => None,
    };
    let limited = judged.is_some_and(|judged| judged.limited);
    let gain = judged.and_then(|judged| judged.gain);
    let explainable = drawn.truth.is_none() && drawn.noise_stated && !limited && gain.is_none();
    Score {
        set_aside: found.set_aside.len(),
        cost: cost(&found.start, &found.geometry, &drawn.samples),
        offset: relative_offset(found, &drawn.samples, form).or(judged.and_then(|judged| judged.offset)),
        objective: judged.map(|judged| judged.value),
        objective_reference: judged.and_then(|judged| judged.reference),
        objective_within: judged.and_then(|judged| judged.within),
        gain,
        limited,
        other_mode: other_mode(found),
        after,
        ratio,
        residual: if explainable { residual(found) } else { None },
        parameters: bound.zip(error.as_ref()).and_then(|(bound, error)| parameters(bound, error)),
        consistency: error.as_ref().and_then(|error| consistency(found, error)),
        ..before.clone()
    }
}

/// Residual of the postures that take part, against the noise: computed from the geometry.
fn residual(found: &Identification) -> Option<Residual> {
    let rows: usize = found.taking.iter().map(|sample| sample.measurement.rows()).sum();
    let freedom = rows as f64 - found.covariance.as_ref().map_or(0.0, |covariance| covariance.absorbed);
    let law = ChiSquared::new(freedom).ok()?;
    match cost(&found.start, &found.geometry, &found.taking) {
        Some(cost) => {
            Some(Residual { chi_square: 2.0 * cost, freedom, probability: finite(law.sf(2.0 * cost))? })
        }
        None => Some(Residual { chi_square: f64::MAX, freedom, probability: 0.0 }),
    }
}

/// Whether the result's machine stands elsewhere at home than the drawing, by far more than deviations move it. Measured
/// postures close where they were measured, so that nothing else shows it. Near a singularity home moves far by itself, and
/// nothing is said.
fn other_mode(found: &Identification) -> bool {
    let machine = &found.start;
    let zero = vec![0.0; machine.actuator_count()];
    let home = |geometry: &Geometry| close(machine, geometry, &zero).ok();
    if machine.is_open_chain() {
        return false;
    }
    let (Some(drawn), Some(here)) = (home(&machine.nominal()), home(&found.geometry)) else { return false };
    let (turned, moved) = pose_difference(&drawn.tool(), &here.tool());
    let moved = turned.norm().max(moved.norm() / machine.characteristic_length());
    drawn.regularity() > REGULAR && moved > ELSEWHERE
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

fn prediction(fit: Option<Fit>) -> Prediction {
    let Some(fit) = fit else { return Prediction::default() };
    Prediction {
        position: fit.position.and_then(|s| finite(s.rms)),
        position_max: fit.position.and_then(|s| finite(s.max)),
        rotation: fit.rotation.and_then(|s| finite(s.rms)),
        rotation_max: fit.rotation.and_then(|s| finite(s.max)),
        in_noise: finite(fit.weighted_rms),
        poses: fit.samples,
    }
}

/// Error along the directions of which the postures know more than the tolerance at the truth.
fn parameters(bound: &Bound, error: &[f64]) -> Option<Parameters> {
    let along = linalg::mul_transpose(bound.directions.as_ref(), error);
    let known = bound.singular_values.iter().zip(&along).filter(|(s, _)| **s > 1.0);
    let (mut count, mut square, mut least) = (0, 0.0, 0.0);
    for (s, error) in known {
        count += 1;
        square += error * error;
        least += 1.0 / (1.0 + s * s);
    }
    let rms = |sum: f64| finite((sum / f64::from(count)).sqrt());
    Some(Parameters { count: count as usize, rms: rms(square)?, bound: rms(least)? })
}

/// Error in units of the covariance that the result states, along all directions; none where a link, a motion that links
/// share, or a constant of the instrument (a target, a point, a plane) is free: along what the data leave open there, truth
/// and result may be so far apart that linear theory does not compare them.
fn consistency(found: &Identification, error: &[f64]) -> Option<Consistency> {
    let machine = &found.start;
    let links = machine.limbs.iter().flat_map(|limb| &limb.links).map(|link| link.tolerance);
    let shared = [machine.ends.placement, machine.ends.tool_mounting].into_iter().flatten();
    let tolerances = links.chain(shared).flat_map(|tolerance| [tolerance.angle, tolerance.length]);
    let constants = machine.instrument.iter().map(|constant| constant.prior);
    if tolerances.chain(constants).any(|prior| prior == Prior::Free) {
        return None;
    }
    let seen = found.visibility.as_ref()?;
    let along = linalg::mul_transpose(seen.directions.as_ref(), error);
    let mut nees = 0.0;
    for (s, error) in seen.singular_values.iter().zip(&along) {
        nees += error * error / variance(found.report.estimate, *s)?.total;
    }
    let freedom = along.len();
    let probability = ChiSquared::new(freedom as f64).ok()?.cdf(nees);
    Some(Consistency { nees: finite(nees)?, freedom, probability: finite(probability)? })
}

/// Holds the score against the tolerance.
pub fn verify(score: &Score, tolerance: &Tolerance) -> Verified {
    let mut reasons = Vec::new();
    let mut check = |passes: Option<bool>, why: &dyn Fn() -> String| {
        if passes == Some(false) {
            reasons.push(why());
        }
        passes
    };
    let shown = |value: Option<f64>| value.map_or_else(|| "none".into(), |v| format!("{v:.3e}"));
    let stationary = match (score.offset, score.gain) {
        (None, Some(gain)) => check(Some(gain <= GAIN), &|| {
            format!("the largest residual may still fall by {gain:.1e} of it, above {GAIN:e}")
        }),
        _ => check(score.offset.map(|offset| offset <= tolerance.offset), &|| match score.offset {
            Some(f64::MAX) => "a limit is overstepped".into(),
            _ => format!("relative offset {} above {:e}", shown(score.offset), tolerance.offset),
        }),
    };
    // A minimiser is no worse than the truth, nor than where it came from.
    let (cost, least) = match (score.objective, score.cost_truth, score.prior_truth) {
        (Some(value), ..) => (Some(value), score.objective_reference.or(score.objective_within)),
        (None, Some(cost), Some(prior)) => (score.cost, Some(cost + prior)),
        _ => (score.cost, score.cost_nominal),
    };
    let within = |limit: f64| cost.is_some_and(|cost| cost <= limit * (1.0 + tolerance.cost));
    let cost = check(least.map(within), &|| format!("cost {} above {}", shown(cost), shown(least)));
    let predicted = score.after.poses > 0 && score.after.poses >= score.before.poses;
    // Limits that exclude the truth are kept at the cost of a prediction for which the bound does not hold.
    let excluded = score.truth && score.objective.is_some() && score.objective_reference.is_none();
    let efficient = score.gain.is_none();
    let prediction = match (score.bound, score.before.in_noise) {
        _ if excluded => None,
        (Some(_), _) if efficient => {
            Some(predicted && score.ratio.is_some_and(|ratio| ratio <= tolerance.prediction))
        }
        (_, Some(before)) => Some(predicted && score.after.in_noise.is_some_and(|after| after <= before)),
        (_, None) => None,
    };
    let prediction = check(prediction, &|| match (predicted, score.ratio) {
        (false, _) => format!("{} of the hold-out poses close", score.after.poses),
        (true, Some(ratio)) if efficient => format!("hold-out error {ratio:.2} times the bound"),
        (true, _) => format!("hold-out error {} in noise", shown(score.after.in_noise)),
    });
    let explained = check(score.residual.map(|found| found.probability >= UNEXPLAINED), &|| {
        let found = score.residual.map_or((f64::NAN, f64::NAN), |found| (found.chi_square, found.freedom));
        match found.0 {
            f64::MAX => "postures that took part do not close".into(),
            _ => format!(
                "chi-square {:.4} of {:.4}: the stated noise does not explain the residual",
                found.0, found.1
            ),
        }
    });
    if score.other_mode {
        reasons.push("at home it stands in another assembly mode than the drawing".into());
    }
    if stationary.is_none() {
        reasons.push("whether it is a stationary point cannot be evaluated".into());
    }
    Verified {
        success: reasons.is_empty(),
        stationary,
        cost,
        prediction,
        explained,
        reason: reasons.join("; "),
    }
}
