//! Postures that real machines reach: judged by machines drawn from the tolerances, as the drawing is none of them.

use super::candidates::{Candidate, Candidates, DesignError, Unfit, in_range};
use super::information::{Information, Instrument};
use super::plan::{Plan, Settings, plan};
use crate::calibration::Sample;
use crate::model::{Geometry, Mechanism};
use crate::simulate::{close, draw_deviations};
use rayon::prelude::*;

/// Machines by which the postures of a plan are judged.
const MACHINES: usize = 200;
/// The first of them, by which every candidate is judged beforehand.
const FIRST: usize = 6;
/// Machines drawn until there are enough of those that close at home.
const TRIES: u64 = 4 * MACHINES as u64;
/// Most machines that a posture of a plan may be out of reach of.
const MOST_MISSED: usize = MACHINES / 100;
/// Most plans made until every posture of one is reached.
const ROUNDS: usize = 12;
/// Seed of the first machine: no seed that people choose.
const SEED: u64 = 0x5265_6163_6865_6421;

/// Machines drawn from the tolerances.
#[derive(Clone, Debug)]
pub struct RealMachines {
    /// Those by which postures are chosen.
    machines: Vec<Geometry>,
    /// Others, by which what was chosen is judged: a choice flatters itself.
    others: Vec<Geometry>,
}

/// How many machines drawn from the tolerances, others than those by which the postures were chosen, reach a plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reached {
    /// Machines drawn to judge the plan.
    pub machines: usize,
    /// Share of machines that reach a posture, mean over the postures.
    pub mean: f64,
    /// The same of the posture that the fewest reach.
    pub least: f64,
}

impl RealMachines {
    /// Machines whose links deviate by their tolerances and that close at home; none for an open chain, which reaches
    /// every posture.
    pub fn drawn(mechanism: &Mechanism) -> Self {
        let mut machines = Vec::new();
        if mechanism.is_open_chain() {
            return Self { machines, others: Vec::new() };
        }
        let home = vec![0.0; mechanism.actuator_count()];
        for k in 0..TRIES {
            let deviations = draw_deviations(mechanism, SEED.wrapping_add(k), 1.0);
            let geometry = mechanism.deviated(&deviations);
            if close(mechanism, &geometry, &home).is_ok() {
                machines.push(geometry);
            }
            if machines.len() == 2 * MACHINES {
                break;
            }
        }
        let others = machines.split_off(machines.len().div_ceil(2));
        Self { machines, others }
    }

    /// How many of the first `count` machines do not reach the posture; counted to one more than `most`.
    fn missed(&self, mechanism: &Mechanism, actuators: &[f64], count: usize, most: usize) -> usize {
        let count = count.min(self.machines.len());
        missed(mechanism, &self.machines[..count], actuators, most)
    }

    /// How many of the other machines reach these of the candidates.
    fn reached(&self, mechanism: &Mechanism, candidates: &[Candidate], visited: &[usize]) -> Reached {
        let machines = self.others.len();
        let share = |&i: &usize| {
            let missed = missed(mechanism, &self.others, &candidates[i].actuators, machines);
            1.0 - missed as f64 / machines.max(1) as f64
        };
        let shares: Vec<f64> = visited.par_iter().map(share).collect();
        let mean = shares.iter().sum::<f64>() / shares.len().max(1) as f64;
        Reached { machines, mean, least: shares.into_iter().fold(1.0, f64::min) }
    }

    /// The candidates that the first machines reach. What is led to a surface stays in rounds of `group` candidates that
    /// take its targets in turn.
    pub fn reaching(&self, mechanism: &Mechanism, candidates: Candidates, group: usize) -> Candidates {
        if self.machines.is_empty() {
            return candidates;
        }
        let judged: Vec<bool> =
            candidates.fit.par_iter().map(|c| self.missed(mechanism, &c.actuators, FIRST, 0) > 0).collect();
        without(candidates, &judged, FIRST.min(self.machines.len()), group)
    }
}

/// How many of the machines do not reach the posture on home's branch with every joint in its range; counted to one more
/// than `most`.
fn missed(mechanism: &Mechanism, machines: &[Geometry], actuators: &[f64], most: usize) -> usize {
    let misses = |geometry: &&Geometry| {
        !close(mechanism, geometry, actuators).is_ok_and(|posture| in_range(mechanism, &posture).is_ok())
    };
    machines.iter().filter(misses).take(most.saturating_add(1)).count()
}

/// The candidates without those that are missed, and without the others of their groups.
fn without(mut candidates: Candidates, missed: &[bool], machines: usize, group: usize) -> Candidates {
    let all = std::mem::take(&mut candidates.fit);
    for (members, missed) in all.chunks(group.max(1)).zip(missed.chunks(group.max(1))) {
        if !missed.contains(&true) {
            candidates.fit.extend_from_slice(members);
        }
        for (candidate, _) in members.iter().zip(missed).filter(|(_, missed)| **missed) {
            candidates.unfit.push((candidate.name.clone(), Unfit::Unreached { machines }));
        }
    }
    candidates
}

