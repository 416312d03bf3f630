//! Why a residual is what it is: each possible cause is tested, and those that the data name are said, by evidence
//! (docs/theory.md section 10, "Causes").

mod analysis;
mod cause;
mod cells;
pub mod chi_square;
mod groups;
mod holdout;
mod joints;
mod linear;
mod model;
mod order;
mod pattern;
mod posture_noise;
mod postures;
mod readings;

pub use cause::{Cause, OutlierFinding};
pub use cells::{Axis, Cell, Quantity};
pub use chi_square::{ChiSquareTest, Size};
pub use groups::{GroupTest, NoiseFinding, NoisePart};
pub use holdout::HoldoutTest;
pub use model::ModelFinding;
pub use order::{DriftFinding, OrderFinding};
pub use posture_noise::{PostureNoiseFinding, PostureNoisePart};
pub use readings::RowCause;

use super::outliers::Outlier;
use super::posture_noise::sharing;
use super::rounds::EXACT;
use super::run::{Identification, identify_from};
use crate::calibration::Sample;
use crate::solve::{Identifier, Stop, registry};
use analysis::Analysis;

/// Rounds in which postures are left out and taken back.
const ROUNDS: usize = 5;
/// Identifier that shows which postures stand out where another one is led astray by them.
const ROBUST: &str = "conic-huber";

/// A posture that stands out, and what explains it.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedOutlier {
    /// The posture.
    pub outlier: Outlier,
    /// Whether one reading of an actuator explains it.
    pub cause: RowCause,
}

/// What the tests of a residual say together.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Judgement {
    /// Of all readings together, where linear theory describes the estimate.
    pub total: Option<ChiSquareTest>,
    /// Of the groups of readings.
    pub groups: Vec<GroupTest>,
    /// Causes that the data name, the one with the most evidence first.
    pub causes: Vec<Cause>,
    /// Postures that stand out, worst first.
    pub outliers: Vec<NamedOutlier>,
    /// Of the hold-out, where there is one.
    pub holdout: Option<HoldoutTest>,
    /// What the samples of a posture have in common, where it is not what was stated.
    pub common: Option<PostureNoiseFinding>,
}

/// What is judged: a finished identification and what it was made from.
#[derive(Clone, Copy)]
pub struct Judged<'a> {
    /// What was found.
    pub found: &'a Identification,
    /// The samples that it was found from, in the order in which they were read.
    pub samples: &'a [Sample],
    /// The set of each sample, from 0; empty where there is one set.
    pub sets: &'a [usize],
    /// Samples that took no part.
    pub holdout: &'a [Sample],
    /// Whether noise is stated; else the residual defines it.
    pub stated: bool,
    /// The identifier.
    pub identifier: &'a dyn Identifier,
    /// When it stops.
    pub stop: &'a Stop,
}

/// Judges a residual.
///
/// Postures that stand out spoil the estimate, and with it every other test; an unsuited noise makes postures stand out.
/// So rounds are made: identified without the postures named so far, the other causes are sought and accounted for,
/// and all postures are judged anew by what comes of it, until the names stay.
pub fn judge(of: &Judged<'_>) -> Judgement {
    let found = of.found;
    let converged = found.report.outcome.converged();
    // Where the estimate ended nowhere, samples may have been set aside for no fault of theirs.
    let apart = |sample: &Sample| converged && found.set_aside.iter().any(|s| s.name == sample.name);
    let taking: Vec<usize> = (0..of.samples.len()).filter(|&i| !apart(&of.samples[i])).collect();
    let samples: Vec<Sample> = taking.iter().map(|&i| of.samples[i].clone()).collect();
    let samples = if converged { found.taking_part(&samples) } else { samples };
    let sets: Vec<usize> = taking.iter().map(|&i| of.sets.get(i).copied().unwrap_or(0)).collect();
    let total = found
        .chi_square()
        .filter(|_| of.stated)
        .and_then(|(value, freedom)| ChiSquareTest::new(value, freedom));
    let mut judgement = Judgement { total, ..Judgement::default() };
    judgement.holdout = HoldoutTest::new(found, of.holdout);
    // Rounding has no cause.
    let exact = found.fit.1.is_some_and(|fit| fit.weighted_rms < EXACT);
    let linear = !converged || found.covariance.is_some();
    let common = if converged && !exact { PostureNoiseFinding::of(found, &samples) } else { None };
    // What else there is shows beside what is common to postures as it is, not as it was stated.
    let corrected = common.as_ref().map(|finding| sharing(&samples, finding.supported));
    let judged = corrected.as_deref().unwrap_or(&samples);
    judgement.common = common;
    let explained = !exact && linear && judgement.explain(of, judged, &sets);
    if let Some(common) = judgement.common.clone() {
        judgement.causes.push(Cause::PostureNoise(common));
        judgement.causes.sort_by(|a, b| b.gain().total_cmp(&a.gain()));
    }
    if converged && !explained {
        // By the estimate as it is, where linear theory does not say what the others would give.
        judgement.outliers =
            found.outliers.iter().map(|outlier| as_found(found, &samples, outlier)).collect();
    }
    judgement
}

