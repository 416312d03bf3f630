//! Candidate postures: within the drawn ranges, loops closed, away from singularities.

use super::information::ROWS;
use crate::lie::Se3;
use crate::measure::Measurement;
use crate::model::{Mechanism, NotClosed, Posture};
use crate::simulate::{actuator_ranges, close, touch};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::sync::Arc;

/// Most candidates of a plan: their rows are held in memory.
pub const MOST: usize = 20_000;
/// Random postures tried for each one that is wanted.
const TRIES: usize = 50;
/// Share of a range by which a joint may leave it, for readings that were rounded.
const SLACK: f64 = 1e-9;
/// Separates these random numbers from those of simulations with the same seed.
const STREAM: u64 = 3;

/// A posture that could be measured.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// Where it comes from, for messages.
    pub name: String,
    /// Actuator variables (reading - home), rad or m.
    pub actuators: Vec<f64>,
    /// Predicted pose of the tool.
    pub pose: Se3,
}

/// Why a posture is no candidate.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Unfit {
    /// Its loops do not close.
    #[error(transparent)]
    NotClosed(#[from] NotClosed),
    /// It is too near a singularity.
    #[error(
        "nearly singular: the wrench matrix has singular values in the ratio {ratio:.1e}, below {least:.1e}"
    )]
    Singular {
        /// Ratio of the extreme singular values of the wrench matrix.
        ratio: f64,
        /// Least ratio that is accepted.
        least: f64,
    },
    /// The surface that it should touch is not reached from it.
    #[error("the actuators' ranges do not lead from it to the plane")]
    NoContact,
    /// Machines drawn from the tolerances do not reach it.
    #[error(
        "of {machines} machines drawn from the tolerances too many do not reach it: its loops do not close on home's \
         branch, or a passive joint leaves its range"
    )]
    Unreached {
        /// Machines by which it was judged.
        machines: usize,
    },
    /// A joint leaves the range of the drawing.
    #[error("{joint} leaves its range")]
    OutOfRange {
        /// The joint.
        joint: String,
    },
}

/// Postures that could be measured, and those that could not.
#[derive(Clone, Debug, Default)]
pub struct Candidates {
    /// Fit to be measured.
    pub fit: Vec<Candidate>,
    /// Names of the others, with the reasons.
    pub unfit: Vec<(String, Unfit)>,
}

/// Why there is nothing to plan with.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DesignError {
    /// No posture is fit.
    #[error(
        "the workspace is empty: none of the {tried} candidates can be measured; {name}: {why}; \
         are the ranges of the actuators and the least regularity right?"
    )]
    Empty {
        /// Candidates tried.
        tried: usize,
        /// One of them.
        name: String,
        /// Why it is unfit.
        why: String,
    },
    /// Fewer candidates than postures wanted.
    #[error(
        "{found} candidates can be measured, fewer than the {wanted} poses asked for{others}; offer more"
    )]
    TooFew {
        /// Candidates that are fit.
        found: usize,
        /// Postures wanted.
        wanted: usize,
        /// How many are unfit, and why the first of them is; empty where all are fit.
        others: String,
    },
    /// More candidates than can be held.
    #[error("{found} candidates are too many: the limit is {MOST}; take a coarser grid or random postures")]
    TooMany {
        /// Candidates offered.
        found: usize,
    },
    /// More readings of one posture than are held of a candidate.
    #[error(
        "{found} readings of one posture are more than a plan can weigh ({ROWS}); name the sensors that matter most in \
         data.joints"
    )]
    TooManyReadings {
        /// Readings of a posture.
        found: usize,
    },
    /// The linearisation failed.
    #[error("the candidates cannot be linearised: {0}")]
    Evaluate(String),
    /// Nothing depends on the postures.
    #[error(
        "no candidate tells anything about any link: every link is held, or the tolerances are far below the noise"
    )]
    Blind,
}

impl Candidates {
    /// Sorts postures (name, actuator variables) into fit and unfit at nominal geometry, on home's branch; `least` is the
    /// smallest ratio of extreme singular values of the wrench matrix that is accepted.
    pub fn admit(mechanism: &Mechanism, postures: Vec<(String, Vec<f64>)>, least: f64) -> Self {
        let nominal = mechanism.nominal();
        let checked: Vec<Result<Candidate, (String, Unfit)>> = postures
            .into_par_iter()
            .map(|(name, actuators)| {
                let fit = close(mechanism, &nominal, &actuators)
                    .map_err(Unfit::from)
                    .and_then(|posture| check(mechanism, &posture, least).map(|()| posture.tool()));
                match fit {
                    Ok(pose) => Ok(Candidate { name, actuators, pose }),
                    Err(why) => Err((name, why)),
                }
            })
            .collect();
        let mut candidates = Self::default();
        for one in checked {
            match one {
                Ok(fit) => candidates.fit.push(fit),
                Err(unfit) => candidates.unfit.push(unfit),
            }
        }
        candidates
    }

