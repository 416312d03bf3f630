//! Whether the deviations are as large as the stated tolerances make them: the marginal likelihood of a common factor on
//! all tolerances (docs/theory.md (10.17)-(10.19)).

use super::counts::Visibility;
use crate::calibration::Calibration;
use crate::linalg;
use crate::model::{Mechanism, Prior, Tolerance};
use crate::problem::{EvalError, Problem};
use faer::Mat;
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Probability of a false alarm up to which the stated tolerances are contradicted.
const REMARKABLE: f64 = 1e-3;
/// Signal-to-noise ratio below which a direction says nothing of a factor near 1, while what is left of the residual
/// there, divided by it, is mostly the second order.
const FAINT: f64 = 0.3;
/// Factors among which the most likely one is sought.
const FACTORS: (f64, f64) = (1e-3, 1e6);
/// Steps of the search before the best of them is refined, a factor of 1.5 each.
const STEPS: usize = 52;
/// Fall of the logarithm of the likelihood at the ends of a 95 % interval: half the quantile of chi-square, one degree of
/// freedom.
const FALL: f64 = 1.9207;

/// What tells of a factor on the tolerances: independent numbers, each a deviation seen through noise.
///
/// Under tolerances `F` times as stated `readings[k]` has the variance `noise^2 + F^2 strengths[k]^2`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Evidence {
    /// Signal-to-noise ratio of each direction, a deviation of one tolerance being the signal.
    pub strengths: Vec<f64>,
    /// What was read along it, in standard deviations of the stated noise.
    pub readings: Vec<f64>,
}

/// What the deviations say of the stated tolerances.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ToleranceVerdict {
    /// They explain the deviations.
    Explained,
    /// The deviations are larger.
    TooSmall,
    /// The deviations are smaller.
    TooLarge,
}

/// Test of the stated tolerances by the deviations in the directions that the data decide.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToleranceTest {
    /// Most likely factor on the stated tolerances.
    pub factor: f64,
    /// Its 95 % interval, by the likelihood.
    pub interval: (f64, f64),
    /// Probability that tolerances as stated make deviations as large, or larger.
    pub probability: f64,
    /// Directions that the data know better than the stated tolerances.
    pub directions: usize,
    /// Factor under which estimate, standard errors and predictions are: 1 where the tolerances are trusted as stated.
    pub in_force: f64,
    /// What follows.
    pub verdict: ToleranceVerdict,
}

impl Evidence {
    /// At the point `x` of a problem in minimal coordinates, of which `seen` has the directions; linearised there. Where
    /// links, motions that all limbs share or constants of the instrument are free, directions that could be theirs say nothing of tolerances and are projected out.
    pub fn at(
        mechanism: &Mechanism,
        problem: &Calibration<'_>,
        x: &[f64],
        seen: &Visibility,
    ) -> Result<Self, EvalError> {
        let components = problem.coordinates().by_components(mechanism);
        if components.iter().any(|(prior, _)| *prior == Prior::Free) {
            return Self::beside_free(&components, problem, x);
        }
        let (_, gradient) = problem.gradient(x)?;
        let (along, pull) = (
            linalg::mul_transpose(seen.directions.as_ref(), x),
            linalg::mul_transpose(seen.directions.as_ref(), &gradient),
        );
        let mut evidence = Self::default();
        for ((s, along), pull) in seen.singular_values.iter().zip(along).zip(pull) {
            if *s >= FAINT {
                evidence.strengths.push(*s);
                evidence.readings.push(s * along - pull / s);
            }
        }
        Ok(evidence)
    }

    fn beside_free(
        components: &[(Prior, Vec<f64>)],
        problem: &Calibration<'_>,
        x: &[f64],
    ) -> Result<Self, EvalError> {
        let here = problem.compress(x)?;
        let not_finite = || EvalError("the whitened Jacobian is not finite".into());
        let of = |free: bool| {
            let columns = components.iter().filter(|(prior, _)| (*prior == Prior::Free) == free);
            let columns: Vec<&Vec<f64>> = columns.map(|(_, column)| column).collect();
            Mat::from_fn(x.len(), columns.len(), |i, j| columns[j][i])
        };
        let (stated, free) = (of(false), of(true));
        let mut by_stated = &here.jac * &stated;
        let moved = linalg::mul(here.jac.as_ref(), x);
        let mut read = Mat::from_fn(here.r.len(), 1, |i, _| moved[i] - here.r[i]);
        let svd = linalg::svd((&here.jac * &free).as_ref()).ok_or_else(not_finite)?;
        let seen = svd.s.iter().filter(|s| **s > 1.0).count().min(svd.u.ncols());
        let theirs = svd.u.get(.., ..seen);
        by_stated -= theirs * (theirs.transpose() * &by_stated);
        read -= theirs * (theirs.transpose() * &read);
        let svd = linalg::svd(by_stated.as_ref()).ok_or_else(not_finite)?;
        let along = svd.u.transpose() * read;
        let told = (0..svd.s.len().min(svd.u.ncols())).filter(|&k| svd.s[k] >= FAINT);
        let (strengths, readings) = told.map(|k| (svd.s[k], along[(k, 0)])).unzip();
        Ok(Self { strengths, readings })
    }

