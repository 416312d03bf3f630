//! Thousands of hypotheses put in order by how well predicted and observed postures agree, without a fit.

use super::alignment::align;
use super::candidates::{corrections, hold_together};
use super::correction::{Correction, Numbers, actuated, applied, redrawn};
use super::homes::Homes;
use super::observed::Observed;
use super::prediction::Predictor;
use super::reading::{Reading, postures, some_of};
use crate::identify::registration::FreeEnds;
use crate::lie::Se3;
use crate::model::Mechanism;
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// Postures by which hypotheses are ranked: of one mistake, and of two.
const LOOKED_AT: [usize; 2] = [20, 10];
/// Machines with loops: single mistakes behind which a home is sought.
const BEHIND: usize = 20;
/// Hypotheses behind which one is sought that could not be ranked since loops do not close, the plainest ones.
const HIDDEN: usize = 40;
/// Offsets from which homes are sought where loops do not close as they are, rad and machine sizes.
const TURNED: [f64; 4] = [0.4, -0.4, 0.9, -0.9];
const SHIFTED: [f64; 4] = [0.04, -0.04, 0.1, -0.1];
/// Part of the largest offset below which an actuator's own is what tolerances make.
const SMALL: f64 = 0.2;

/// Corrections, the plainest first, and how far they leave predictions from observations in parts of the spread.
#[derive(Clone, Debug)]
pub(super) struct Ranked {
    pub corrections: Vec<Correction>,
    pub misfit: f64,
    /// Order among equals: small where corrections are plain.
    pub plain: usize,
}

/// What hypotheses are ranked with.
pub(super) struct Ranking<'a> {
    mechanism: &'a Mechanism,
    predictor: Predictor<'a>,
    list: Vec<Correction>,
    free: FreeEnds,
    units: Vec<f64>,
}

type Predictions = BTreeMap<Vec<usize>, Vec<Option<Se3>>>;
type Observations = BTreeMap<Vec<usize>, Option<Observed>>;

impl<'a> Ranking<'a> {
    pub fn new(mechanism: &'a Mechanism, data: &[Reading]) -> Self {
        let length = mechanism.characteristic_length();
        let unit = |angular: bool| if angular { 1.0 } else { length };
        Self {
            mechanism,
            predictor: Predictor::new(mechanism),
            list: corrections(mechanism, data),
            free: FreeEnds::of(mechanism),
            units: actuated(mechanism).iter().map(|joint| unit(joint.motion.is_angular())).collect(),
        }
    }

    /// Hypotheses of one mistake, the best first.
    pub fn singles(&self, data: &[Reading]) -> Vec<Ranked> {
        let few = some_of(data, LOOKED_AT[0]);
        let mut all = self.ranked(&few, (0..self.list.len()).map(|i| vec![i]).collect());
        all.extend(self.with_homes(&few, &[]));
        in_order(all)
    }

    /// Hypotheses of two mistakes, the best first; `singles` as they were ranked.
    pub fn pairs(&self, data: &[Reading], singles: &[Ranked]) -> Vec<Ranked> {
        let few = some_of(data, LOOKED_AT[1]);
        let mut two = Vec::new();
        for i in 0..self.list.len() {
            for j in i + 1..self.list.len() {
                if hold_together(&self.list[i], &self.list[j]) {
                    two.push(vec![i, j]);
                }
            }
        }
        let mut all = self.ranked(&few, two);
        let most = if self.mechanism.is_open_chain() { usize::MAX } else { BEHIND };
        let mut before: Vec<&[Correction]> = singles.iter().map(|one| one.corrections.as_slice()).collect();
        let is_homely = |c: &Correction| matches!(c, Correction::Unwrapped(_)) || c.fitted() > 0;
        before.retain(|one| !one.iter().any(is_homely));
        // What could not be ranked, since loops do not close, may be what a wrong home hides.
        let hidden = self.list.iter().filter(|c| !is_homely(c) && !before.iter().any(|one| one.contains(c)));
        let hidden = hidden.map(std::slice::from_ref).filter(|one| self.moves(&few, one));
        let hidden: Vec<&[Correction]> = hidden.take(HIDDEN).collect();
        before.truncate(most);
        before.extend(hidden);
        let behind: Vec<Vec<Ranked>> = before.into_par_iter().map(|one| self.with_homes(&few, one)).collect();
        all.extend(behind.into_iter().flatten());
        in_order(all)
    }

