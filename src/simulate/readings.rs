//! Simulated readings of any kind of measurement.

use super::{Plan, SimulateError, close, draw_deviations, draw_postures, stream};
use crate::measure::{Evaluation, Measurement, View};
use crate::model::{Geometry, Mechanism, NotClosed};
use rand_distr::{Distribution, StandardNormal};
use std::sync::Arc;

/// Postures drawn for each contact that is wanted: not every one leads to the surface.
const SPARE: usize = 4;
/// Newton steps to a surface.
const ITERATIONS: usize = 20;
/// Distance from the wanted residual, in standard deviations, at which a surface is reached.
const REACHED: f64 = 1e-5;
/// Step of difference quotients, in parts of an actuator's range.
const STEP: f64 = 1e-5;

/// Actuator variables (rad, m) and what was read there.
pub type Reading = (Vec<f64>, Arc<dyn Measurement>);

/// One set of simulated readings.
#[derive(Clone, Debug)]
pub struct SimulatedSet {
    /// With noise.
    pub samples: Vec<Reading>,
    /// Without noise.
    pub holdout: Vec<Reading>,
}

/// What `blank` would read without noise at these actuator variables (rad, m), and where it compares two postures in
/// the second at `second`.
pub fn read(
    mechanism: &Mechanism,
    geometry: &Geometry,
    blank: &dyn Measurement,
    actuators: &[f64],
    second: &[f64],
) -> Result<Arc<dyn Measurement>, NotClosed> {
    let posture = close(mechanism, geometry, actuators)?;
    let tool = posture.tool();
    let view = View { tool, posture: Some(&posture), second: tool, instrument: &geometry.instrument };
    match blank.with_second(second) {
        Some(two) => {
            let second = close(mechanism, geometry, second)?.tool();
            Ok(two.expected(&View { second, ..view }))
        }
        None => Ok(blank.expected(&view)),
    }
}

/// Draws a true machine from the tolerances and measures it: set by set, each of as many samples as `counts` says,
/// with its measurements `blanks` in turn. `plan.poses` is not used; `plan.holdout` is that of each set.
pub fn simulate_sets(
    mechanism: &Mechanism,
    blanks: &[Vec<Arc<dyn Measurement>>],
    counts: &[usize],
    plan: &Plan,
) -> Result<(Geometry, Vec<SimulatedSet>), SimulateError> {
    let truth = mechanism.deviated(&draw_deviations(mechanism, plan.seed, plan.distance));
    let sets = simulate_sets_truth(mechanism, &truth, blanks, counts, plan)?;
    Ok((truth, sets))
}

/// Measures a given true machine, set by set as [`simulate_sets`] does; `plan.distance` is not looked at.
pub fn simulate_sets_truth(
    mechanism: &Mechanism,
    truth: &Geometry,
    blanks: &[Vec<Arc<dyn Measurement>>],
    counts: &[usize],
    plan: &Plan,
) -> Result<Vec<SimulatedSet>, SimulateError> {
    let nominal = mechanism.nominal();
    let postures_of = |blank: &Arc<dyn Measurement>| match (blank.second().is_some(), blank.is_contact()) {
        (true, _) => 2,
        (_, true) => SPARE,
        _ => 1,
    };
    let wanted: usize = blanks
        .iter()
        .zip(counts)
        .map(|(blanks, count)| (count + plan.holdout) * blanks.iter().map(postures_of).max().unwrap_or(0))
        .sum();
    let mut pool = draw_postures(mechanism, &[&nominal, truth], wanted, plan.seed)?.into_iter();
    let mut rng = stream(plan.seed, 2);
    let mut sets = Vec::with_capacity(blanks.len());
    for (blanks, count) in blanks.iter().zip(counts) {
        let mut set = SimulatedSet { samples: Vec::new(), holdout: Vec::new() };
        for (k, blank) in blanks.iter().cycle().take(count + plan.holdout).enumerate() {
            let noise = if k < *count { plan.noise } else { 0.0 };
            let mut normal = || -> f64 {
                let drawn: f64 = StandardNormal.sample(&mut rng);
                drawn * noise
            };
            let short = SimulateError::Contact { found: k, wanted: count + plan.holdout };
            let reading = if blank.is_contact() {
                let aim = normal();
                let touching = pool.by_ref().find_map(|from| touch(mechanism, truth, &**blank, from, aim));
                (touching.ok_or(short)?, blank.clone())
            } else {
                let actuators = pool.next().ok_or(short.clone())?;
                let second = if blank.second().is_some() { pool.next().ok_or(short)? } else { Vec::new() };
                let last = |last| SimulateError::Workspace { found: k, wanted: count + plan.holdout, last };
                let exact = read(mechanism, truth, &**blank, &actuators, &second).map_err(last)?;
                (actuators, if noise > 0.0 { exact.perturbed(&mut normal) } else { exact })
            };
            if k < *count { set.samples.push(reading) } else { set.holdout.push(reading) }
        }
        sets.push(set);
    }
    Ok(sets)
}

/// Leads the machine from a posture to where the residual is `aim` (standard deviations), by the shortest way in parts
/// of the actuators' ranges; `None` where that is outside them.
pub fn touch(
    mechanism: &Mechanism,
    geometry: &Geometry,
    blank: &dyn Measurement,
    from: Vec<f64>,
    aim: f64,
) -> Option<Vec<f64>> {
    let ranges = super::actuator_ranges(mechanism);
    let residual = |actuators: &[f64]| -> Option<f64> {
        let posture = close(mechanism, geometry, actuators).ok()?;
        let tool = posture.tool();
        let view = View { tool, posture: Some(&posture), second: tool, instrument: &geometry.instrument };
        let mut out = Evaluation::default();
        blank.evaluate(&view, &mut out);
        out.rows.first().map(|row| row.r - aim)
    };
    let mut at = from;
    for _ in 0..ITERATIONS {
        let here = residual(&at)?;
        if here.abs() <= REACHED {
            let inside = at.iter().zip(&ranges).all(|(q, (low, high))| (low..=high).contains(&q));
            return inside.then_some(at);
        }
        let mut slopes = Vec::with_capacity(at.len());
        for (i, (low, high)) in ranges.iter().enumerate() {
            let mut moved = at.clone();
            moved[i] += STEP * (high - low);
            let ahead = residual(&moved)?;
            moved[i] = at[i] - STEP * (high - low);
            slopes.push((ahead - residual(&moved)?) / (2.0 * STEP));
        }
        let square: f64 = slopes.iter().map(|s| s * s).sum();
        for ((q, slope), (low, high)) in at.iter_mut().zip(&slopes).zip(&ranges) {
            *q -= slope * here / square * (high - low);
        }
        if !at.iter().all(|q| q.is_finite()) {
            return None;
        }
    }
    None
}
