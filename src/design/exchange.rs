//! Exact designs: exchange of one posture at a time (Fedorov 1972; docs/theory.md (11.7)).

use super::criterion::Criterion;
use super::information::{Information, ROWS, inverse};
use faer::Mat;
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
    covariance: Mat<f64>,
    /// `J_i C J_i'` of every candidate.
    spread: Vec<Matrix6<f64>>,
}

impl<'a> Design<'a> {
    fn new(info: &'a Information, chosen: &[usize]) -> Option<Self> {
        let covariance = inverse(&info.of(chosen))?;
        let spread = blocks(&info.rows, &(&info.rows * &covariance));
        Some(Self { info, covariance, spread })
    }

    /// Adds (`sign` 1) or removes (-1) a posture by the formula of Sherman, Morrison and Woodbury; `None` where rounding
    /// has made that impossible.
    fn update(&mut self, candidate: usize, sign: f64) -> Option<()> {
        let middle = (Matrix6::identity() + self.spread[candidate] * sign).try_inverse()? * sign;
        let side = &self.covariance * self.info.columns(candidate);
        let seen = &self.info.rows * &side;
        for (i, spread) in self.spread.iter_mut().enumerate() {
            let by = Matrix6::from_fn(|a, b| seen[(ROWS * i + a, b)]);
            *spread -= by * middle * by.transpose();
        }
        let middle = Mat::from_fn(ROWS, ROWS, |i, j| middle[(i, j)]);
        self.covariance -= &side * middle * side.transpose();
        Some(())
    }

    /// Covariance with one posture more.
    fn with(&self, candidate: usize) -> Option<Mat<f64>> {
        let middle = (Matrix6::identity() + self.spread[candidate]).try_inverse()?;
        let middle = Mat::from_fn(ROWS, ROWS, |i, j| middle[(i, j)]);
        let side = &self.covariance * self.info.columns(candidate);
        Some(&self.covariance - &side * middle * side.transpose())
    }

    /// What each candidate would add: the determinant lemma, or the trace of the same update with the present worst case.
    fn gains(&self, criterion: Criterion) -> Option<Vec<f64>> {
        let one = Matrix6::identity();
        if criterion == Criterion::D {
            return Some(self.spread.iter().map(|spread| (one + spread).determinant().ln()).collect());
        }
        let slope = criterion.slope_at(self.info, &self.covariance)?;
        let by_slope = blocks(&self.info.rows, &(&self.info.rows * slope));
        let gain =
            |(spread, by): (&Matrix6<f64>, &Matrix6<f64>)| Some(((one + spread).try_inverse()? * by).trace());
        self.spread.iter().zip(&by_slope).map(gain).collect()
    }
}

/// `A_i B_i'` for each posture.
fn blocks(a: &Mat<f64>, b: &Mat<f64>) -> Vec<Matrix6<f64>> {
    let mut out = vec![Matrix6::zeros(); a.nrows() / ROWS];
    for j in 0..a.ncols() {
        let (a, b) = (a.col(j), b.col(j));
        for (i, block) in out.iter_mut().enumerate() {
            for q in 0..ROWS {
                for p in 0..ROWS {
                    block[(p, q)] += a[ROWS * i + p] * b[ROWS * i + q];
                }
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
        let mut design = Design::new(info, &chosen)?;
        let mut value = criterion.exact(info, &info.of(&chosen))?;
        let mut changed = false;
        for place in 0..poses {
            let old = chosen[place];
            design.update(old, -1.0)?;
            let new = best(&design, criterion, &chosen, old, &mut value)?;
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
fn best(
    design: &Design<'_>,
    criterion: Criterion,
    chosen: &[usize],
    old: usize,
    value: &mut f64,
) -> Option<usize> {
    let gains = design.gains(criterion)?;
    let mut order: Vec<usize> = (0..gains.len()).filter(|i| *i == old || !chosen.contains(i)).collect();
    order.sort_unstable_by(|&a, &b| gains[b].total_cmp(&gains[a]).then(a.cmp(&b)));
    if criterion.is_smooth() {
        let first = order.first().copied().unwrap_or(old);
        return Some(if gains[first] > gains[old] * (1.0 + GAIN) + f64::EPSILON { first } else { old });
    }
    let mut best = old;
    for &candidate in order.iter().filter(|i| **i != old).take(SHORTLIST) {
        let reached = criterion.exact_at(design.info, &design.with(candidate)?)?;
        if reached > *value + GAIN * value.abs() {
            (best, *value) = (candidate, reached);
        }
    }
    Some(best)
}

/// One posture after the other, each the best of its turn.
fn greedy(info: &Information, criterion: Criterion, poses: usize) -> Option<Vec<usize>> {
    let mut design = Design::new(info, &[])?;
    let mut chosen = Vec::with_capacity(poses);
    for _ in 0..poses {
        let gains = design.gains(criterion)?;
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

/// Exact values of random sets of `poses` candidates: what a plan is to be compared with.
pub fn random_values(
    info: &Information,
    criterion: Criterion,
    poses: usize,
    seed: u64,
    sets: usize,
) -> Vec<(Vec<usize>, f64)> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut value = |_| {
        let chosen = sample(&mut rng, info.count(), poses).into_vec();
        let value = criterion.exact(info, &info.of(&chosen))?;
        Some((chosen, value))
    };
    (0..sets).filter_map(&mut value).collect()
}