    /// Whether what was measured still spreads, so that a hypothesis that was not ranked lacks loops that close.
    fn moves(&self, data: &[Reading], corrections: &[Correction]) -> bool {
        applied(self.mechanism, data, corrections)
            .and_then(|changed| Observed::new(self.mechanism, &changed, &postures(&changed)))
            .is_some_and(|observed| observed.moves())
    }

    fn corrections(&self, made: &[usize]) -> Vec<Correction> {
        made.iter().filter_map(|i| self.list.get(*i).cloned()).collect()
    }

    /// Those of the corrections that change such numbers.
    fn those(&self, made: &[usize], numbers: Numbers) -> Vec<usize> {
        let changes = |i: &&usize| {
            let of = self.list[**i].numbers();
            of == numbers || of == Numbers::Both
        };
        made.iter().filter(changes).copied().collect()
    }

    fn ends(&self, corrections: &[Correction]) -> FreeEnds {
        let mut free = self.free;
        for correction in corrections {
            if let Correction::Elsewhere(ends) = correction {
                free = FreeEnds { base: free.base || ends.base, tool: free.tool || ends.tool };
            }
        }
        free
    }

    fn ranked(&self, data: &[Reading], all: Vec<Vec<usize>>) -> Vec<Ranked> {
        let of = postures(data);
        let mut predictions = Predictions::new();
        let mut observations = Observations::new();
        for made in &all {
            predictions.entry(self.those(made, Numbers::Readings)).or_default();
            observations.entry(self.those(made, Numbers::Measured)).or_default();
        }
        let first: Vec<Reading> = of.iter().filter_map(|list| data.get(*list.first()?).cloned()).collect();
        predictions.par_iter_mut().for_each(|(made, tools)| {
            let corrections = self.corrections(made);
            // Turns are counted by what was seen of the tool, of all targets.
            let counted = matches!(corrections.as_slice(), [Correction::Unwrapped(_)]);
            let from = if counted { data } else { first.as_slice() };
            if let Some(changed) = applied(self.mechanism, from, &corrections) {
                let one_each = of.iter().filter_map(|list| changed.get(*list.first()?));
                let all: Vec<&Reading> = if counted { one_each.collect() } else { changed.iter().collect() };
                let variables: Vec<Vec<f64>> = all.iter().map(|r| r.variables(self.mechanism)).collect();
                *tools = match redrawn(self.mechanism, &corrections) {
                    Cow::Borrowed(_) => self.predictor.tools(&variables),
                    Cow::Owned(drawing) => Predictor::new(&drawing).tools(&variables),
                };
            }
        });
        observations.par_iter_mut().for_each(|(made, observed)| {
            *observed = applied(self.mechanism, data, &self.corrections(made))
                .and_then(|changed| Observed::new(self.mechanism, &changed, &of));
        });
        all.into_par_iter()
            .filter_map(|made| {
                let tools = predictions.get(&self.those(&made, Numbers::Readings))?;
                let observed = observations.get(&self.those(&made, Numbers::Measured))?.as_ref()?;
                if !observed.moves() {
                    return None;
                }
                let corrections = self.corrections(&made);
                let misfit = align(tools, observed, self.ends(&corrections))?.misfit;
                Some(Ranked { corrections, misfit, plain: made.iter().map(|i| i * i).sum() })
            })
            .collect()
    }

