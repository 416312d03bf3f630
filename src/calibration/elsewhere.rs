//! Other postures at the actuator variables of a sample (docs/theory.md section 7).

use super::closing::{Closer, Closing, Together, Work};
use super::postures::telling;
use super::sample::{Postures, Sample, close_at};
use crate::lie::Se3;
use crate::model::inverse::{
    close_along, close_as_solved, close_by_path, passive_at_pose, passive_turned_over,
};
use crate::model::{Geometry, Mechanism, Motion, NotClosed, Turn};
use std::f64::consts::TAU;

/// Part of its mean square below which another posture explains a reading better than chance does.
const BETTER: f64 = 0.1;
/// Nearest samples from which paths are followed.
const NEIGHBOURS: usize = 3;
/// Way of a joint (rad, machine sizes) between two postures that are not one.
const APART: f64 = 0.02;

/// Passive joints that bring each limb near a pose.
type Inverse = fn(&Mechanism, &Geometry, &[f64], &[f64], &Se3) -> Vec<f64>;

/// Whether two postures of a machine of size `length` (m) differ; a revolute joint is where it was after a whole turn.
pub fn are_apart(mechanism: &Mechanism, length: f64, a: &[Turn], b: &[Turn]) -> bool {
    let joints = mechanism.limbs.iter().flat_map(|limb| &limb.joints);
    joints.zip(a.iter().zip(b)).any(|(joint, (a, b))| {
        let way = a.q - b.q;
        let way = if joint.motion == Motion::Revolute { way - TAU * (way / TAU).round() } else { way };
        joint.motion.size_of(way, length) > APART
    })
}

