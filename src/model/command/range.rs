//! Ranges of the actuators, and by how much readings leave them.

use crate::model::joint::{Joint, Motion};
use crate::model::mechanism::Mechanism;
use std::f64::consts::TAU;

/// Part of a range by which rounding may leave it.
const SLACK: f64 = 1e-9;
/// Width of a range below which its joint is as good as locked, rad or machine sizes.
const LOCKED: f64 = 1e-3;
/// Where further searches begin if no range is drawn: to either side of home, rad of a joint that turns by whole turns, of
/// another one, and machine sizes.
const SPREAD: (f64, f64, f64) = (3.0, 0.5, 0.1);
/// The first primes: multiples of their square roots, taken modulo 1, spread evenly over a cube (Richtmyer).
const PRIMES: [f64; 16] =
    [2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0, 23.0, 29.0, 31.0, 37.0, 41.0, 43.0, 47.0, 53.0];

/// What is known of one actuator.
struct Limits {
    /// Joint variables (reading - home) between which it is used, rad or m.
    range: Option<(f64, f64)>,
    /// Width of the range in which excesses are measured, rad or m.
    width: f64,
    /// Half of the spread of starts where there is no range, rad or m.
    spread: f64,
    /// A revolute joint: readings that differ by whole turns place it alike.
    turns: bool,
}

/// Ranges of all actuators.
pub(super) struct Ranges {
    limits: Vec<Limits>,
    /// Whether readings that differ by whole turns make the same pose: along an open chain. Where loops close, the way
    /// from home decides.
    pub(super) open: bool,
}

impl Ranges {
    pub(super) fn of(mechanism: &Mechanism) -> Self {
        let (open, length) = (mechanism.is_open_chain(), mechanism.characteristic_length());
        let joints = mechanism.limbs.iter().flat_map(|limb| &limb.joints).filter(|joint| joint.actuated);
        let limits = joints.map(|joint: &Joint| {
            let turns = joint.motion == Motion::Revolute;
            let unit = if joint.motion.is_angular() { 1.0 } else { length };
            let range = joint.range.map(|(low, high)| (low - joint.home, high - joint.home));
            let spread = match (joint.motion.is_angular(), open && turns) {
                (_, true) => SPREAD.0,
                (true, false) => SPREAD.1,
                (false, false) => SPREAD.2 * length,
            };
            Limits {
                width: range.map_or(unit, |(low, high)| (high - low).max(LOCKED * unit)),
                range,
                spread,
                turns,
            }
        });
        Self { limits: limits.collect(), open }
    }

    /// Whether every actuator is within its range, but for rounding.
    pub(super) fn hold(&self, actuators: &[f64]) -> bool {
        self.excess(actuators) <= SLACK
    }

    /// Largest distance from the inside of its range, in widths of the range.
    pub(super) fn excess(&self, actuators: &[f64]) -> f64 {
        let each = self.limits.iter().zip(actuators).map(|(limits, value)| limits.outside(*value, 0.0).abs());
        each.fold(0.0, f64::max)
    }

    /// What every actuator has to move by to be inside its range and a part `margin` of the width away from the ends, in
    /// widths; joints of an open chain by whole turns as near to it as may be.
    pub(super) fn inward(&self, actuators: &[f64], margin: f64) -> Vec<f64> {
        let each = self.limits.iter().zip(actuators);
        each.map(|(limits, value)| -limits.outside(limits.turned(*value, self.open), margin)).collect()
    }

    /// Width of range of actuator `i`, rad or m.
    pub(super) fn width(&self, i: usize) -> f64 {
        self.limits[i].width
    }

    /// The same place by whole turns of revolute joints: within the ranges, and there as near to `near` as may be.
    pub(super) fn turned(&self, actuators: &[f64], near: &[f64]) -> Vec<f64> {
        let turn = |((limits, q), near): ((&Limits, &f64), &f64)| {
            if !limits.turns {
                return *q;
            }
            let nearest = q - TAU * ((q - near) / TAU).round();
            match limits.range {
                Some((low, _)) if nearest < low => {
                    limits.best_of(nearest + TAU * ((low - nearest) / TAU).ceil(), -TAU)
                }
                Some((_, high)) if nearest > high => {
                    limits.best_of(nearest - TAU * ((nearest - high) / TAU).ceil(), TAU)
                }
                _ => nearest,
            }
        };
        self.limits.iter().zip(actuators).zip(near).map(turn).collect()
    }

    /// Start number `attempt` of a further search, 1 is the middle of all ranges.
    pub(super) fn start(&self, attempt: usize) -> Vec<f64> {
        let value = |(index, limits): (usize, &Limits)| {
            let step = PRIMES[index % PRIMES.len()].sqrt() + (index / PRIMES.len()) as f64 * 0.1;
            let share = (0.5 + (attempt - 1) as f64 * step).fract();
            let (low, high) = limits.range.unwrap_or((-limits.spread, limits.spread));
            low + share * (high - low)
        };
        self.limits.iter().enumerate().map(value).collect()
    }
}

impl Limits {
    /// How far beyond an end of the range, narrowed by the part `margin` of it on either side; negative below, in widths.
    fn outside(&self, value: f64, margin: f64) -> f64 {
        let Some((low, high)) = self.range else { return 0.0 };
        let inset = margin * (high - low);
        let beyond = (value - (high - inset)).max(0.0) + (value - (low + inset)).min(0.0);
        beyond / self.width
    }

    /// The same place by the whole turns that bring it nearest to the middle of its range.
    fn turned(&self, value: f64, open: bool) -> f64 {
        match self.range {
            Some((low, high)) if open && self.turns => {
                value - TAU * ((value - 0.5 * (low + high)) / TAU).round()
            }
            _ => value,
        }
    }

    /// `value` or, one turn on, whichever is less outside.
    fn best_of(&self, value: f64, turn: f64) -> f64 {
        let other = value + turn;
        if self.outside(other, 0.0).abs() < self.outside(value, 0.0).abs() { other } else { value }
    }
}

/// Indices of the actuators whose reading leaves the range of the drawing, by more than rounding.
pub fn outside_range(mechanism: &Mechanism, actuators: &[f64]) -> Vec<usize> {
    beyond_range(mechanism, actuators).into_iter().map(|(i, _)| i).collect()
}

/// Actuators whose reading leaves the range of the drawing by more than rounding: their indices, and by how much, rad or
/// m; negative below the range.
pub fn beyond_range(mechanism: &Mechanism, actuators: &[f64]) -> Vec<(usize, f64)> {
    let ranges = Ranges::of(mechanism);
    let outside =
        |(i, (limits, value)): (usize, (&Limits, &f64))| (i, limits.outside(*value, 0.0), limits.width);
    let each = ranges.limits.iter().zip(actuators).enumerate().map(outside);
    each.filter(|(_, parts, _)| parts.abs() > SLACK).map(|(i, parts, width)| (i, parts * width)).collect()
}
