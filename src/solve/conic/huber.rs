//! Huber's loss: quadratic up to a threshold, linear beyond, so that a gross error pulls no harder than a large one.

use super::here::{Here, Quadratic, complement};
use super::least_squares::pose_squares;
use super::loss::{Frame, Loss};
use super::program::{Owner, Program};
use crate::linalg::{self, dot, norm};
use crate::statistics::median;
use faer::Mat;
use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

/// `s^2 / 2` for `s <= t`, `t (s - t / 2)` beyond (Huber 1964), `s` the norm of rows that were measured together and
/// `t = delta sqrt(rows)`: rows are components in some frame, their norm is the same in all. Rows behind the last block
/// are a prior's, which stays quadratic.
#[derive(Clone, Debug)]
pub struct Huber {
    /// Threshold on the root mean square of a block, in units of the residual: standard deviations where it is whitened.
    pub delta: f64,
    /// Rows that were measured together, in order; `None` where every row stands for itself.
    pub blocks: Option<Arc<[Range<usize>]>>,
}

/// Share of the threshold from which a block is written out: it may cross during the step.
const NEAR: f64 = 0.9;
/// Standard deviation of a normal variable over the median of its magnitude.
const NORMAL_MEDIAN: f64 = 1.4826;

/// Standard deviation of a normal variable over the median of the norm of `m` such (Wilson and Hilferty 1931).
fn over_median(m: usize) -> f64 {
    let rows = m as f64;
    if m == 1 { NORMAL_MEDIAN } else { (rows * (1.0 - 2.0 / (9.0 * rows)).powi(3)).powf(-0.5) }
}

impl Huber {
    fn blocks(&self, rows: usize) -> Cow<'_, [Range<usize>]> {
        match &self.blocks {
            Some(blocks) => Cow::Borrowed(blocks),
            None => Cow::Owned((0..rows).map(|i| i..i + 1).collect()),
        }
    }

    fn threshold(&self, block: &Range<usize>) -> f64 {
        self.delta * (block.len() as f64).sqrt()
    }

    /// The blocks whose norm in `r` is above `share` of the threshold.
    fn beyond(&self, r: &[f64], share: f64) -> Vec<usize> {
        let blocks = self.blocks(r.len());
        let is_beyond = |b: &usize| norm(&r[blocks[*b].clone()]) > share * self.threshold(&blocks[*b]);
        (0..blocks.len()).filter(is_beyond).collect()
    }

    /// The rows of all blocks but these, and of the prior.
    fn others(&self, rows: usize, blocks: &[usize]) -> Vec<usize> {
        let all = self.blocks(rows);
        let in_blocks: Vec<usize> = blocks.iter().flat_map(|&b| all[b].clone()).collect();
        complement(&in_blocks, rows)
    }
}