    /// `count` random postures in the actuators' ranges that are fit; fewer where the workspace is a small part of them.
    pub fn random(mechanism: &Mechanism, count: usize, seed: u64, least: f64) -> Self {
        let ranges = actuator_ranges(mechanism);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(STREAM);
        let mut found = Self::default();
        let mut tried = 0;
        while found.fit.len() < count && tried < TRIES * count {
            // Drawn in order and closed in parallel: the same whatever the number of threads.
            let batch = (count - found.fit.len()).max(32).min(TRIES * count - tried);
            let drawn: Vec<(String, Vec<f64>)> = (0..batch)
                .map(|k| {
                    let values = ranges.iter().map(|(low, high)| low + rng.random::<f64>() * (high - low));
                    (format!("random posture {}", tried + k + 1), values.collect())
                })
                .collect();
            tried += batch;
            let checked = Self::admit(mechanism, drawn, least);
            found.fit.extend(checked.fit);
            found.unfit.extend(checked.unfit);
        }
        found.fit.truncate(count);
        found
    }

    /// `steps` values of every actuator, evenly over its range with both ends (the middle where `steps` is 1).
    pub fn grid(mechanism: &Mechanism, steps: usize, least: f64) -> Result<Self, DesignError> {
        let ranges = actuator_ranges(mechanism);
        let total = ranges.iter().try_fold(1usize, |n, _| n.checked_mul(steps)).unwrap_or(usize::MAX);
        if total > MOST {
            return Err(DesignError::TooMany { found: total });
        }
        let at = |(low, high): (f64, f64), k: usize| match steps {
            1 => 0.5 * (low + high),
            _ => low + (high - low) * k as f64 / (steps - 1) as f64,
        };
        let postures = (0..total).map(|n| {
            let mut rest = n;
            let values = ranges.iter().map(|range| {
                let k = rest % steps;
                rest /= steps;
                at(*range, k)
            });
            (format!("grid posture {}", n + 1), values.collect())
        });
        Ok(Self::admit(mechanism, postures.collect(), least))
    }

    /// The postures led to where `blanks`, which they take in turn, touch their surfaces; the longest such list in which
    /// none is missing.
    pub fn touching(mut self, mechanism: &Mechanism, blanks: &[Arc<dyn Measurement>], least: f64) -> Self {
        let nominal = mechanism.nominal();
        let mut lists = Vec::with_capacity(blanks.len());
        for (turn, blank) in blanks.iter().enumerate() {
            let own: Vec<&Candidate> = self.fit.iter().skip(turn).step_by(blanks.len()).collect();
            let led: Vec<Option<Vec<f64>>> = own
                .par_iter()
                .map(|c| touch(mechanism, &nominal, &**blank, c.actuators.clone(), 0.0))
                .collect();
            let mut postures = Vec::with_capacity(led.len());
            for (candidate, led) in own.into_iter().zip(led) {
                match led {
                    Some(actuators) => postures.push((candidate.name.clone(), actuators)),
                    None => self.unfit.push((candidate.name.clone(), Unfit::NoContact)),
                }
            }
            let admitted = Self::admit(mechanism, postures, least);
            self.unfit.extend(admitted.unfit);
            lists.push(admitted.fit.into_iter());
        }
        self.fit = Vec::new();
        while let Some(round) = lists.iter_mut().map(Iterator::next).collect::<Option<Vec<_>>>() {
            if round.is_empty() {
                break;
            }
            self.fit.extend(round);
        }
        self
    }

    /// Refuses an empty workspace, and too few or too many candidates for `wanted` postures; `told` puts into words why a
    /// posture is unfit.
    pub fn require(&self, wanted: usize, told: &dyn Fn(&Unfit) -> String) -> Result<(), DesignError> {
        let found = self.fit.len();
        match self.unfit.first() {
            Some((name, why)) if found == 0 => {
                let tried = self.unfit.len();
                Err(DesignError::Empty { tried, name: name.clone(), why: told(why) })
            }
            first if found < wanted => {
                let others = first.map_or_else(String::new, |(name, why)| {
                    format!(" ({} others cannot; {name}: {})", self.unfit.len(), told(why))
                });
                Err(DesignError::TooFew { found, wanted, others })
            }
            _ if found > MOST => Err(DesignError::TooMany { found }),
            _ => Ok(()),
        }
    }
}

/// Whether every joint is within its range and the posture is regular.
fn check(mechanism: &Mechanism, posture: &Posture, least: f64) -> Result<(), Unfit> {
    in_range(mechanism, posture)?;
    if mechanism.is_open_chain() {
        return Ok(());
    }
    let ratio = posture.regularity();
    if ratio < least { Err(Unfit::Singular { ratio, least }) } else { Ok(()) }
}

/// Whether every joint, passive ones too, is within its range.
pub(super) fn in_range(mechanism: &Mechanism, posture: &Posture) -> Result<(), Unfit> {
    let joints = mechanism.limbs.iter().flat_map(|limb| limb.joints.iter().map(move |joint| (limb, joint)));
    for ((limb, joint), q) in joints.zip(&posture.q) {
        let Some((low, high)) = joint.range else { continue };
        let (reading, slack) = (q + joint.home, SLACK * (high - low));
        if reading < low - slack || reading > high + slack {
            return Err(Unfit::OutOfRange { joint: format!("{}.{}", limb.name, joint.name) });
        }
    }
    Ok(())
}
