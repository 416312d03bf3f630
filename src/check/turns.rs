//! Whole turns that readings of screws lack where a controller counts within one turn: the tool is then a few pitches off.
//!
//! A turn more or less of a revolute joint is the same posture, so that there is nothing to put right.

use super::alignment::align;
use super::misfit::misfits;
use super::observed::{Observed, Seen};
use super::prediction::Predictor;
use super::reading::{Reading, postures};
use crate::identify::registration::FreeEnds;
use crate::measure::Point;
use crate::model::{Joint, Mechanism, Motion};
use std::f64::consts::{PI, TAU};

/// Most turns that are sought.
const MOST: i32 = 200;
/// Rounds in which free ends are placed and turns counted.
const ROUNDS: usize = 3;
/// Misfit of a posture, as a factor, below which other turns are believed.
const BETTER: f64 = 0.7;
/// Readings beyond one turn by as much, rad, are no rounding.
const ROUNDING: f64 = 1e-6;

/// The actuators whose readings look counted within one turn, and that are screws.
pub(super) fn within_one_turn(joints: &[&Joint], data: &[Reading]) -> Vec<usize> {
    let within = |i: usize, low: f64, high: f64| {
        data.iter().all(|reading| {
            reading.actuators.get(i).is_some_and(|v| (low - ROUNDING..=high + ROUNDING).contains(v))
        })
    };
    let wraps = |(i, joint): &(usize, &&Joint)| {
        let beyond = joint.range.is_none_or(|(low, high)| {
            let (from, to) = if within(*i, -PI, PI) { (-PI, PI) } else { (0.0, TAU) };
            low < from - ROUNDING || high > to + ROUNDING
        });
        let screw = matches!(joint.motion, Motion::Helical { advance } if advance != 0.0);
        screw && beyond && (within(*i, -PI, PI) || within(*i, 0.0, TAU))
    };
    joints.iter().enumerate().filter(wraps).map(|(i, _)| i).collect()
}

/// The readings with the turns that bring each posture nearest to what was seen of it; `None` where no poses were seen.
pub(super) fn unwrapped(mechanism: &Mechanism, data: &[Reading], which: &[usize]) -> Option<Vec<Reading>> {
    let of = postures(data);
    let observed = Observed::new(mechanism, data, &of)?;
    let Seen::Poses(poses) = &observed.seen else { return None };
    let free = FreeEnds::of(mechanism);
    let free = FreeEnds { tool: free.tool || observed.loose, ..free };
    // A reading a posture, of the pose that was seen.
    let mut each: Vec<Reading> = Vec::with_capacity(of.len());
    for (list, pose) in of.iter().zip(poses) {
        let first = data.get(*list.first()?)?;
        let position = pose.map_or(first.position, |pose| pose.p);
        let rotation = pose.map(|pose| pose.r);
        each.push(Reading { position, rotation, target: Point::default(), ..first.clone() });
    }
    let moved = free.base || free.tool;
    for _ in 0..if moved { ROUNDS } else { 1 } {
        let mut machine = mechanism.clone();
        if moved {
            let variables: Vec<Vec<f64>> = each.iter().map(|reading| reading.variables(mechanism)).collect();
            let ends = align(&Predictor::new(mechanism).tools(&variables), &observed, free)?.ends;
            machine = mechanism.relocated(&ends.0, &ends.1);
        }
        let seen = each.iter_mut().zip(poses).filter(|(_, pose)| pose.is_some());
        seen.for_each(|(reading, _)| counted(&machine, reading, which));
    }
    let mut all = data.to_vec();
    for (list, reading) in of.iter().zip(&each) {
        for k in list {
            all.get_mut(*k)?.actuators.clone_from(&reading.actuators);
        }
    }
    Some(all)
}

/// Counts the turns of one posture, screw by screw.
fn counted(mechanism: &Mechanism, reading: &mut Reading, which: &[usize]) {
    let misfit = |reading: &Reading| {
        misfits(mechanism, std::slice::from_ref(reading)).first().copied().unwrap_or(f64::INFINITY)
    };
    let as_read = (reading.clone(), misfit(reading));
    let mut least = as_read.1;
    for i in which {
        for sign in [1.0, -1.0] {
            let before = least;
            for _ in 0..MOST {
                let mut next = reading.clone();
                let Some(value) = next.actuators.get_mut(*i) else { return };
                *value += sign * TAU;
                let there = misfit(&next);
                if there.is_nan() || there >= least {
                    break;
                }
                (*reading, least) = (next, there);
            }
            if least < before {
                break;
            }
        }
    }
    if least > BETTER * as_read.1 {
        *reading = as_read.0;
    }
}