impl Loss for Huber {
    fn name(&self) -> &'static str {
        "huber"
    }

    fn arranged(&self, blocks: &[Range<usize>], rows: usize, prior: usize) -> Box<dyn Loss> {
        let blocks = match blocks.is_empty() {
            true => (0..rows.saturating_sub(prior)).map(|i| i..i + 1).collect(),
            false => blocks.into(),
        };
        Box::new(Self { delta: self.delta, blocks: Some(blocks) })
    }

    fn merit(&self, r: &[f64]) -> f64 {
        let blocks = self.blocks(r.len());
        let of_block = |block: &Range<usize>| {
            let (size, threshold) = (norm(&r[block.clone()]), self.threshold(block));
            if size <= threshold { 0.5 * size * size } else { threshold * (size - 0.5 * threshold) }
        };
        let behind = blocks.last().map_or(0, |last| last.end);
        blocks.iter().map(of_block).sum::<f64>() + crate::problem::cost(&r[behind..])
    }

    fn influence(&self, r: &[f64]) -> Vec<f64> {
        let mut influence = r.to_vec();
        let blocks = self.blocks(r.len());
        for b in self.beyond(r, 1.0) {
            let rows = &mut influence[blocks[b].clone()];
            let shrunk = self.threshold(&blocks[b]) / norm(rows);
            rows.iter_mut().for_each(|v| *v *= shrunk);
        }
        influence
    }

    /// Far from the solution every block would be an outlier: the threshold follows the median, in which a block counts by
    /// its rows, until it is reached.
    fn at_scale(&self, r: &[f64]) -> Box<dyn Loss> {
        let spreads = self.blocks(r.len()).to_vec().into_iter().flat_map(|block| {
            let (rows, size) = (block.len(), norm(&r[block]));
            std::iter::repeat_n(over_median(rows) * size, rows)
        });
        let spread = median(spreads).unwrap_or(0.0);
        // Twice the spread of clean data is no reason to relax.
        let delta = if spread > 2.0 { self.delta * spread } else { self.delta };
        Box::new(Self { delta, blocks: self.blocks.clone() })
    }

    fn working_set(&self, here: &Here) -> Vec<usize> {
        self.beyond(&here.r, NEAR)
    }

    fn pose(&self, program: &mut Program, frame: &Frame, working: &[usize]) {
        let here = frame.here;
        let summed = here.compress(&self.others(here.r.len(), working));
        pose_squares(program, frame, summed.jac.as_ref(), &summed.r);
        // Huber's loss is the least of |v|^2/2 + t |w| with v + w = r.
        let blocks = self.blocks(here.r.len());
        let mut outer = Vec::new();
        for &b in working {
            let length = program.variable(0.0, self.threshold(&blocks[b]));
            let mut parts = Vec::new();
            for row in blocks[b].clone() {
                let (inner, beyond) = (program.variable(1.0, 0.0), program.variable(0.0, 0.0));
                let step = (0..frame.unit.len()).map(|j| (j, here.jac[(row, j)] * frame.unit[j]));
                program.equal(step.chain([(inner, -1.0), (beyond, -1.0)]), -here.r[row], Owner::Nobody);
                parts.push((beyond, 1.0, 0.0));
            }
            outer.push((length, parts));
        }
        for (length, parts) in outer {
            program.within((Some((length, 1.0)), 0.0), parts, Owner::Nobody);
        }
    }

    fn missing(&self, predicted: &[f64], working: &[usize]) -> Vec<usize> {
        self.beyond(predicted, 1.0).into_iter().filter(|b| working.binary_search(b).is_err()).collect()
    }

    /// A norm is bent across itself: `t / s (1 - e e')`, `e` the direction of the block.
    fn quadratic(&self, here: &Here, predicted: &[f64]) -> Option<Quadratic> {
        let beyond = self.beyond(predicted, 1.0);
        let summed = here.compress(&self.others(predicted.len(), &beyond));
        let blocks = self.blocks(predicted.len());
        let mut pull = vec![0.0; here.r.len()];
        let (mut jac, mut r) = (summed.jac, summed.r);
        for b in beyond {
            let rows = blocks[b].clone();
            let (size, threshold) = (norm(&predicted[rows.clone()]), self.threshold(&rows));
            let unit: Vec<f64> = predicted[rows.clone()].iter().map(|v| v / size).collect();
            pull[rows.clone()].iter_mut().zip(&unit).for_each(|(pull, u)| *pull = threshold * u);
            if rows.len() == 1 {
                continue;
            }
            let bend = (threshold / size).sqrt();
            let across = |of: &[f64]| -> Vec<f64> {
                let along = dot(&unit, of);
                of.iter().zip(&unit).map(|(v, u)| bend * (v - along * u)).collect()
            };
            let mut turned = Mat::zeros(rows.len(), here.x.len());
            for j in 0..here.x.len() {
                let column: Vec<f64> = rows.clone().map(|i| here.jac[(i, j)]).collect();
                turned.col_as_slice_mut(j).copy_from_slice(&across(&column));
            }
            // The block itself has nothing across itself where it is predicted.
            r.extend(across(&here.r[rows]));
            jac = faer::concat![[jac], [turned]];
        }
        let linear = linalg::mul_transpose(here.jac.as_ref(), &pull);
        Some(Quadratic { jac, r, linear })
    }
}