/// A posture that stands out of an estimate as it is.
fn as_found(found: &Identification, samples: &[Sample], outlier: &Outlier) -> NamedOutlier {
    let members: Vec<usize> =
        (0..samples.len()).filter(|&i| outlier.samples.contains(&samples[i].name)).collect();
    let blamed = postures::to_blame(found, samples, &members, samples.len());
    let cause = match blamed.as_slice() {
        &[only] => readings::cause(&found.start, &found.geometry, &samples[only]),
        _ => RowCause::Unknown,
    };
    NamedOutlier { outlier: postures::named(outlier, samples, &blamed), cause }
}

impl Judgement {
    /// Finds the causes; whether it could.
    fn explain(&mut self, of: &Judged<'_>, samples: &[Sample], sets: &[usize]) -> bool {
        let index = |outliers: &[Outlier]| -> Vec<usize> {
            let is = |k: &usize| outliers.iter().any(|o| o.samples.contains(&samples[*k].name));
            (0..samples.len()).filter(is).collect()
        };
        // An estimate that ended nowhere is no judge of its samples.
        let mut robust = of.found.report.outcome.converged();
        let own = || index(&of.found.outliers);
        let mut removed = match robust {
            true => own(),
            false => robust_outliers(of, samples).map_or_else(own, |outliers| index(&outliers)),
        };
        let mut last = None;
        for _ in 0..ROUNDS {
            let clean = self.without(of, samples, &removed);
            let active: Vec<bool> = (0..samples.len()).map(|k| !removed.contains(&k)).collect();
            let analysis = clean.as_ref().and_then(|clean| Analysis::new(clean, samples, sets, &active));
            let (Some(clean), Some(analysis)) = (clean, analysis) else {
                if !robust {
                    break;
                }
                robust = false;
                removed = robust_outliers(of, samples).map(|outliers| index(&outliers)).unwrap_or_default();
                continue;
            };
            let named = analysis.outlying(samples);
            let same = named == removed;
            last = Some((clean, analysis, removed));
            removed = named;
            if same {
                break;
            }
        }
        let Some((clean, analysis, removed)) = last else { return false };
        self.say(of, samples, (&clean, analysis), &removed);
        true
    }

    /// The identification without some samples; `None` where it does not converge.
    fn without(&self, of: &Judged<'_>, samples: &[Sample], removed: &[usize]) -> Option<Identification> {
        if removed.is_empty() && self.common.is_none() {
            return of.found.report.outcome.converged().then(|| of.found.clone());
        }
        let rest: Vec<Sample> =
            (0..samples.len()).filter(|k| !removed.contains(k)).map(|k| samples[k].clone()).collect();
        let zeros = vec![0.0; of.found.supported.component_count()];
        let clean = identify_from(&of.found.supported, &rest, of.identifier, of.stop, &zeros).ok()?;
        clean.report.outcome.converged().then_some(clean)
    }

