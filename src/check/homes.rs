//! Readings at home that data ask for: offsets that bring predicted and observed postures together, base and tool moved
//! along where they are free.

use super::alignment::{Alignment, Error, align};
use super::observed::Observed;
use super::prediction::Predictor;
use crate::identify::registration::FreeEnds;
use crate::linalg;
use faer::Mat;

/// Steps of Gauss-Newton.
const STEPS: usize = 8;
/// Step of difference quotients, rad or machine sizes.
const DIFFERENCE: f64 = 1e-5;
/// Longest step, rad or machine sizes.
const LONGEST: f64 = 0.5;
/// Relative decrease at which it ends.
const SETTLED: f64 = 1e-3;
/// Singular values, relative to the largest, below which a combination of homes is left alone.
const SMALLEST: f64 = 1e-4;

/// What homes are sought with.
pub(super) struct Homes<'a> {
    pub predictor: &'a Predictor<'a>,
    pub observed: &'a Observed,
    pub free: FreeEnds,
    /// Joint variables of the postures, rad or m.
    pub variables: &'a [Vec<f64>],
    /// Of each actuator what one unit of its offset is, rad or m: 1 rad or a machine size.
    pub units: &'a [f64],
}

impl Homes<'_> {
    fn at(&self, which: &[usize], offsets: &[f64]) -> Option<Alignment> {
        let moved: Vec<Vec<f64>> = self
            .variables
            .iter()
            .map(|at| {
                let mut at = at.clone();
                for (&i, offset) in which.iter().zip(offsets) {
                    at[i] += offset * self.units[i];
                }
                at
            })
            .collect();
        align(&self.predictor.tools(&moved), self.observed, self.free)
    }

    /// Offsets (rad, m) of the readings of the actuators `which`, from those given, and the alignment that they leave;
    /// `None` where too few postures close.
    pub fn found(&self, which: &[usize], from: &[f64]) -> Option<(Vec<f64>, Alignment)> {
        let mut offsets: Vec<f64> = which.iter().zip(from).map(|(&i, v)| v / self.units[i]).collect();
        let mut here = self.at(which, &offsets)?;
        for _ in 0..STEPS {
            let Some(step) = self.step(which, &offsets, &here) else { break };
            let longest = step.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            let mut fraction = (LONGEST / longest.max(LONGEST)).min(1.0);
            let better = loop {
                let next: Vec<f64> = offsets.iter().zip(&step).map(|(o, s)| o + fraction * s).collect();
                if let Some(there) = self.at(which, &next).filter(|there| there.rms() < here.rms()) {
                    break Some((next, there));
                }
                fraction *= 0.25;
                if fraction < 0.01 {
                    break None;
                }
            };
            let Some((next, there)) = better else { break };
            let settled = there.rms() > (1.0 - SETTLED) * here.rms();
            (offsets, here) = (next, there);
            if settled {
                break;
            }
        }
        Some((which.iter().zip(&offsets).map(|(&i, v)| v * self.units[i]).collect(), here))
    }

    fn step(&self, which: &[usize], offsets: &[f64], here: &Alignment) -> Option<Vec<f64>> {
        let rows = 6 * here.errors.len();
        let r: Vec<f64> = here.errors.iter().flat_map(|(_, e)| *e).collect();
        let mut jac = Mat::zeros(rows, which.len());
        for column in 0..which.len() {
            let mut moved = offsets.to_vec();
            moved[column] += DIFFERENCE;
            let there = self.at(which, &moved)?;
            // Postures that close here only say nothing of the slope.
            for (row, (k, error)) in here.errors.iter().enumerate() {
                let Some(other) = error_of(&there, *k) else { continue };
                for i in 0..6 {
                    jac[(6 * row + i, column)] = (other[i] - error[i]) / DIFFERENCE;
                }
            }
        }
        linalg::pseudo_inverse_step(jac.as_ref(), &r, SMALLEST)
    }
}

fn error_of(alignment: &Alignment, posture: usize) -> Option<&Error> {
    let at = alignment.errors.binary_search_by_key(&posture, |(k, _)| *k).ok()?;
    alignment.errors.get(at).map(|(_, error)| error)
}
