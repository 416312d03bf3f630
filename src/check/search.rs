//! The mistake, or the two of them, that explain why data and drawing disagree.
//!
//! Hypotheses are ranked without a fit; the machine is fitted within its tolerances to the best of them, as to the data as
//! they are. A story is told only where it leaves what noise and tolerances explain, little beside the spread of the
//! corrected data, and where it does far better than the data as they are and than every other story. What has numbers to
//! fit with is believed only where no plain mistake does as well.

use super::correction::{Correction, applied, redrawn};
use super::fit::{Effort, Fit, fit};
use super::judge::{CLOSED, Choice, FAR, Judge, SMALL, Story};
use super::misfit::misfits;
use super::observed::{Observed, Seen};
use super::ranking::{Ranked, Ranking};
use super::reading::{Reading, postures, some_of};
use crate::calibration::Sample;
use crate::identify::registration::{FreeEnds, register};
use crate::lie::so3;
use crate::model::Mechanism;
use crate::statistics::median;
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// Postures to which the machine is fitted.
const FITTED: usize = 40;
/// Hypotheses to which it is, of one mistake and of two.
const TRIED: usize = 28;
/// As many at a time.
const TOGETHER: usize = 4;
/// Misfit, in parts of the spread, above which nothing is explained.
const NOTHING: f64 = 0.5;
/// Factor on the least misfit up to which a hypothesis is fitted.
const CLOSE_TO: f64 = 12.0;
/// The same where a story was found.
const AS_CLOSE: f64 = 2.5;
/// [`Fit::size`] above which noise and tolerances do not explain the data.
const UNEXPLAINED: f64 = 3.0;
/// Misfit, in parts of the spread, that tolerances make anyway.
const CLOSE: f64 = 2e-3;
/// [`Fit::size`] below which a fit may have more to gain from further steps,
const SETTLING: f64 = 8.0;
/// for so many stories, the best ones.
const SETTLED: usize = 5;
/// Second singular value of places, in parts of the first, below which they lie on a line.
const LINE: f64 = 0.02;
/// Rotations below which a machine does not tell its ends apart, rad.
const HARDLY: f64 = 0.05;

/// What a search came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Noise and tolerances explain the data.
    Explained,
    /// Corrections explain them.
    Named,
    /// They are not explained, and no usual mistake explains them better than every other one.
    Unknown,
    /// Where base and tool stand cannot be told from them.
    Unplaced,
}

/// What was found. Misfits are medians over the postures, m; rotations count with the size of the machine.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// What it came to.
    pub verdict: Verdict,
    /// As the data are.
    pub before: f64,
    /// With the corrections.
    pub after: f64,
    /// Together they explain the data; empty where nothing is wrong, or nothing known explains it.
    pub corrections: Vec<Correction>,
    /// Other stories, each of which would do as well.
    pub alternatives: Vec<Vec<Correction>>,
    /// The machine fitted to the data as they are, and with the corrections.
    pub fits: [Option<Fit>; 2],
}

/// The machine and the data with these corrections, ends that are free registered.
pub fn corrected(
    mechanism: &Mechanism,
    data: &[Reading],
    corrections: &[Correction],
) -> Option<(Mechanism, Vec<Reading>)> {
    let data = applied(mechanism, data, corrections)?;
    let mechanism = &*redrawn(mechanism, corrections);
    let free = elsewhere(FreeEnds::of(mechanism), corrections);
    let targets = data.iter().any(|reading| reading.target.constants.is_some());
    if !(free.base || free.tool || targets) {
        return Some((mechanism.clone(), data));
    }
    let samples: Option<Vec<Sample>> = data.iter().map(|reading| reading.sample(mechanism)).collect();
    let placed = register(mechanism, &samples?, free).map(|found| found.machine);
    Some((placed.unwrap_or_else(|| mechanism.clone()), data))
}

fn elsewhere(mut free: FreeEnds, corrections: &[Correction]) -> FreeEnds {
    for correction in corrections {
        if let Correction::Elsewhere(ends) = correction {
            free = FreeEnds { base: free.base || ends.base, tool: free.tool || ends.tool };
        }
    }
    free
}

/// Looks for mistakes where the median misfit is above `limit`, m, or the machine does not fit within its tolerances;
/// `stated` says whether the noise is.
pub fn search(mechanism: &Mechanism, data: &[Reading], limit: f64, stated: bool) -> Finding {
    let chosen = some_of(data, FITTED);
    let misfit = |corrections: &[Correction]| {
        corrected(mechanism, &chosen, corrections)
            .and_then(|(mechanism, data)| median(misfits(&mechanism, &data)))
            .unwrap_or(f64::INFINITY)
    };
    let before = misfit(&[]);
    let none = fit(mechanism, &chosen, FreeEnds { base: false, tool: false }, Effort::Long);
    let finding = |verdict| Finding {
        verdict,
        before,
        after: before,
        corrections: Vec::new(),
        alternatives: Vec::new(),
        fits: [none, None],
    };
    let normal = |fit: &Fit| fit.closed >= CLOSED && fit.size() <= 1.0 + 5.0 / (2.0 * fit.rows as f64).sqrt();
    let fits = none.as_ref().is_none_or(|fit| !stated || normal(fit));
    if before <= limit && fits {
        return finding(Verdict::Explained);
    }
    let judge = Judge { none, stated };
    let Some((story, alternatives)) = story(mechanism, &chosen, &judge) else {
        let suspicious = match &none {
            Some(fit) if stated => fit.size() > UNEXPLAINED || fit.closed < CLOSED,
            _ => before > limit,
        };
        return finding(match suspicious {
            false => Verdict::Explained,
            true if unplaced(mechanism, &chosen) => Verdict::Unplaced,
            true => Verdict::Unknown,
        });
    };
    Finding {
        verdict: Verdict::Named,
        after: misfit(&story.corrections),
        corrections: story.corrections,
        alternatives: alternatives.into_iter().map(|other| other.corrections).collect(),
        fits: [none, Some(story.fit)],
        ..finding(Verdict::Named)
    }
}

