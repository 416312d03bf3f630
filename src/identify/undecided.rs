//! Postures of which the data do not tell how they were closed (docs/theory.md section 7).
//!
//! The loops close in several ways at the same readings. Where a posture tells of the machine what no other one does, the
//! machine may adapt itself to the wrong way, and nothing is left of the error.

use super::cross_validation::Influence;
use super::run::Identification;
use crate::calibration::postures::{by_posture, posture_name};
use crate::calibration::{Calibration, OtherPosture, Sample};
use crate::problem::{Form, Problem};
use crate::solve::minimal::Minimal;
use crate::solve::{Estimate, Identifier, Stop};
use rayon::prelude::*;

/// Root mean square of the whitened residual by which another posture misses the reading before the machine adapts
/// itself, from which it matters which of the two was measured.
const MATTERS: f64 = 3.0;
/// Eigenvalue of a posture's block of the influence matrix up to which the other postures tell it well enough: where they
/// predict it to its own noise, a miss of 3 costs 13 and more.
const TOLD: f64 = 0.5;
/// Loss of log-likelihood and prior, ln(1000), beyond which a posture is ruled out.
const UNLIKELY: f64 = 6.907_755_278_982_137;
/// Loss by the linear model beyond which the machine is not identified again to see.
const HOPELESS: f64 = 100.0;
/// Residual and deviations, standard deviations a reading in the root mean square, beyond which no odds are told.
const SPOILED: f64 = 2.0;
/// Most iterations with another posture.
const ITERATIONS: usize = 30;

/// A posture that was closed in one of two ways that explain what was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct UndecidedPosture {
    /// The sample; of several, the first and the last.
    pub name: String,
    /// Names of its samples.
    pub samples: Vec<String>,
    /// Root mean square of the whitened residual of the other posture by the machine as identified.
    pub apart: f64,
    /// Gain of log-likelihood and prior where the machine is identified with the other posture.
    pub gain: f64,
}

/// Postures that close in another way, too, with which a machine comes out that explains the data and agrees with the
/// tolerances no worse than with odds of 1 to 1000. For estimates that linear theory describes; none elsewhere.
pub fn undecided(found: &Identification, samples: &[Sample]) -> Vec<UndecidedPosture> {
    if found.start.is_open_chain() || !found.report.outcome.converged() {
        return Vec::new();
    }
    let taking = found.taking_part(samples);
    let Ok(influence) = Influence::new(found, &taking) else { return Vec::new() };
    let at = found.geometry.deviations_from(&found.supported.nominal());
    let problem = Calibration::new(&found.supported, &taking, Form::Minimal, &at);
    let Some(here) = least(&problem, found.report.estimate, &at) else { return Vec::new() };
    // Odds are those of the stated noise: where the residual contradicts it, they prove nothing.
    if 2.0 * here > SPOILED.powi(2) * problem.rows() as f64 {
        return Vec::new();
    }
    let postures = by_posture(&taking);
    let doubted = |index: &usize| influence.leverage(*index).is_none_or(|leverage| leverage > TOLD);
    let wanted: Vec<usize> = (0..postures.len()).into_par_iter().filter(doubted).collect();
    let each = |(index, others): (usize, Vec<OtherPosture>)| {
        let names: Vec<&str> = postures.get(index)?.iter().map(|sample| sample.name.as_str()).collect();
        let mut best: Option<UndecidedPosture> = None;
        for other in others {
            let apart = other.square().sqrt();
            if apart <= MATTERS {
                continue;
            }
            let Some(there) = adapted(&influence, &problem, index, &other) else { continue };
            let gain = here - there;
            if gain > best.as_ref().map_or(-UNLIKELY, |best| best.gain) {
                let samples = names.iter().map(|name| (*name).to_owned()).collect();
                best = Some(UndecidedPosture { name: posture_name(&names), samples, apart, gain });
            }
        }
        best
    };
    let others = problem.alternatives(&taking, &at, &wanted);
    wanted.into_par_iter().zip(others).filter_map(each).collect()
}

/// Merit of the machine that is identified with posture `index` of `problem` in another way; `None` where it cannot adapt
/// itself to that, or falls back to the way in which it was closed.
fn adapted(
    influence: &Influence<'_>,
    problem: &Calibration<'_>,
    index: usize,
    other: &OtherPosture,
) -> Option<f64> {
    let elsewhere = problem.closed_in(index, other);
    let (loss, x) = influence.replaced(index, &elsewhere)?;
    if loss > HOPELESS {
        return None;
    }
    let stop = Stop { iterations: ITERATIONS, ..Stop::default() };
    let report = Minimal::default().identify(&elsewhere, &x, &stop);
    let at = elsewhere.coordinates().deviations(&report.x);
    let stays = at.iter().all(|v| v.is_finite()) && elsewhere.is_apart(index, &at, problem);
    if stays { merit(&elsewhere, &report.x) } else { None }
}

/// Merit of the machine as identified; where each limb was by itself, of the one that they give together: other postures are
/// judged by that.
fn least(problem: &Calibration<'_>, estimate: Estimate, at: &[f64]) -> Option<f64> {
    let x = problem.coordinates().nearest(at);
    match estimate {
        Estimate::Decoupled { .. } => {
            let report = Minimal::default().identify(problem, &x, &Stop::default());
            if report.outcome.converged() { merit(problem, &report.x) } else { None }
        }
        _ => merit(problem, &x),
    }
}

/// `|r|^2 / 2 + |x|^2 / 2`.
fn merit(problem: &Calibration<'_>, x: &[f64]) -> Option<f64> {
    let r = problem.residual(x).ok()?;
    let merit = 0.5 * r.iter().chain(x).map(|v| v * v).sum::<f64>();
    merit.is_finite().then_some(merit)
}
