//! The mistake, or the few of them, that would explain why data and drawing disagree.

use super::correction::{Correction, corrections};
use super::misfit::{Reading, misfits};
use crate::identify::registration::FreeEnds;
use crate::model::Mechanism;
use crate::statistics::median;
use rayon::prelude::*;

/// Postures that are looked at.
const LOOKED_AT: usize = 40;
/// Most mistakes at once.
const MOST: usize = 4;
/// A correction is as good as the best one within this factor: the plainer is named.
const AS_GOOD: f64 = 1.5;
/// Part of the misfit that a step on the way must remove.
const STEP: f64 = 0.9;
/// Factor by which corrections must lower the misfit where tolerances do not explain the rest.
const LARGE: f64 = 10.0;

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

#[derive(Clone)]
struct State {
    mechanism: Mechanism,
    data: Vec<Reading>,
    misfit: f64,
}

impl State {
    fn new(mechanism: Mechanism, data: Vec<Reading>) -> Self {
        let misfit = median(misfits(&mechanism, &data)).unwrap_or(f64::INFINITY);
        Self { mechanism, data, misfit }
    }

    fn with(&self, correction: &Correction) -> Option<Self> {
        let (mechanism, data) = correction.apply(&self.mechanism, &self.data)?;
        Some(Self::new(mechanism, data))
    }

    /// With ends that are free registered.
    fn registered(self, free: FreeEnds) -> Self {
        if !free.base && !free.tool {
            return self;
        }
        self.with(&Correction::Elsewhere(free)).unwrap_or(self)
    }
}

/// Looks for mistakes where the misfit is above `limit`, m.
pub fn search(mechanism: &Mechanism, data: &[Reading], limit: f64) -> Finding {
    let stride = data.len().div_ceil(LOOKED_AT).max(1);
    let chosen: Vec<Reading> = data.iter().step_by(stride).cloned().collect();
    let free = FreeEnds::of(mechanism);
    let bare = State::new(mechanism.clone(), chosen);
    let start = bare.clone().registered(free);
    let nothing =
        |after| Finding { before: start.misfit, after, corrections: Vec::new(), alternatives: Vec::new() };
    if start.misfit <= limit {
        return nothing(start.misfit);
    }
    let list = corrections(mechanism, &bare.data);
    // Free ends are registered anew each time, from the machine as drawn.
    let tried = |state: &State| -> Vec<(usize, State, f64)> {
        list.par_iter()
            .enumerate()
            .filter_map(|(i, correction)| {
                let next = state.with(correction)?;
                let misfit = next.clone().registered(free).misfit;
                Some((i, next, misfit))
            })
            .collect()
    };
    let best = |tried: &[(usize, State, f64)]| {
        tried.iter().map(|(_, _, misfit)| *misfit).fold(f64::INFINITY, f64::min)
    };
    let explained = |misfit: f64| misfit <= limit || misfit * LARGE <= start.misfit;
    let (mut state, mut misfit, mut made) = (bare.clone(), start.misfit, Vec::new());
    let mut alternatives = Vec::new();
    while made.len() < MOST && misfit > limit {
        let next = tried(&state);
        let least = best(&next);
        // Registered ends also take up some of the tolerances: that alone does not make them the better explanation.
        let enough = (AS_GOOD * least).max(0.5 * limit);
        let Some((i, reached, size)) = next.iter().find(|(_, _, m)| *m <= enough) else { break };
        if least > STEP * misfit && misfit.is_finite() {
            break;
        }
        alternatives = next
            .iter()
            .filter(|(j, _, m)| j != i && *m <= AS_GOOD * size && explained(*m))
            .filter_map(|(j, _, _)| list.get(*j).cloned())
            .filter(|other| !matches!(other, Correction::Elsewhere(_) | Correction::Offsets))
            .collect();
        made.extend(list.get(*i).cloned());
        (state, misfit) = (reached.clone(), *size);
    }
    if made.len() > 1 {
        alternatives.clear();
    }
    if !explained(misfit) || made.is_empty() {
        return nothing(misfit.min(start.misfit));
    }
    Finding { before: start.misfit, after: misfit, corrections: made, alternatives }
}