    /// These corrections with the home of one actuator found from the data, of each in turn, and of several at once.
    fn with_homes(&self, data: &[Reading], before: &[Correction]) -> Vec<Ranked> {
        let Some(changed) = applied(self.mechanism, data, before) else { return Vec::new() };
        let of = postures(&changed);
        let Some(observed) = Observed::new(self.mechanism, &changed, &of) else {
            return Vec::new();
        };
        let first = of.iter().filter_map(|list| changed.get(*list.first()?));
        let variables: Vec<Vec<f64>> = first.map(|r| r.variables(self.mechanism)).collect();
        let drawing = redrawn(self.mechanism, before);
        let other = matches!(drawing, Cow::Owned(_)).then(|| Predictor::new(&drawing));
        let homes = Homes {
            predictor: other.as_ref().unwrap_or(&self.predictor),
            observed: &observed,
            free: self.free,
            variables: &variables,
            units: &self.units,
        };
        let plain = self.list.len() * self.list.len();
        let ranked = |which: &[usize], offsets: Vec<f64>, misfit: f64| {
            let mut corrections = before.to_vec();
            corrections.push(Correction::Offsets(which.iter().copied().zip(offsets).collect()));
            Ranked { corrections, misfit, plain }
        };
        let joints = actuated(self.mechanism);
        let n = joints.len();
        let mut all: Vec<Ranked> = (0..n)
            .filter_map(|i| {
                let (offsets, left) = homes.found(&[i], &[0.0]).or_else(|| {
                    // Loops that do not close as they are may close from elsewhere.
                    let unit = self.units[i];
                    let starts = if joints[i].motion.is_angular() { TURNED } else { SHIFTED };
                    let found = starts.into_iter().filter_map(|start| homes.found(&[i], &[start * unit]));
                    found.min_by(|a, b| a.1.misfit.total_cmp(&b.1.misfit))
                })?;
                Some(ranked(&[i], offsets, left.misfit))
            })
            .collect();
        if before.is_empty() && n > 1 {
            let every: Vec<usize> = (0..n).collect();
            all.extend(homes.found(&every, &vec![0.0; n]).and_then(|(offsets, _)| {
                let size = |i: usize| (offsets[i] / self.units[i]).abs();
                let largest = (0..n).map(size).fold(0.0, f64::max);
                let large: Vec<usize> = (0..n).filter(|&i| size(i) > SMALL * largest).collect();
                let from: Vec<f64> = large.iter().map(|&i| offsets[i]).collect();
                let (offsets, left) = homes.found(&large, &from)?;
                (large.len() > 1).then(|| ranked(&large, offsets, left.misfit))
            }));
        }
        all
    }

    /// Corrections whose offsets are brought to where the data want them, those of other homes as they are.
    pub fn refined(&self, data: &[Reading], corrections: &[Correction]) -> Vec<Correction> {
        let mut refined = corrections.to_vec();
        let Some(at) = corrections.iter().position(|c| matches!(c, Correction::Offsets(_))) else {
            return refined;
        };
        let Correction::Offsets(offsets) = &corrections[at] else { return refined };
        let others: Vec<Correction> =
            corrections.iter().enumerate().filter(|(k, _)| *k != at).map(|(_, c)| c.clone()).collect();
        let found = applied(self.mechanism, &some_of(data, LOOKED_AT[0]), &others).and_then(|changed| {
            let of = postures(&changed);
            let observed = Observed::new(self.mechanism, &changed, &of)?;
            let first = of.iter().filter_map(|list| changed.get(*list.first()?));
            let variables: Vec<Vec<f64>> = first.map(|r| r.variables(self.mechanism)).collect();
            let drawing = redrawn(self.mechanism, &others);
            let other = matches!(drawing, Cow::Owned(_)).then(|| Predictor::new(&drawing));
            let homes = Homes {
                predictor: other.as_ref().unwrap_or(&self.predictor),
                observed: &observed,
                free: self.ends(corrections),
                variables: &variables,
                units: &self.units,
            };
            let (which, from): (Vec<usize>, Vec<f64>) = offsets.iter().copied().unzip();
            Some(which.iter().copied().zip(homes.found(&which, &from)?.0).collect())
        });
        if let Some(found) = found {
            refined[at] = Correction::Offsets(found);
        }
        refined
    }
}

fn in_order(mut all: Vec<Ranked>) -> Vec<Ranked> {
    all.sort_by(|a, b| a.misfit.total_cmp(&b.misfit).then(a.plain.cmp(&b.plain)));
    all
}