    /// Logarithm of the marginal likelihood of a factor, but for a constant; `noise` is the noise as a multiple of what was
    /// stated.
    pub fn likelihood(&self, factor: f64, noise: f64) -> f64 {
        let each = self.strengths.iter().zip(&self.readings).map(|(s, y)| {
            let variance = noise * noise + (factor * s).powi(2);
            variance.ln() + y * y / variance
        });
        -0.5 * each.sum::<f64>()
    }

    /// The test of tolerances that are `stated` times those in which the evidence counts; `None` where no direction is
    /// decided.
    pub fn test(&self, noise: f64, stated: f64) -> Option<ToleranceTest> {
        let strengths = || self.strengths.iter().map(|s| s * stated);
        let directions = strengths().filter(|s| *s > noise).count();
        let finite = self.readings.iter().chain(&self.strengths).all(|v| v.is_finite());
        if directions == 0 || !finite || !(noise > 0.0 && noise.is_finite()) {
            return None;
        }
        // The score at the stated tolerances: a sum of chi-square variables of one degree of freedom, each by its weight,
        // here a multiple of chi-square with the same mean and variance (Satterthwaite, Biometrics Bulletin 2, 1946).
        let (mut sum, mut mean, mut square) = (0.0, 0.0, 0.0);
        // Of directions that the data decide: the others have small weights each, and of many such the law is no multiple of
        // chi-square in its tail.
        for (s, y) in strengths().zip(&self.readings).filter(|(s, _)| *s > noise) {
            let variance = noise * noise + s * s;
            let weight = s * s / variance;
            sum += weight * y * y / variance;
            mean += weight;
            square += weight * weight;
        }
        let law = ChiSquared::new(mean * mean / square).ok()?;
        let sum = sum * mean / square;
        let probability = law.sf(sum);
        let verdict = if probability < REMARKABLE {
            ToleranceVerdict::TooSmall
        } else if law.cdf(sum) < REMARKABLE {
            ToleranceVerdict::TooLarge
        } else {
            ToleranceVerdict::Explained
        };
        let (factor, interval) = self.most_likely(noise);
        let interval = (interval.0 / stated, interval.1 / stated);
        Some(ToleranceTest {
            factor: factor / stated,
            interval,
            probability,
            directions,
            in_force: 1.0,
            verdict,
        })
    }

    /// The most likely factor and its 95 % interval.
    fn most_likely(&self, noise: f64) -> (f64, (f64, f64)) {
        let (low, high) = (FACTORS.0.ln(), FACTORS.1.ln());
        let step = (high - low) / STEPS as f64;
        let at = |log: f64| self.likelihood(log.exp(), noise);
        let tried = (0..=STEPS).map(|k| low + step * k as f64).map(|log| (log, at(log)));
        let best = tried.max_by(|a, b| a.1.total_cmp(&b.1)).map_or(0.0, |(log, _)| log);
        // Golden section between the neighbours of the best.
        let golden = 0.5 * (5f64.sqrt() - 1.0);
        let (mut a, mut b) = ((best - step).max(low), (best + step).min(high));
        while b - a > 1e-4 {
            let (c, d) = (b - golden * (b - a), a + golden * (b - a));
            if at(c) >= at(d) { b = d } else { a = c }
        }
        let (best, least) = (0.5 * (a + b), at(0.5 * (a + b)) - FALL);
        let end = |limit: f64| {
            if at(limit) >= least {
                return limit;
            }
            let (mut inside, mut outside) = (best, limit);
            while (inside - outside).abs() > 1e-4 {
                let middle = 0.5 * (inside + outside);
                if at(middle) >= least { inside = middle } else { outside = middle }
            }
            inside
        };
        let lower = end(low);
        let lower = if lower <= low { 0.0 } else { lower.exp() };
        (best.exp(), (lower, end(high).exp()))
    }
}

impl Mechanism {
    /// The same machine with every stated tolerance `factor` times as large; what is held stays held, what is free free.
    pub fn with_tolerances(&self, factor: f64) -> Self {
        let scaled = |prior: Prior| match prior {
            Prior::Sigma(sigma) => Prior::Sigma(sigma * factor),
            Prior::Held | Prior::Free => prior,
        };
        let mut machine = self.clone();
        for link in machine.limbs.iter_mut().flat_map(|limb| &mut limb.links) {
            link.tolerance =
                Tolerance { angle: scaled(link.tolerance.angle), length: scaled(link.tolerance.length) };
        }
        for constant in &mut machine.instrument {
            constant.prior = scaled(constant.prior);
        }
        let ends = [&mut machine.ends.placement, &mut machine.ends.tool_mounting];
        for tolerance in ends.into_iter().flatten() {
            *tolerance = Tolerance { angle: scaled(tolerance.angle), length: scaled(tolerance.length) };
        }
        machine
    }
}
