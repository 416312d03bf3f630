//! Which samples take part, and from where each is closed.

use super::closing::{Closer, Closing, STANDS_OUT, typical};
use super::postures::{ByPosture, by_posture};
use super::sample::{Postures, Sample, SetAside, close_again};
use crate::measure::ClosedAt;
use crate::model::{Geometry, Mechanism, NotClosed, Turn};
use rayon::prelude::*;
use std::iter;
use std::ops::Range;

/// Mean square of a sample's residuals, in that of the median sample, beyond which it waits until the others were
/// identified from.
const WAITS: f64 = 400.0;

/// A measured posture that takes part, and from where it is closed.
#[derive(Clone, Debug)]
pub(super) struct Start<'a> {
    /// The first of its samples.
    pub sample: &'a Sample,
    /// The others.
    pub others: Vec<&'a Sample>,
    /// Among all postures.
    pub index: usize,
    pub closing: Closing,
}

impl<'a> Start<'a> {
    pub fn samples(&self) -> impl Iterator<Item = &'a Sample> {
        iter::once(self.sample).chain(self.others.iter().copied())
    }

    /// Number of residuals.
    pub fn rows(&self) -> usize {
        self.samples().map(|sample| sample.measurement.rows()).sum()
    }
}

/// Another posture in which one closes.
#[derive(Clone, Debug)]
pub struct OtherPosture(Closing);

impl OtherPosture {
    /// Mean square of the whitened residuals there.
    pub fn square(&self) -> f64 {
        self.0.square
    }
}

/// What became of the samples.
#[derive(Clone, Debug, Default)]
pub(super) struct Starts<'a> {
    /// Postures that take part.
    pub taking: Vec<Start<'a>>,
    /// Samples that do not, and why.
    pub set_aside: Vec<SetAside>,
    /// Postures that close, but are set aside.
    waiting: Vec<(usize, Closing)>,
    /// Postures that take no part whatever closes, and why.
    excluded: Vec<(usize, NotClosed)>,
}

/// A machine with its links, and its postures at home.
type Machine<'a> = (&'a Mechanism, &'a Geometry, &'a Postures);

impl<'a> Starts<'a> {
    /// Closes every sample, from where it was closed before, as [`super::Calibration::take_back`] says.
    pub fn take_back(
        &mut self,
        (mechanism, geometry, home): Machine<'_>,
        samples: &'a [Sample],
        least: f64,
    ) -> bool {
        let (by_posture, postures) = (ByPosture::of(samples), by_posture(samples));
        let closer = Closer { mechanism, geometry, home, postures: &postures, regularity: least > 0.0 };
        let closed = closer.close(&self.known(postures.len()));
        let typical = typical(&closed);
        let before: Vec<usize> = self.taking.iter().map(|start| start.index).collect();
        self.taking.clear();
        self.waiting.clear();
        self.set_aside.clear();
        for (index, (of, outcome)) in by_posture.iter().zip(closed).enumerate() {
            let excluded = self.excluded.iter().find(|(i, _)| *i == index);
            let reason = match (&outcome, excluded) {
                (Err(why), _) | (Ok(_), Some((_, why))) => Some(why.clone()),
                (Ok(at), None) if at.regularity < least => {
                    Some(NotClosed::Singular { smallest: at.regularity })
                }
                (Ok(at), None) if least > 0.0 && at.square > WAITS * typical => {
                    Some(NotClosed::Unlike { times: (at.square / typical).sqrt() })
                }
                (Ok(_), None) => None,
            };
            match (reason, outcome) {
                (None, Ok(closing)) => {
                    let Some((first, others)) = of.split_first() else { continue };
                    let others = others.iter().map(|i| &samples[*i]).collect();
                    self.taking.push(Start { sample: &samples[*first], others, index, closing });
                }
                (None, Err(_)) => {}
                (Some(reason), outcome) => {
                    self.waiting.extend(outcome.ok().map(|closing| (index, closing)));
                    let name = |i: usize| samples[i].name.clone();
                    self.set_aside.extend(of.iter().map(|i| SetAside {
                        sample: *i,
                        name: name(*i),
                        reason: reason.clone(),
                    }));
                }
            }
        }
        self.set_aside.sort_by_key(|aside| aside.sample);
        let same = self.taking.iter().map(|start| start.index).eq(before);
        !same || self.taking.iter().any(|start| !start.closing.kept)
    }