/// What a plan is made of, besides its candidates.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// The machine as drawn.
    pub mechanism: &'a Mechanism,
    /// What is read at a posture.
    pub instrument: &'a Instrument,
    /// Postures measured already.
    pub measured: &'a [Sample],
    /// Postures in which the machine has to be accurate.
    pub workspace: &'a [Candidate],
    /// What is asked of the plan.
    pub settings: Settings,
    /// Candidates that belong together.
    pub group: usize,
}

/// A plan, its candidates, and what is known of it.
#[derive(Clone, Debug)]
pub struct ReachedPlan {
    /// Candidates that the plan was chosen from.
    pub candidates: Candidates,
    /// The plan.
    pub plan: Plan,
    /// Names of postures measured already that are not counted.
    pub left_out: Vec<String>,
    /// What reaches it; `None` for an open chain.
    pub reached: Option<Reached>,
}

/// Chooses postures until all of them are reached by all but a hundredth of the machines; `told` puts into words why a
/// posture is unfit. Where the candidates run out or the rounds end, the last plan is the one. The share stated is that of
/// other machines.
pub fn reached_plan(
    request: &Request<'_>,
    real: &RealMachines,
    candidates: Candidates,
    told: &dyn Fn(&Unfit) -> String,
) -> Result<ReachedPlan, DesignError> {
    let Request { mechanism, instrument, measured, workspace, settings, group } = *request;
    let least = settings.poses.max(if instrument.compares() { 2 } else { 1 });
    let mut candidates = real.reaching(mechanism, candidates, group);
    candidates.require(least, told)?;
    let mut known: Vec<Known> =
        candidates.fit.par_iter().map(|c| Known::unjudged(mechanism, &c.actuators)).collect();
    let mut round = 0;
    loop {
        round += 1;
        let fit = &candidates.fit;
        let info = Information::new(mechanism, instrument, fit, measured, workspace, settings.poses)?;
        let plan = plan(mechanism, fit, &info, &settings)?;
        let mut visited = plan.chosen.clone();
        if info.pairs {
            visited.extend(plan.chosen.iter().map(|&i| Instrument::second(i, fit.len())));
        }
        visited.sort_unstable();
        visited.dedup();
        let judge = |known: &mut [Known], these: Vec<usize>| {
            let new: Vec<usize> = these.into_iter().filter(|&i| known[i].missed.is_none()).collect();
            let missed = |&i: &usize| real.missed(mechanism, &fit[i].actuators, MACHINES, MOST_MISSED);
            let judged: Vec<usize> = new.par_iter().map(missed).collect();
            new.iter().zip(judged).for_each(|(&i, missed)| known[i].missed = Some(missed));
        };
        judge(&mut known, visited.clone());
        let bad: Vec<usize> = visited.iter().copied().filter(|&i| known[i].is_missed()).collect();
        // What is as near to a singularity as those that are missed would be chosen next.
        let near = bad.iter().map(|&i| known[i].regularity).fold(0.0, f64::max);
        let below = (0..fit.len()).filter(|&i| known[i].regularity <= near).collect();
        judge(&mut known, below);
        let missed: Vec<bool> = known.iter().map(Known::is_missed).collect();
        let remain =
            missed.chunks(group.max(1)).filter(|group| !group.contains(&true)).count() * group.max(1);
        if bad.is_empty() || round == ROUNDS || remain < least {
            let reached = (!mechanism.is_open_chain()).then(|| real.reached(mechanism, fit, &visited));
            return Ok(ReachedPlan { left_out: info.left_out, candidates, plan, reached });
        }
        let groups = known.chunks(group.max(1)).zip(missed.chunks(group.max(1)));
        known = groups
            .filter(|(_, missed)| !missed.contains(&true))
            .flat_map(|(known, _)| known.to_vec())
            .collect();
        candidates = without(candidates, &missed, real.machines.len(), group);
    }
}

/// What is known of a candidate.
#[derive(Clone, Copy, Debug)]
struct Known {
    /// Ratio of the extreme singular values of the wrench matrix, as drawn.
    regularity: f64,
    /// Machines that do not reach it, counted to one more than the most that are tolerated; `None` before it is judged.
    missed: Option<usize>,
}

impl Known {
    fn unjudged(mechanism: &Mechanism, actuators: &[f64]) -> Self {
        let posture = close(mechanism, &mechanism.nominal(), actuators);
        let regularity =
            posture.map_or(0.0, |p| if mechanism.is_open_chain() { 1.0 } else { p.regularity() });
        Self { regularity, missed: None }
    }

    fn is_missed(&self) -> bool {
        self.missed.is_some_and(|missed| missed > MOST_MISSED)
    }
}