/// The story that explains the data, and others that would do as well.
fn story(mechanism: &Mechanism, data: &[Reading], judge: &Judge) -> Option<(Story, Vec<Story>)> {
    if unplaced(mechanism, data) {
        return None;
    }
    let ranking = Ranking::new(mechanism, data);
    let singles = ranking.singles(data);
    let one = judge.chosen(&tried(mechanism, data, &ranking, &singles, judge));
    let explained = match &one {
        Choice::Told(Story { fit, .. }, _) | Choice::Many(fit) => fit.size() <= SMALL,
        Choice::Nothing => false,
    };
    // What is nearly explained has no two mistakes in it.
    let nearly = judge.stated
        && judge.none.as_ref().is_some_and(|fit| fit.size() <= UNEXPLAINED && fit.closed >= CLOSED);
    if explained || nearly {
        return Choice::told(one, Choice::Nothing);
    }
    let pairs = ranking.pairs(data, &singles);
    Choice::told(one, judge.chosen(&tried(mechanism, data, &ranking, &pairs, judge)))
}

/// The machine fitted to what the best hypotheses make of the data: all that may be as good as the best story.
fn tried(
    mechanism: &Mechanism,
    data: &[Reading],
    ranking: &Ranking<'_>,
    ranked: &[Ranked],
    judge: &Judge,
) -> Vec<Story> {
    let least = ranked.first().map_or(0.0, |best| best.misfit);
    let mut limit = NOTHING.min(CLOSE_TO * least.max(CLOSE));
    let mut stories = Vec::new();
    for together in ranked[..ranked.len().min(TRIED)].chunks(TOGETHER) {
        let together = together.par_iter().filter(|r| r.misfit <= limit);
        let fitted: Vec<(f64, Story)> =
            together.filter_map(|r| Some((r.misfit, told(mechanism, data, ranking, r)?))).collect();
        for (misfit, story) in fitted {
            if story.fit.size() <= SMALL && judge.accepts(&story) {
                limit = limit.min(AS_CLOSE * misfit.max(CLOSE));
            }
            stories.push(story);
        }
    }
    settle(mechanism, data, &mut stories);
    stories
}

fn told(mechanism: &Mechanism, data: &[Reading], ranking: &Ranking<'_>, ranked: &Ranked) -> Option<Story> {
    let corrections = ranking.refined(data, &ranked.corrections);
    let changed = applied(mechanism, data, &corrections)?;
    let ends = elsewhere(FreeEnds { base: false, tool: false }, &corrections);
    let fit = fit(&redrawn(mechanism, &corrections), &changed, ends, Effort::Short)?;
    Some(Story { corrections, plain: ranked.plain, fit })
}

/// The best stories that explain nothing so far, fitted with more steps: valleys of machines with loops are long, and one
/// that ends early is no worse than those that do as well.
fn settle(mechanism: &Mechanism, data: &[Reading], stories: &mut [Story]) {
    let unsettled = |story: &&mut Story| {
        story.fit.moves && story.fit.relative <= FAR && (SMALL..SETTLING).contains(&story.fit.size())
    };
    let mut best: Vec<&mut Story> = stories.iter_mut().filter(unsettled).collect();
    best.sort_by(|a, b| a.fit.size().total_cmp(&b.fit.size()));
    best.truncate(SETTLED);
    best.into_par_iter().for_each(|story| {
        let ends = elsewhere(FreeEnds { base: false, tool: false }, &story.corrections);
        let longer = applied(mechanism, data, &story.corrections)
            .and_then(|changed| fit(&redrawn(mechanism, &story.corrections), &changed, ends, Effort::Long));
        if let Some(longer) = longer.filter(|longer| longer.size() < story.fit.size()) {
            story.fit = longer;
        }
    });
}

/// Whether the postures do not tell where free ends stand: hardly turned, and all places on a line.
fn unplaced(mechanism: &Mechanism, data: &[Reading]) -> bool {
    let free = FreeEnds::of(mechanism);
    if !free.base {
        return false;
    }
    let Some(observed) = Observed::new(mechanism, data, &postures(data)) else { return true };
    let places: Vec<Vector3<f64>> = match &observed.seen {
        Seen::Poses(_) if observed.spread[1] > HARDLY => return false,
        Seen::Poses(poses) => poses.iter().flatten().map(|pose| pose.p).collect(),
        Seen::Points(points, _) => points.iter().flatten().copied().collect(),
    };
    let mean = places.iter().sum::<Vector3<f64>>() / places.len().max(1) as f64;
    let sum: Matrix3<f64> = places.iter().map(|p| (p - mean) * (p - mean).transpose()).sum();
    so3::nearest(&sum).is_none_or(|near| near.sharpness < LINE * LINE)
}
