//! The mistake, or the few of them, that would explain why data and drawing disagree.
//!
//! Every mistake is tried alone, then every pair, then what lies behind the best pairs. What explains the data with fewer
//! mistakes wins over what explains them with more; among equals, a mistake of the file (a unit, an order, a sign) wins
//! over offsets or a frame found from the data, which have numbers to fit with, and one frame over two.

use super::correction::{Correction, corrections};
use super::misfit::{Reading, misfits};
use crate::identify::registration::FreeEnds;
use crate::model::Mechanism;
use crate::statistics::median;
use rayon::prelude::*;

/// Postures that are looked at; of several mistakes at once.
const LOOKED_AT: [usize; 2] = [40, 10];
/// Most mistakes at once.
const MOST: usize = 4;
/// Explanations from which a further mistake is sought.
const KEPT: usize = 16;
/// A correction is as good as the best one within this factor: the plainer is named.
const AS_GOOD: f64 = 1.5;
/// The same among those that have numbers to fit with.
const AS_CLOSE: f64 = 1.2;
/// Factor by which a fit must be better than a plain mistake to be believed in its place, for each set of numbers that it
/// finds.
const MUCH_BETTER: f64 = 3.0;
/// Part of the misfit that a correction leaves at most.
const LEFT: f64 = 0.8;
/// Factor by which corrections must lower the misfit where tolerances do not explain the rest.
const LARGE: f64 = 10.0;
/// Factor by which one more mistake must lower the misfit where tolerances do not explain the rest.
const FURTHER: f64 = 5.0;

/// What was found. Misfits are medians over the postures, m; rotations count with the size of the machine.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// As the data are.
    pub before: f64,
    /// With the corrections.
    pub after: f64,
    /// Together they explain the data; empty where nothing is wrong, or nothing known explains it.
    pub corrections: Vec<Correction>,
    /// Others, each of which would do as well.
    pub alternatives: Vec<Correction>,
}

/// Corrections by their place in the list, and the misfit that they leave.
#[derive(Clone, Debug)]
struct Hypothesis {
    made: Vec<usize>,
    misfit: f64,
}

struct Search<'a> {
    mechanism: &'a Mechanism,
    list: Vec<Correction>,
}

/// The machine and the data with these corrections, ends that are free registered.
pub fn corrected(
    mechanism: &Mechanism,
    data: &[Reading],
    corrections: &[Correction],
) -> Option<(Mechanism, Vec<Reading>)> {
    let mut state = (mechanism.clone(), data.to_vec());
    for correction in corrections {
        state = correction.apply(&state.0, &state.1)?;
    }
    let free = FreeEnds::of(mechanism);
    if free.base || free.tool {
        state = Correction::Elsewhere(free).apply(&state.0, &state.1).unwrap_or(state);
    }
    Some(state)
}

impl Search<'_> {
    fn misfit(&self, data: &[Reading], made: &[usize]) -> Option<f64> {
        let corrections: Option<Vec<Correction>> = made.iter().map(|i| self.list.get(*i).cloned()).collect();
        let (mechanism, data) = corrected(self.mechanism, data, &corrections?)?;
        Some(median(misfits(&mechanism, &data)).unwrap_or(f64::INFINITY))
    }

    /// How many sets of numbers the corrections fit to the data.
    fn fitted(&self, made: &[usize]) -> usize {
        made.iter().filter_map(|i| self.list.get(*i)).map(Correction::fitted).sum()
    }

    fn tried(&self, data: &[Reading], all: Vec<Vec<usize>>) -> Vec<Hypothesis> {
        all.into_par_iter()
            .filter_map(|made| {
                let misfit = self.misfit(data, &made)?;
                Some(Hypothesis { made, misfit })
            })
            .collect()
    }

    /// The hypotheses with one more correction, each in the order of the list, in which what is fitted comes last; at most
    /// one is fitted.
    fn extended(&self, from: &[Vec<usize>]) -> Vec<Vec<usize>> {
        let mut all: Vec<Vec<usize>> = Vec::new();
        for made in from {
            for next in 0..self.list.len() {
                if made.contains(&next) || self.fitted(&[next]) > 0 && self.fitted(made) > 0 {
                    continue;
                }
                let mut longer = made.clone();
                longer.push(next);
                longer.sort_unstable();
                all.push(longer);
            }
        }
        all.sort_unstable();
        all.dedup();
        all
    }

    /// The plainest of the hypotheses that leave at most `limit`.
    fn plainest<'h>(&self, all: &'h [Hypothesis], limit: f64) -> Option<&'h Hypothesis> {
        let pick = |fitted: usize, as_good: f64| {
            let some = || all.iter().filter(move |h| h.misfit <= limit && self.fitted(&h.made) == fitted);
            let least = some().map(|h| h.misfit).fold(f64::INFINITY, f64::min);
            let good = some().filter(|h| h.misfit <= as_good * least);
            good.min_by_key(|h| h.made.iter().map(|i| i * i).sum::<usize>())
        };
        match (pick(0, AS_GOOD), pick(1, AS_CLOSE).or_else(|| pick(2, AS_CLOSE))) {
            (Some(plain), Some(fit))
                if plain.misfit > MUCH_BETTER.powi(self.fitted(&fit.made) as i32) * fit.misfit =>
            {
                Some(fit)
            }
            (plain, fit) => plain.or(fit),
        }
    }
}

