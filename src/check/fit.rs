//! The machine fitted to readings within its tolerances: what no such machine explains is what a correction has to.

use super::alignment::align;
use super::observed::Observed;
use super::prediction::Predictor;
use super::reading::{Reading, postures};
use crate::calibration::{ByPosture, Calibration, Sample};
use crate::identify::registration::FreeEnds;
use crate::identify::run::placed;
use crate::identify::score::score;
use crate::model::{Mechanism, Prior, Tolerance};
use crate::problem::{Form, Problem};
use crate::solve::map::Map;
use crate::solve::{Identifier, Stop};
use crate::statistics::median;
use std::collections::HashSet;

/// How long a machine is fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Effort {
    /// Enough to tell most corrections from each other.
    Short,
    /// Through valleys, too.
    Long,
}

impl Effort {
    fn stop(self) -> Stop {
        let iterations = if self == Effort::Short { 12 } else { 60 };
        Stop { iterations, step: 1e-4, gradient: 1e-6, cost: 1e-4 }
    }
}

/// Part of the samples that may be left out because they stand out.
const LEFT_OUT: f64 = 0.1;
/// How far they do, in terms of the median posture's residual and of the noise.
const OUTSTANDING: f64 = 6.0;
/// Fits, each without the samples that stood out from the one before.
const ROUNDS: usize = 3;

/// What is left after the fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// Chi-square of residuals, in standard deviations of the noise, and of deviations, in tolerances: on average the
    /// number of rows where noise and tolerances are as stated.
    pub square: f64,
    /// Number of residuals.
    pub rows: usize,
    /// Part of the samples that close.
    pub closed: f64,
    /// Root mean square error of the positions, m.
    pub position: Option<f64>,
    /// Root mean square error of the rotations, rad.
    pub rotation: Option<f64>,
    /// Root mean square distance of the positions from their mean, m.
    pub spread: f64,
    /// Whether positions or rotations spread as those of a machine that moves.
    pub moves: bool,
    /// The larger of the two errors in parts of the spread of what was measured: 1 where nothing is explained.
    pub relative: f64,
}

impl Fit {
    /// Root mean square of residuals and deviations in their standard deviations: 1 where these are as stated.
    pub fn size(&self) -> f64 {
        (self.square / self.rows.max(1) as f64).sqrt()
    }
}

/// The mechanism with these of its ends free, each one motion of all limbs: where a limb stands on the base is as drawn.
pub(super) fn freed(mechanism: &Mechanism, free: FreeEnds) -> Mechanism {
    let mut mechanism = mechanism.clone();
    let anywhere = Tolerance { angle: Prior::Free, length: Prior::Free };
    if let [limb] = mechanism.limbs.as_mut_slice() {
        if let Some(first) = limb.links.first_mut().filter(|_| free.base) {
            first.tolerance = anywhere;
        }
        if let Some(last) = limb.links.last_mut().filter(|_| free.tool) {
            last.tolerance = anywhere;
        }
        return mechanism;
    }
    if free.base {
        mechanism.ends.placement = Some(anywhere);
    }
    if free.tool {
        mechanism.ends.tool_mounting = Some(anywhere);
    }
    mechanism
}

