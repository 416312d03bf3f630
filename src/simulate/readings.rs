//! Simulated readings of any kind of measurement.

use super::{Plan, SimulateError, close, draw_deviations, draw_postures, stream};
use crate::lie::{Se3, so3};
use crate::measure::{Evaluation, Measurement, View};
use crate::model::{Geometry, Mechanism, NotClosed};
use nalgebra::Vector3;
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
    read_off(mechanism, geometry, blank, [actuators, second], [[0.0; 6]; 2])
}

/// The same where the tool is off by a twist `[w; dp]` (rad, m; {S} axes) in the first and in the second posture.
fn read_off(
    mechanism: &Mechanism,
    geometry: &Geometry,
    blank: &dyn Measurement,
    [actuators, second]: [&[f64]; 2],
    off: [[f64; 6]; 2],
) -> Result<Arc<dyn Measurement>, NotClosed> {
    let posture = close(mechanism, geometry, actuators)?;
    let tool = moved(&posture.tool(), &off[0]);
    let view = View { tool, posture: Some(&posture), second: tool, instrument: &geometry.instrument };
    match blank.with_second(second) {
        Some(two) => {
            let second = moved(&close(mechanism, geometry, second)?.tool(), &off[1]);
            Ok(two.expected(&View { second, ..view }))
        }
        None => Ok(blank.expected(&view)),
    }
}

/// A tool pose moved by a twist `[w; dp]`, {S} axes, dp that of the tool point.
fn moved(tool: &Se3, [a, b, c, x, y, z]: &[f64; 6]) -> Se3 {
    if [a, b, c, x, y, z].iter().all(|v| **v == 0.0) {
        return *tool;
    }
    Se3 { r: so3::exp(&Vector3::new(*a, *b, *c)) * tool.r, p: tool.p + Vector3::new(*x, *y, *z) }
}

/// How many of a set's measurements are taken at each posture: all, where what they have in common is stated; else each
/// has postures of its own. A touch always has, to which the machine is led.
pub fn at_each_posture(blanks: &[Arc<dyn Measurement>]) -> usize {
    let apart = |blank: &Arc<dyn Measurement>| blank.posture_noise().is_none() || blank.is_contact();
    if blanks.iter().any(apart) { 1 } else { blanks.len().max(1) }
}

/// Draws a true machine from the tolerances and measures it: set by set, each of as many samples as `counts` says,
/// with its measurements `blanks` in turn; all of them at each posture where their posture noise is stated. `plan.poses` is not used; `plan.holdout` is that of each set.
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
        let together = at_each_posture(blanks);
        let mut next = blanks.iter().cycle();
        for k in 0..if blanks.is_empty() { 0 } else { count + plan.holdout } {
            let noise = if k < *count { plan.noise } else { 0.0 };
            let mut normal = || -> f64 {
                let drawn: f64 = StandardNormal.sample(&mut rng);
                drawn * noise
            };
            let short = SimulateError::Contact { found: k, wanted: count + plan.holdout };
            let of_posture: Vec<&Arc<dyn Measurement>> = next.by_ref().take(together).collect();
            let common = of_posture.first().and_then(|blank| blank.posture_noise()).unwrap_or_default();
            let mut off = || if common.is_zero() { [0.0; 6] } else { common.draw(&mut normal) };
            let off_first = off();
            let contact = of_posture.iter().find(|blank| blank.is_contact());
            let readings = if let Some(blank) = contact {
                let aim = normal();
                let lead = |from| touch_off(mechanism, truth, &***blank, from, aim, &off_first);
                let touching = pool.by_ref().find_map(lead);
                vec![(touching.ok_or(short)?, (**blank).clone())]
            } else {
                let actuators = pool.next().ok_or(short.clone())?;
                let pairs = of_posture.iter().any(|blank| blank.second().is_some());
                let second = if pairs { pool.next().ok_or(short)? } else { Vec::new() };
                let off = [off_first, if pairs { off() } else { [0.0; 6] }];
                let last = |last| SimulateError::Workspace { found: k, wanted: count + plan.holdout, last };
                let mut readings = Vec::with_capacity(of_posture.len());
                for blank in of_posture {
                    let exact =
                        read_off(mechanism, truth, &**blank, [&actuators, &second], off).map_err(last)?;
                    let read = if noise > 0.0 { exact.perturbed(&mut normal) } else { exact };
                    readings.push((actuators.clone(), read));
                }
                readings
            };
            if k < *count { set.samples.extend(readings) } else { set.holdout.extend(readings) }
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
    touch_off(mechanism, geometry, blank, from, aim, &[0.0; 6])
}

/// The same where the tool is off by a twist `[w; dp]` (rad, m; {S} axes).
fn touch_off(
    mechanism: &Mechanism,
    geometry: &Geometry,
    blank: &dyn Measurement,
    from: Vec<f64>,
    aim: f64,
    off: &[f64; 6],
) -> Option<Vec<f64>> {
    let ranges = super::actuator_ranges(mechanism);
    let residual = |actuators: &[f64]| -> Option<f64> {
        let posture = close(mechanism, geometry, actuators).ok()?;
        let tool = moved(&posture.tool(), off);
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
