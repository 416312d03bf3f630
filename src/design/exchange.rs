//! Exact designs: exchange of one posture at a time (Fedorov 1972; docs/theory.md (11.7)).

use super::criterion::{Criterion, kept_block, workspace_variances};
use super::information::{Information, ROWS, inverse};
use faer::{Mat, Side};
use nalgebra::Matrix6;
use rand::SeedableRng;
use rand::seq::index::sample;
use rand_chacha::ChaCha8Rng;

/// Most rounds over all postures of a plan.
const ROUNDS: usize = 30;
/// Relative gain below which an exchange is not made.
const GAIN: f64 = 1e-9;
/// Candidates of largest smooth gain of which the exact gain is computed, where the worst case may change.
const SHORTLIST: usize = 8;

/// A set of candidates with the covariance that measuring them leaves.
struct Design<'a> {
    info: &'a Information,
    criterion: Criterion,
    covariance: Mat<f64>,
    /// `J_i C J_i'` of every candidate.
    spread: Vec<Matrix6<f64>>,
    /// Of A alone, whose `Q = root root'` does not change: `root`, and `J_i C Q C J_i'` of every candidate.
    fixed: Option<(Mat<f64>, Vec<Matrix6<f64>>)>,
}

impl<'a> Design<'a> {
    fn new(info: &'a Information, criterion: Criterion, chosen: &[usize]) -> Option<Self> {
        let covariance = inverse(&info.of(chosen))?;
        let spread = blocks(&info.rows, &(&info.rows * &covariance));
        let fixed = match criterion {
            Criterion::A => {
                let root = criterion.worst_case(info, &covariance)?.root;
                let seen = &info.rows * (&covariance * &root);
                let by_slope = blocks(&seen, &seen);
                Some((root, by_slope))
            }
            _ => None,
        };
        Some(Self { info, criterion, covariance, spread, fixed })
    }

    /// Adds (`sign` 1) or removes (-1) a posture by the formula of Sherman, Morrison and Woodbury; `None` where rounding
    /// has made that impossible.
    fn update(&mut self, candidate: usize, sign: f64) -> Option<()> {
        let middle = (Matrix6::identity() + self.spread[candidate] * sign).try_inverse()? * sign;
        let side = &self.covariance * self.info.columns(candidate);
        let seen = Blocks::of(&(&self.info.rows * &side));
        if let Some((root, by_slope)) = &mut self.fixed {
            // C Q C after C has become C - S m S', where S is `side`.
            let along = root.transpose() * &side;
            let turned = Blocks::of(&(&self.info.rows * (&self.covariance * (&*root * &along))));
            let own = along.transpose() * &along;
            let own = middle * Matrix6::from_fn(|a, b| own[(a, b)]) * middle;
            for (i, by_slope) in by_slope.iter_mut().enumerate() {
                let (s, t) = (seen.at(i), turned.at(i));
                let cross = s * middle * t.transpose();
                *by_slope += s * own * s.transpose() - cross - cross.transpose();
            }
        }
        for (i, spread) in self.spread.iter_mut().enumerate() {
            let by = seen.at(i);
            *spread -= by * middle * by.transpose();
        }
        let middle = Mat::from_fn(ROWS, ROWS, |i, j| middle[(i, j)]);
        self.covariance -= &side * middle * side.transpose();
        Some(())
    }

    /// What each candidate would add: the determinant lemma, or the trace of the same update with the present worst case.
    fn gains(&self) -> Option<Vec<f64>> {
        let one = Matrix6::identity();
        let traces = |by_slope: &[Matrix6<f64>]| -> Option<Vec<f64>> {
            let gain = |(spread, by): (&Matrix6<f64>, &Matrix6<f64>)| {
                Some(((one + spread).try_inverse()? * by).trace())
            };
            self.spread.iter().zip(by_slope).map(gain).collect()
        };
        match (self.criterion, &self.fixed) {
            (Criterion::D, _) => {
                Some(self.spread.iter().map(|spread| (one + spread).determinant().ln()).collect())
            }
            (_, Some((_, by_slope))) => traces(by_slope),
            (criterion, None) => {
                let worst = criterion.worst_case(self.info, &self.covariance)?;
                let seen = &self.info.rows * (&self.covariance * worst.root);
                traces(&blocks(&seen, &seen))
            }
        }
    }

    /// Of these candidates the one whose exact worst case, it being added, is the best and better than `value`, with that
    /// value.
    fn best_of(&self, candidates: impl Iterator<Item = usize>, value: f64) -> Option<Option<(usize, f64)>> {
        let mut best = None;
        let mut to_beat = value + GAIN * value.abs();
        let known = match self.criterion {
            Criterion::G => workspace_variances(self.info, &self.covariance),
            _ => Vec::new(),
        };
        for candidate in candidates {
            let middle = (Matrix6::identity() + self.spread[candidate]).try_inverse()?;
            let side = &self.covariance * self.info.columns(candidate);
            let reached = match self.criterion {
                Criterion::G => {
                    let seen = Blocks::of(&(&self.info.workspace * &side));
                    let less = |i: usize| (seen.at(i) * middle * seen.at(i).transpose()).trace();
                    let left = known.iter().enumerate().map(|(i, variance)| variance - less(i));
                    left.reduce(f64::max).map(|worst| -worst)
                }
                criterion => {
                    let middle = Mat::from_fn(ROWS, ROWS, |i, j| middle[(i, j)]);
                    let covariance = &self.covariance - &side * middle * side.transpose();
                    // A factorisation tells whether all eigenvalues are below the one to beat, far cheaper than they are.
                    let mut rest = kept_block(self.info, &covariance) * faer::Scale(-1.0);
                    (0..rest.nrows()).for_each(|i| rest[(i, i)] -= to_beat);
                    match rest.llt(Side::Lower) {
                        Ok(_) => criterion.exact_at(self.info, &covariance),
                        Err(_) => None,
                    }
                }
            };
            if let Some(reached) = reached.filter(|reached| *reached > to_beat) {
                best = Some((candidate, reached));
                to_beat = reached;
            }
        }
        Some(best)
    }
}

