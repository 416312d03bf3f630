//! Huber's loss: quadratic up to a threshold, linear beyond, so that a gross error pulls no harder than a large one.

use super::here::{Here, Quadratic, complement};
use super::least_squares::pose_squares;
use super::loss::{Frame, Loss};
use super::program::{Owner, Program};
use crate::linalg;
use crate::statistics::median;

/// `r^2 / 2` for `|r| <= delta`, `delta (|r| - delta / 2)` beyond (Huber 1964).
#[derive(Clone, Copy, Debug)]
pub struct Huber {
    /// Threshold in units of the residual: standard deviations where it is whitened.
    pub delta: f64,
}

/// Share of the threshold from which a row is written out: it may cross during the step.
const NEAR: f64 = 0.9;
/// Standard deviation of a normal variable over the median of its magnitude.
const NORMAL_MEDIAN: f64 = 1.4826;

impl Loss for Huber {
    fn name(&self) -> &'static str {
        "huber"
    }

    fn merit(&self, r: &[f64]) -> f64 {
        r.iter()
            .map(|v| {
                let a = v.abs();
                if a <= self.delta { 0.5 * a * a } else { self.delta * (a - 0.5 * self.delta) }
            })
            .sum()
    }

    fn influence(&self, r: &[f64]) -> Vec<f64> {
        r.iter().map(|v| v.clamp(-self.delta, self.delta)).collect()
    }

    /// Far from the solution every row would be an outlier: the threshold follows the median until it is reached.
    fn at_scale(&self, r: &[f64]) -> Box<dyn Loss> {
        let spread = NORMAL_MEDIAN * median(r.iter().map(|v| v.abs())).unwrap_or(0.0);
        // Twice the spread of clean data is no reason to relax.
        Box::new(Huber { delta: if spread > 2.0 { self.delta * spread } else { self.delta } })
    }

    fn working_set(&self, here: &Here) -> Vec<usize> {
        (0..here.r.len()).filter(|&i| here.r[i].abs() > NEAR * self.delta).collect()
    }

    fn pose(&self, program: &mut Program, frame: &Frame, working: &[usize]) {
        let inliers = complement(working, frame.here.r.len());
        let summed = frame.here.compress(&inliers);
        pose_squares(program, frame, summed.jac.as_ref(), &summed.r);
        // Huber's loss is the least of v^2/2 + delta |w| with v + w = r.
        for &row in working {
            let inner = program.variable(1.0, 0.0);
            let above = program.variable(0.0, self.delta);
            let below = program.variable(0.0, self.delta);
            let step = (0..frame.unit.len()).map(|j| (j, frame.here.jac[(row, j)] * frame.unit[j]));
            let parts = [(inner, -1.0), (above, -1.0), (below, 1.0)];
            program.equal(step.chain(parts), -frame.here.r[row], Owner::Nobody);
        }
        let first = program.linear.len() - 3 * working.len();
        for index in 0..working.len() {
            program.at_most([(first + 3 * index + 1, -1.0)], 0.0, Owner::Nobody);
            program.at_most([(first + 3 * index + 2, -1.0)], 0.0, Owner::Nobody);
        }
    }

    fn missing(&self, predicted: &[f64], working: &[usize]) -> Vec<usize> {
        complement(working, predicted.len())
            .into_iter()
            .filter(|&i| predicted[i].abs() > self.delta)
            .collect()
    }

    fn quadratic(&self, here: &Here, predicted: &[f64]) -> Option<Quadratic> {
        let (inliers, outliers): (Vec<usize>, Vec<usize>) =
            (0..predicted.len()).partition(|&i| predicted[i].abs() <= self.delta);
        let summed = here.compress(&inliers);
        let mut pull = vec![0.0; here.r.len()];
        for i in outliers {
            pull[i] = self.delta.copysign(predicted[i]);
        }
        Some(Quadratic {
            jac: summed.jac,
            r: summed.r,
            linear: linalg::mul_transpose(here.jac.as_ref(), &pull),
        })
    }
}