/// Fits the machine to the readings, these ends moved as a whole besides its own free ones; `None` where the readings do not
/// place it, or too few of them close.
pub(super) fn fit(mechanism: &Mechanism, data: &[Reading], free: FreeEnds, effort: Effort) -> Option<Fit> {
    let freed = freed(mechanism, free);
    let all: Option<Vec<Sample>> = data.iter().map(|reading| reading.sample(&freed)).collect();
    let all = all?;
    let of = postures(data);
    let observed = Observed::new(mechanism, data, &of)?;
    let start = started(&freed, data, &all, &of, &observed)?;
    let mut samples = all.clone();
    let zero = vec![0.0; start.component_count()];
    for round in 1..=ROUNDS {
        let problem = Calibration::new(&start, &samples, Form::Minimal, &zero);
        let closed = (all.len() - problem.set_aside().len()) as f64 / all.len() as f64;
        if problem.sample_count() == 0 {
            return None;
        }
        let mut x = problem.coordinates().nearest(&zero);
        if !x.is_empty() {
            x = Map::default().identify(&problem, &x, &effort.stop()).x;
        }
        let residual = problem.residual(&x).ok()?;
        let keep = kept(&residual, &problem, &samples, all.len());
        if round < ROUNDS && keep.len() < samples.len() - problem.set_aside().len() {
            samples = keep;
            continue;
        }
        let prior: f64 = x.iter().map(|v| v * v).sum();
        let square = residual.iter().map(|r| r * r).sum::<f64>() + prior;
        let geometry = start.deviated(&problem.coordinates().deviations(&x));
        let score = score(&start, &geometry, &samples)?;
        let (position, rotation) = (score.position.map(|s| s.rms), score.rotation.map(|s| s.rms));
        let relative = position.map_or(0.0, |v| v / observed.spread[0]);
        // Rotations that hardly spread cannot be explained, nor need they be.
        let turned = rotation.map_or(0.0, |v| v / observed.scale[1]);
        let fit = Fit {
            square,
            rows: residual.len(),
            closed,
            position,
            rotation,
            spread: observed.spread[0],
            moves: observed.moves(),
            relative: relative.max(turned),
        };
        return square.is_finite().then_some(fit);
    }
    None
}

/// The machine where its free ends are: as registered, or as aligned, whichever the readings are nearer to.
fn started(
    mechanism: &Mechanism,
    data: &[Reading],
    samples: &[Sample],
    of: &[Vec<usize>],
    observed: &Observed,
) -> Option<Mechanism> {
    let free = FreeEnds::of(mechanism);
    let registered = placed(mechanism, samples).map(|found| found.machine);
    if !(free.base || free.tool) || observed.loose {
        return registered;
    }
    let first = of.iter().filter_map(|list| data.get(*list.first()?));
    let variables: Vec<Vec<f64>> = first.map(|reading| reading.variables(mechanism)).collect();
    let aligned = align(&Predictor::new(mechanism).tools(&variables), observed, free)
        .map(|found| mechanism.relocated(&found.ends.0, &found.ends.1));
    let size = |machine: &Mechanism| {
        score(machine, &machine.nominal(), samples).map_or(f64::INFINITY, |fit| fit.weighted_rms)
    };
    match (registered, aligned) {
        (Some(a), Some(b)) => Some(if size(&b) < size(&a) { b } else { a }),
        (a, b) => a.or(b),
    }
}

/// The samples that close, of postures that do not stand out; most of the `of` samples of the data stay.
fn kept(residual: &[f64], problem: &Calibration<'_>, samples: &[Sample], of: usize) -> Vec<Sample> {
    let aside: HashSet<usize> = problem.set_aside().iter().map(|s| s.sample).collect();
    let closing: Vec<Sample> =
        samples.iter().enumerate().filter(|(k, _)| !aside.contains(k)).map(|(_, s)| s.clone()).collect();
    // One block of rows a posture.
    let (blocks, postures) = (problem.blocks(), ByPosture::of(&closing));
    if blocks.len() != postures.count() {
        return closing;
    }
    let sizes: Vec<f64> = blocks
        .iter()
        .map(|rows| {
            let square: f64 = residual[rows.clone()].iter().map(|r| r * r).sum();
            (square / rows.len().max(1) as f64).sqrt()
        })
        .collect();
    let limit = OUTSTANDING * median(sizes.iter().copied()).unwrap_or(0.0).max(1.0);
    let far: HashSet<usize> = (postures.iter().zip(&sizes))
        .filter(|(_, size)| **size > limit)
        .flat_map(|(posture, _)| posture.iter().copied())
        .collect();
    if far.is_empty() || far.len() as f64 > LEFT_OUT * of as f64 {
        return closing;
    }
    closing.into_iter().enumerate().filter(|(k, _)| !far.contains(k)).map(|(_, sample)| sample).collect()
}