/// Blocks of [`ROWS`] by [`ROWS`] numbers under each other.
struct Blocks(Vec<[f64; ROWS * ROWS]>);

impl Blocks {
    /// Of a matrix with [`ROWS`] columns.
    fn of(a: &Mat<f64>) -> Self {
        let mut blocks = vec![[0.0; ROWS * ROWS]; a.nrows() / ROWS];
        for j in 0..ROWS {
            for (block, part) in blocks.iter_mut().zip(a.col_as_slice(j).chunks_exact(ROWS)) {
                block[ROWS * j..ROWS * (j + 1)].copy_from_slice(part);
            }
        }
        Self(blocks)
    }

    fn at(&self, i: usize) -> Matrix6<f64> {
        Matrix6::from_column_slice(&self.0[i])
    }
}

/// `A_i B_i'` for each posture.
fn blocks(a: &Mat<f64>, b: &Mat<f64>) -> Vec<Matrix6<f64>> {
    let mut out = vec![Matrix6::zeros(); a.nrows() / ROWS];
    for j in 0..a.ncols() {
        let parts = a.col_as_slice(j).chunks_exact(ROWS).zip(b.col_as_slice(j).chunks_exact(ROWS));
        for (block, (a, b)) in out.iter_mut().zip(parts) {
            for (column, b) in block.as_mut_slice().chunks_exact_mut(ROWS).zip(b) {
                column.iter_mut().zip(a).for_each(|(sum, a)| *sum += a * b);
            }
        }
    }
    out
}

/// Improves a set of `poses` candidates until no exchange of one of them gains: from the greedy set for `start` 0, from a
/// random one of this seed for all others. Ascending indices with their exact value; `None` where rounding defeats it.
pub fn exchange(
    info: &Information,
    criterion: Criterion,
    poses: usize,
    seed: u64,
    start: u64,
) -> Option<(Vec<usize>, f64)> {
    let mut chosen =
        if start == 0 { greedy(info, criterion, poses)? } else { random(info, poses, seed, start) };
    for _ in 0..ROUNDS {
        let mut design = Design::new(info, criterion, &chosen)?;
        let mut value = criterion.exact(info, &info.of(&chosen))?;
        let mut changed = false;
        for place in 0..poses {
            let old = chosen[place];
            design.update(old, -1.0)?;
            let new = best(&design, &chosen, old, &mut value)?;
            design.update(new, 1.0)?;
            chosen[place] = new;
            changed |= new != old;
        }
        if !changed {
            break;
        }
    }
    chosen.sort_unstable();
    let value = criterion.exact(info, &info.of(&chosen))?;
    Some((chosen, value))
}

/// The candidate to take in place of `old`, which has been removed: itself where no other gains. `value` is the exact one
/// with `old`, and then with the candidate that is returned.
fn best(design: &Design<'_>, chosen: &[usize], old: usize, value: &mut f64) -> Option<usize> {
    let gains = design.gains()?;
    let mut order: Vec<usize> = (0..gains.len()).filter(|i| *i == old || !chosen.contains(i)).collect();
    let by_gain = |a: &usize, b: &usize| gains[*b].total_cmp(&gains[*a]).then(a.cmp(b));
    let some = order.len().min(SHORTLIST + 1);
    if some < order.len() {
        order.select_nth_unstable_by(some, by_gain);
        order.truncate(some);
    }
    order.sort_unstable_by(by_gain);
    if design.criterion.is_smooth() {
        let first = order.first().copied().unwrap_or(old);
        return Some(if gains[first] > gains[old] * (1.0 + GAIN) + f64::EPSILON { first } else { old });
    }
    let others = order.into_iter().filter(|i| *i != old).take(SHORTLIST);
    Some(match design.best_of(others, *value)? {
        None => old,
        Some((candidate, reached)) => {
            *value = reached;
            candidate
        }
    })
}

/// One posture after the other, each the best of its turn.
fn greedy(info: &Information, criterion: Criterion, poses: usize) -> Option<Vec<usize>> {
    let mut design = Design::new(info, criterion, &[])?;
    let mut chosen = Vec::with_capacity(poses);
    for _ in 0..poses {
        let gains = design.gains()?;
        let free = (0..gains.len()).filter(|i| !chosen.contains(i));
        let next = free.max_by(|&a, &b| gains[a].total_cmp(&gains[b]).then(b.cmp(&a)))?;
        design.update(next, 1.0)?;
        chosen.push(next);
    }
    Some(chosen)
}

fn random(info: &Information, poses: usize, seed: u64, start: u64) -> Vec<usize> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(start);
    sample(&mut rng, info.count(), poses).into_vec()
}