fn some_of(data: &[Reading], most: usize) -> Vec<Reading> {
    data.iter().step_by(data.len().div_ceil(most).max(1)).cloned().collect()
}

/// Looks for mistakes where the misfit is above `limit`, m.
pub fn search(mechanism: &Mechanism, data: &[Reading], limit: f64) -> Finding {
    let [chosen, few] = LOOKED_AT.map(|most| some_of(data, most));
    let of = Search { mechanism, list: corrections(mechanism, &chosen) };
    let before = of.misfit(&chosen, &[]).unwrap_or(f64::INFINITY);
    let nothing = |after| Finding { before, after, corrections: Vec::new(), alternatives: Vec::new() };
    if before <= limit {
        return nothing(before);
    }
    // Without a posture that closes there is no misfit to lower by a factor.
    let start = before.min(mechanism.characteristic_length());
    let (enough, much) = (limit.min(LEFT * start), (start / LARGE).min(LEFT * start));
    let single = of.tried(&chosen, of.extended(&[Vec::new()]));
    let mut found = of.plainest(&single, enough).cloned();
    let mut best = of.plainest(&single, much).cloned();
    let mut from: Vec<Vec<usize>> = single.iter().map(|h| h.made.clone()).collect();
    for _ in 1..MOST {
        if found.is_some() {
            break;
        }
        let mut several = of.tried(&few, of.extended(&from));
        // What has numbers to fit with lowers any misfit a little.
        let size = |h: &Hypothesis| h.misfit * if of.fitted(&h.made) > 0 { MUCH_BETTER } else { 1.0 };
        several.sort_by(|a, b| size(a).total_cmp(&size(b)).then_with(|| a.made.cmp(&b.made)));
        several.truncate(KEPT);
        from = several.iter().map(|h| h.made.clone()).collect();
        let several = of.tried(&chosen, from.clone());
        found = of.plainest(&several, enough).cloned();
        let than = best.as_ref().map_or(much, |best| (best.misfit / FURTHER).min(much));
        best = of.plainest(&several, than).cloned().or(best);
    }
    let Some(found) = found.or(best) else {
        let least = single.iter().map(|h| h.misfit).fold(before, f64::min);
        return nothing(least);
    };
    let fitted = |h: &Hypothesis| of.fitted(&h.made);
    let close = if fitted(&found) > 0 { AS_CLOSE } else { AS_GOOD };
    let as_good = single.iter().filter(|h| {
        found.made.len() == 1
            && h.made != found.made
            && h.misfit <= (close * found.misfit).min(enough.max(much))
            && fitted(h) == fitted(&found)
    });
    let named = |made: &[usize]| -> Vec<Correction> {
        made.iter().filter_map(|i| of.list.get(*i).cloned()).collect()
    };
    Finding {
        before,
        after: found.misfit,
        corrections: named(&found.made),
        alternatives: as_good.flat_map(|h| named(&h.made)).collect(),
    }
}
