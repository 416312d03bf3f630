//! What a story has to do to be told, and which of several is.

use super::correction::Correction;
use super::fit::Fit;

/// Error, in parts of the spread, up to which a story explains data whose noise is not stated.
const CLOSE_UNSTATED: f64 = 1e-2;
/// Error, in parts of the spread, above which they never do.
pub(super) const FAR: f64 = 0.03;
/// Part of the postures that must close.
pub(super) const CLOSED: f64 = 0.8;
/// Factor by which a correction must lower the size of a fit,
const FACTOR: f64 = 4.0;
/// or what it must take off chi-square where the rest is as small as noise and tolerances make it,
const GAIN: f64 = 20.0;
/// and more for every number that it fits.
const GAIN_PER_NUMBER: f64 = 6.0;
/// [`Fit::size`] of such a rest, up to which a story explains the data.
pub(super) const SMALL: f64 = 1.5;
/// Chi-square by which a story must be better than another one, in units of what is left.
const APART: f64 = 30.0;
/// The same as a factor on the size of the fit, where the fit leaves more than noise and tolerances explain.
const APART_BY: f64 = 1.5;
/// Most stories of which any may be the true one.
const ALTERNATIVES: usize = 8;
/// Difference of offsets, rad or m, that is none.
const SAME: f64 = 0.02;

/// A story with the machine fitted to what it makes of the data.
#[derive(Clone, Debug)]
pub(super) struct Story {
    pub corrections: Vec<Correction>,
    /// Small where corrections are plain.
    pub plain: usize,
    pub fit: Fit,
}

impl Story {
    fn fitted(&self) -> usize {
        self.corrections.iter().map(Correction::fitted).sum()
    }
}

/// What a story has to do to be told.
pub(super) struct Judge {
    /// The machine fitted to the data as they are.
    pub none: Option<Fit>,
    /// Whether the noise is stated.
    pub stated: bool,
}

impl Judge {
    fn explains(&self, fit: &Fit) -> bool {
        let small = match self.stated {
            true => fit.size() <= SMALL,
            false => fit.relative <= CLOSE_UNSTATED,
        };
        small && fit.moves && fit.relative <= FAR && fit.closed >= CLOSED
    }

    fn is_better(&self, story: &Story) -> bool {
        let Some(none) = self.none.as_ref().filter(|none| none.closed >= 0.5) else { return true };
        let fit = &story.fit;
        let per_row = |fit: &Fit| fit.square / fit.rows.max(1) as f64;
        let gain = (per_row(none) - per_row(fit)) * fit.rows as f64;
        none.size() >= FACTOR * fit.size()
            || self.stated
                && gain >= (GAIN + GAIN_PER_NUMBER * story.fitted() as f64) * fit.size().max(1.0).powi(2)
    }

    pub fn accepts(&self, story: &Story) -> bool {
        self.explains(&story.fit) && self.is_better(story)
    }

    /// The story that explains the data, and others that would do as well.
    pub fn chosen(&self, stories: &[Story]) -> Choice {
        let good: Vec<&Story> = stories.iter().filter(|story| self.accepts(story)).collect();
        let Some(best) = good.iter().min_by(|a, b| a.fit.size().total_cmp(&b.fit.size())) else {
            return Choice::Nothing;
        };
        let as_good = |story: &&&Story| {
            let unit = best.fit.size().max(1.0).powi(2);
            let per_row = (story.fit.size().powi(2) - best.fit.size().powi(2)) / unit;
            // What is freed takes its prior off chi-square whether it was wrong or not.
            let freed = 2.0 * best.fitted().saturating_sub(story.fitted()) as f64;
            per_row * best.fit.rows as f64 <= APART + freed
                || !self.stated && story.fit.size() <= APART_BY * best.fit.size()
        };
        let equals: Vec<&Story> = good.iter().filter(as_good).copied().collect();
        let Some(plainest) = equals.iter().min_by_key(|s| (s.fitted(), s.plain)) else {
            return Choice::Nothing;
        };
        let mut others: Vec<Story> = Vec::new();
        for story in equals.iter().filter(|s| s.fitted() == plainest.fitted()) {
            let told = |other: &Story| same(&other.corrections, &story.corrections);
            if !told(plainest) && !others.iter().any(told) {
                others.push((*story).clone());
            }
        }
        match others.len() < ALTERNATIVES {
            true => Choice::Told((*plainest).clone(), others),
            false => Choice::Many(best.fit),
        }
    }
}

/// What stories come to.
pub(super) enum Choice {
    /// None explains the data.
    Nothing,
    /// One does, and others would do as well.
    Told(Story, Vec<Story>),
    /// Too many do as well as the best of them.
    Many(Fit),
}

impl Choice {
    /// What is told of one mistake and of two: one more has to earn it.
    pub fn told(one: Choice, two: Choice) -> Option<(Story, Vec<Story>)> {
        let earns = |one: &Fit, two: &Fit| one.size() >= APART_BY * two.size();
        match (one, two) {
            // Which two it is cannot be told, but that the one is not all of it.
            (Choice::Told(story, _), Choice::Many(fit)) if earns(&story.fit, &fit) => None,
            // Two do not earn it against one of many.
            (Choice::Many(fit), Choice::Told(two, _)) if !earns(&fit, &two.fit) => None,
            (Choice::Told(story, others), Choice::Told(two, more)) => {
                Some(if earns(&story.fit, &two.fit) { (two, more) } else { (story, others) })
            }
            (Choice::Told(story, others), _) | (_, Choice::Told(story, others)) => Some((story, others)),
            _ => None,
        }
    }
}

/// Whether two stories are one, offsets of homes as far as data tell them.
fn same(a: &[Correction], b: &[Correction]) -> bool {
    let close = |(a, b): (&Correction, &Correction)| match (a, b) {
        (Correction::Offsets(a), Correction::Offsets(b)) => {
            a.len() == b.len()
                && a.iter().zip(b).all(|((i, v), (j, w))| i == j && (v - w).abs() <= SAME * (1.0 + v.abs()))
        }
        (a, b) => a == b,
    };
    a.len() == b.len() && a.iter().zip(b).all(close)
}