    fn say(
        &mut self,
        of: &Judged<'_>,
        samples: &[Sample],
        (clean, analysis): (&Identification, Analysis),
        removed: &[usize],
    ) {
        self.outliers = analysis
            .outliers
            .iter()
            .map(|(group, outlier)| NamedOutlier {
                outlier: outlier.clone(),
                cause: match group.as_slice() {
                    &[only] => readings::cause(&clean.supported, &clean.geometry, &samples[only]),
                    _ => RowCause::Unknown,
                },
            })
            .collect();
        // Samples that do not close with the machine that the others give are to blame as they were.
        let open = removed.iter().filter(|k| !analysis.closing.contains(k));
        for outlier in
            open.filter_map(|&k| of.found.outliers.iter().find(|o| o.samples.contains(&samples[k].name)))
        {
            if !self.outliers.iter().any(|named| named.outlier.name == outlier.name) {
                self.outliers.push(NamedOutlier { outlier: outlier.clone(), cause: RowCause::Unknown });
            }
        }
        self.groups = analysis.groups;
        self.causes = analysis.causes;
        let without = clean.chi_square().and_then(|(value, freedom)| ChiSquareTest::new(value, freedom));
        // Postures without which the model still misses are not what it misses.
        let missing = self.causes.iter().any(|cause| matches!(cause, Cause::Model(_)));
        if missing && without.is_some_and(|test| test.size() == Size::Large) {
            self.outliers.clear();
        }
        if !self.outliers.is_empty() {
            let rows: usize = removed.iter().map(|&k| samples[k].measurement.rows()).sum();
            let gain = match (self.total, without) {
                (Some(total), Some(without)) => 0.5 * (total.value - without.value - 2.0 * rows as f64),
                _ => f64::INFINITY,
            };
            let finding = OutlierFinding { count: self.outliers.len(), without, gain };
            self.causes.push(Cause::Outliers(finding));
        }
        if !of.stated {
            self.causes.retain(|cause| !matches!(cause, Cause::Noise(_)));
        }
        self.causes.sort_by(|a, b| b.gain().total_cmp(&a.gain()));
    }

    /// By how much the noise seems larger than stated, where the residual contradicts it.
    pub fn birge_ratio(&self) -> Option<f64> {
        self.total.and_then(|total| total.birge_ratio())
    }

    /// Whether postures that stand out are all that the residual is too large by: deviations, too, are then what they made
    /// of them.
    pub fn is_spoiled(&self) -> bool {
        let is_large = |test: &ChiSquareTest| test.size() == Size::Large;
        let alone = |cause: &Cause| match cause {
            Cause::Outliers(found) => found.without.is_some_and(|without| !is_large(&without)),
            _ => false,
        };
        self.total.as_ref().is_some_and(is_large) && self.causes.first().is_some_and(alone)
    }

    /// Whether nothing speaks against the stated noise and the model.
    pub fn is_clean(&self) -> bool {
        self.causes.is_empty()
            && self.total.is_none_or(|total| matches!(total.size(), Size::Explained | Size::Doubtful))
    }

    /// What the tests say, in a sentence without its full stop; `None` where nothing was tested.
    pub fn sentence(&self) -> Option<String> {
        let causes: Vec<String> = self.causes.iter().map(Cause::sentence).collect();
        let size = self.total.map(|total| total.size());
        if causes.is_empty() {
            return self.total.map(|total| total.sentence());
        }
        let causes = causes.join("; ");
        let whole = matches!(self.causes.first(), Some(Cause::Noise(noise)) if noise.is_of_all());
        Some(match (self.total, size) {
            (Some(total), Some(Size::Large | Size::Small)) if !whole => {
                format!("the residual is {:.3} times what the stated noise makes it: {causes}", total.ratio())
            }
            _ => causes,
        })
    }
}

/// Postures that stand out by the robust identifier, which they do not lead astray.
fn robust_outliers(of: &Judged<'_>, samples: &[Sample]) -> Option<Vec<Outlier>> {
    let robust = registry::find(ROBUST).ok()?;
    let zeros = vec![0.0; of.found.supported.component_count()];
    let found = identify_from(&of.found.supported, samples, robust.as_ref(), of.stop, &zeros).ok()?;
    (found.report.outcome.converged() && found.set_aside.is_empty()).then_some(found.outliers)
}