    /// Tries other postures for the samples `doubted`, as [`super::Calibration::reconsider`] says.
    pub fn reconsider(
        &mut self,
        (mechanism, geometry, home): Machine<'_>,
        samples: &[Sample],
        doubted: &[usize],
    ) -> bool {
        let (by_posture, postures) = (ByPosture::of(samples), by_posture(samples));
        let closer = Closer { mechanism, geometry, home, postures: &postures, regularity: false };
        let closed = closer.follow(&self.known(postures.len()));
        let limit = STANDS_OUT * typical(&closed);
        let mut any = false;
        let doubted = by_posture.iter().enumerate().filter(|(_, of)| of.iter().any(|i| doubted.contains(i)));
        for index in doubted.map(|(index, _)| index) {
            let Some(Ok(here)) = closed.get(index) else { continue };
            let fits = |found: &Closing| found.square <= limit;
            let followed = closer.elsewhere(index, &closed, limit).filter(fits);
            let reached = followed.as_ref().is_some_and(|there| here.mode == there.mode);
            let Some(there) = followed.or_else(|| closer.turned_over(index, &closed, limit).filter(fits))
            else {
                continue;
            };
            any = true;
            if !reached {
                let (followed, measured) = (here.square.sqrt(), there.square.sqrt());
                self.excluded.push((index, NotClosed::Elsewhere { followed, measured }));
                continue;
            }
            match self.taking.iter_mut().find(|start| start.index == index) {
                Some(start) => start.closing = there,
                None => self.waiting.push((index, there)),
            }
        }
        any
    }

    /// Other postures in which each `wanted` one of those that take part closes, as [`super::Calibration::alternatives`] says.
    pub fn alternatives(
        &self,
        (mechanism, geometry, home): Machine<'_>,
        samples: &[Sample],
        wanted: &[usize],
    ) -> Vec<Vec<OtherPosture>> {
        let postures = by_posture(samples);
        let closer = Closer { mechanism, geometry, home, postures: &postures, regularity: false };
        let closed = closer.follow(&self.known(postures.len()));
        let limit = STANDS_OUT * typical(&closed);
        let drawn = mechanism.nominal();
        let of = |wanted: &usize| {
            let Some(start) = self.taking.get(*wanted) else { return Vec::new() };
            let others = closer.all_elsewhere(start.index, &closed, limit, &drawn);
            others.into_iter().map(OtherPosture).collect()
        };
        wanted.par_iter().map(of).collect()
    }

    /// The same, one that takes part to be closed elsewhere.
    pub fn closed_in(&self, posture: usize, other: &OtherPosture) -> Self {
        let mut elsewhere = self.clone();
        elsewhere.taking.iter_mut().skip(posture).take(1).for_each(|start| start.closing = other.0.clone());
        elsewhere
    }

    /// Whether a posture that takes part stays near where it is closed, and elsewhere than in `before`.
    pub fn is_apart(&self, (mechanism, geometry, home): Machine<'_>, posture: usize, before: &Self) -> bool {
        let closer = Closer { mechanism, geometry, home, postures: &[], regularity: false };
        let closed = |starts: &Self| {
            let start = starts.taking.get(posture)?;
            let mut at = home.first.clone();
            close_again(mechanism, geometry, &start.closing.turns, &mut at).then(|| at.turns().to_vec())
        };
        match (closed(self), closed(before)) {
            (Some(here), Some(there)) => closer.are_apart(&here, &there),
            (here, _) => here.is_some(),
        }
    }

    /// Where each of `count` postures was closed last.
    fn known(&self, count: usize) -> Vec<Option<Closing>> {
        let mut known = vec![None; count];
        let taking = self.taking.iter().map(|start| (start.index, &start.closing));
        for (index, closing) in taking.chain(self.waiting.iter().map(|(index, closing)| (*index, closing))) {
            if let Some(place) = known.get_mut(index) {
                *place = Some(closing.clone());
            }
        }
        known
    }

    /// The samples, those that close to be closed from where they are closed here.
    pub fn closed(&self, samples: &[Sample]) -> Vec<Sample> {
        let by_posture = ByPosture::of(samples);
        let turns = |turns: &[Turn]| turns.iter().map(|turn| turn.q).collect();
        let mut closed = samples.to_vec();
        for (of, known) in by_posture.iter().zip(self.known(by_posture.count())) {
            let Some(known) = known else { continue };
            let at = ClosedAt { first: turns(&known.turns), second: turns(&known.second) };
            of.iter().for_each(|i| closed[*i] = samples[*i].closed_at(at.clone()));
        }
        closed
    }

    /// With these only of the postures that take part.
    pub fn only(&self, postures: Range<usize>) -> Self {
        let taking = self.taking.get(postures).unwrap_or_default().to_vec();
        Self { taking, ..Self::default() }
    }
}