impl Closer<'_> {
    /// The posture of a sample, other than that in which it is closed, that explains its reading far better or, where it
    /// is not closed, with a mean square up to `limit`. Postures from which to look are those that do not exceed that.
    pub fn elsewhere(
        &self,
        index: usize,
        closed: &[Result<Closing, NotClosed>],
        limit: f64,
    ) -> Option<Closing> {
        self.found_elsewhere(index, closed, limit, passive_at_pose)
    }

    /// The same, each limb's passive joints as the measured pose alone wants them: on branches that no path leads to.
    pub fn turned_over(
        &self,
        index: usize,
        closed: &[Result<Closing, NotClosed>],
        limit: f64,
    ) -> Option<Closing> {
        self.found_elsewhere(index, closed, limit, passive_turned_over)
    }

    fn found_elsewhere(
        &self,
        index: usize,
        closed: &[Result<Closing, NotClosed>],
        limit: f64,
        inverse: Inverse,
    ) -> Option<Closing> {
        let mut least = match closed.get(index)? {
            Ok(closing) => BETTER * closing.square,
            Err(_) => limit,
        };
        let mut best = None;
        self.search(index, closed, limit, (&[inverse], &[]), &mut |found| {
            if found.square < least {
                least = found.square;
                best = Some(found);
            }
        });
        best
    }

    /// All postures that are found at the actuator variables of a closed sample, other than that in which it is closed:
    /// also from where the `drawn` links close, with limbs turned over, and with screws turned once more.
    pub fn all_elsewhere(
        &self,
        index: usize,
        closed: &[Result<Closing, NotClosed>],
        limit: f64,
        drawn: &Geometry,
    ) -> Vec<Closing> {
        let Some(Ok(here)) = closed.get(index) else { return Vec::new() };
        let Some(sample) = self.postures.get(index).and_then(|of| telling(of.iter().copied())) else {
            return Vec::new();
        };
        let mut starts = self.screws_turned(here);
        let mut posture = self.home.first.clone();
        if close_by_path(self.mechanism, drawn, &sample.actuators, &mut posture).is_ok() {
            starts.push(posture.passive(self.mechanism));
        }
        let mut all: Vec<Closing> = Vec::new();
        let inverses: [Inverse; 2] = [passive_at_pose, passive_turned_over];
        self.search(index, closed, limit, (&inverses, &starts), &mut |found| {
            if found.square.is_finite()
                && all.iter().chain([here]).all(|known| self.are_apart(&found.turns, &known.turns))
            {
                all.push(found);
            }
        });
        all
    }

    /// Every posture that is found at the actuator variables of a sample: by paths; and by what was measured, from the
    /// passive joints there and from `starts`.
    fn search(
        &self,
        index: usize,
        closed: &[Result<Closing, NotClosed>],
        limit: f64,
        (inverses, starts): (&[Inverse], &[Vec<f64>]),
        visit: &mut dyn FnMut(Closing),
    ) {
        let Some(of) = self.postures.get(index) else { return };
        let Some(sample) = telling(of.iter().copied()) else { return };
        let mut work = self.work();
        let mut judge = |work: &mut Work| visit(self.closing(of, work));
        let near = self.neighbours(index, closed, limit);
        let mut passives = vec![vec![0.0; self.passive_count()]];
        if close_by_path(self.mechanism, self.geometry, &sample.actuators, &mut work.0.first).is_ok() {
            passives.push(work.0.first.passive(self.mechanism));
            if self.close_second(sample, &mut work.0) {
                judge(&mut work);
            }
        }
        if let Some(Ok(here)) = closed.get(index) {
            work.0.first.set_turns(&here.turns);
            passives.push(work.0.first.passive(self.mechanism));
        }
        for closing in near {
            work.0.first.set_turns(&closing.turns);
            passives.push(work.0.first.passive(self.mechanism));
            let first = &mut work.0.first;
            let along = |first| close_along(self.mechanism, self.geometry, first, &sample.actuators);
            if first.close(self.mechanism, self.geometry).and_then(|()| along(first)).is_ok()
                && self.close_second(sample, &mut work.0)
            {
                judge(&mut work);
            }
        }
        passives.extend_from_slice(starts);
        let Some(pose) = sample.measurement.pose() else { return };
        for passive in &passives {
            for inverse in inverses {
                let solved = inverse(self.mechanism, self.geometry, &sample.actuators, passive, pose);
                let start = (sample.actuators.as_slice(), solved.as_slice());
                if close_as_solved(self.mechanism, self.geometry, start, &mut work.0.first).is_ok()
                    && self.close_second(sample, &mut work.0)
                {
                    judge(&mut work);
                }
            }
        }
    }

    /// Passive joints of a closed posture with one of the screws turned once, forth or back.
    fn screws_turned(&self, here: &Closing) -> Vec<Vec<f64>> {
        let joints = self.mechanism.limbs.iter().flat_map(|limb| &limb.joints).zip(&here.turns);
        let passive: Vec<(bool, f64)> = joints
            .filter(|(joint, _)| !joint.actuated)
            .map(|(joint, turn)| (matches!(joint.motion, Motion::Helical { .. }), turn.q))
            .collect();
        let mut turned = Vec::new();
        for (screw, _) in passive.iter().enumerate().filter(|(_, (screw, _))| *screw) {
            for turn in [TAU, -TAU] {
                let at = |(i, (_, q)): (usize, &(bool, f64))| if i == screw { q + turn } else { *q };
                turned.push(passive.iter().enumerate().map(at).collect());
            }
        }
        turned
    }

    /// Whether two postures differ.
    pub fn are_apart(&self, a: &[Turn], b: &[Turn]) -> bool {
        are_apart(self.mechanism, self.home.first.length(), a, b)
    }

    fn passive_count(&self) -> usize {
        self.mechanism.limbs.iter().map(|limb| limb.passive_count()).sum()
    }

    fn close_second(&self, sample: &Sample, postures: &mut Postures) -> bool {
        let Some(actuators) = sample.measurement.second() else { return true };
        close_at(self.mechanism, self.geometry, actuators, None, &mut postures.second).is_ok()
    }

    /// The nearest samples, by actuator variables, whose readings do not stand out.
    fn neighbours<'b>(
        &'b self,
        index: usize,
        closed: &'b [Result<Closing, NotClosed>],
        limit: f64,
    ) -> Vec<&'b Closing>
    where
        Self: 'b,
    {
        let joints = self.mechanism.limbs.iter().flat_map(|limb| &limb.joints).filter(|joint| joint.actuated);
        let sizes: Vec<f64> =
            joints.map(|joint| joint.motion.size_of(1.0, self.home.first.length())).collect();
        let readings =
            |of: &'b Together<'_>| of.first().map_or(&[][..], |sample| sample.actuators.as_slice());
        let here = readings(&self.postures[index]);
        let apart = |there: &[f64]| -> f64 {
            here.iter().zip(there).zip(&sizes).map(|((a, b), size)| ((a - b) * size).powi(2)).sum()
        };
        let mut near: Vec<(f64, &Closing)> = closed
            .iter()
            .zip(self.postures)
            .enumerate()
            .filter(|(i, _)| *i != index)
            .filter_map(|(_, (outcome, of))| Some((apart(readings(of)), outcome.as_ref().ok()?)))
            .filter(|(_, closing)| closing.square <= limit)
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.into_iter().take(NEIGHBOURS).map(|(_, closing)| closing).collect()
    }
}
