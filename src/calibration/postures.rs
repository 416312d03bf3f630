//! Which samples are of one posture: those whose actuator readings are equal.
//!
//! A posture is what an estimate learns from, what is held out, left out and counted: samples of one posture share
//! whatever is wrong with it.

use super::sample::Sample;
use std::cmp::Ordering;
use std::ops::Range;

/// Samples by posture: postures in the order of their first samples, the samples of each in their own order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ByPosture {
    /// Indices of the samples, posture by posture.
    members: Vec<usize>,
    /// Where each posture's members end.
    ends: Vec<usize>,
}

impl ByPosture {
    /// Groups samples by their actuator variables, and by those of the second posture where two are compared.
    pub fn of(samples: &[Sample]) -> Self {
        Self::of_readings(samples.len(), |i| {
            samples.get(i).map_or((&[], None), |s| (&s.actuators, s.measurement.second()))
        })
    }

    /// Groups `count` things by equal readings: of one posture, and of a second one where there is one.
    pub fn of_readings<'a>(count: usize, readings: impl Fn(usize) -> (&'a [f64], Option<&'a [f64]>)) -> Self {
        let compared = |a: usize, b: usize| {
            let ((a, second_a), (b, second_b)) = (readings(a), readings(b));
            compare(a, b).then_with(|| match (second_a, second_b) {
                (Some(a), Some(b)) => compare(a, b),
                (a, b) => a.is_some().cmp(&b.is_some()),
            })
        };
        let mut sorted: Vec<usize> = (0..count).collect();
        sorted.sort_by(|a, b| compared(*a, *b));
        let same = |a: &usize, b: &usize| compared(*a, *b).is_eq();
        if !sorted.windows(2).any(|pair| same(&pair[0], &pair[1])) {
            return Self { members: (0..count).collect(), ends: (1..=count).collect() };
        }
        // The sort is stable: each group begins with its first sample.
        let mut groups: Vec<&[usize]> = sorted.chunk_by(same).collect();
        groups.sort_by_key(|group| group.first().copied());
        let mut members = Vec::with_capacity(count);
        let mut ends = Vec::with_capacity(groups.len());
        for group in groups {
            members.extend_from_slice(group);
            ends.push(members.len());
        }
        Self { members, ends }
    }

    /// Number of postures.
    pub fn count(&self) -> usize {
        self.ends.len()
    }

    /// Number of samples.
    pub fn sample_count(&self) -> usize {
        self.members.len()
    }

    /// Whether some posture has several samples.
    pub fn has_several(&self) -> bool {
        self.count() < self.sample_count()
    }

    fn range(&self, posture: usize) -> Range<usize> {
        let start = posture.checked_sub(1).map_or(0, |before| self.ends[before]);
        start..self.ends[posture]
    }

    /// Indices of the samples of each posture, ascending.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &[usize]> {
        (0..self.count()).map(|posture| &self.members[self.range(posture)])
    }

    /// Indices of all samples of these postures, ascending.
    pub fn samples_of(&self, postures: &[usize]) -> Vec<usize> {
        let all = postures.iter().filter(|posture| **posture < self.count());
        let mut samples: Vec<usize> =
            all.flat_map(|p| self.members[self.range(*p)].iter().copied()).collect();
        samples.sort_unstable();
        samples
    }

    /// Indices of the samples, so divided that no part has two of one posture: the first samples of all postures, the
    /// second ones, and so on; ascending. One part at least.
    pub fn apart(&self) -> Vec<Vec<usize>> {
        let most = self.iter().map(<[usize]>::len).max().unwrap_or(1);
        let mut parts = vec![Vec::new(); most];
        for group in self.iter() {
            parts.iter_mut().zip(group).for_each(|(part, sample)| part.push(*sample));
        }
        parts.iter_mut().for_each(|part| part.sort_unstable());
        parts
    }
}

/// The samples themselves, posture by posture.
pub fn by_posture(samples: &[Sample]) -> Vec<Vec<&Sample>> {
    ByPosture::of(samples).iter().map(|of| of.iter().map(|i| &samples[*i]).collect()).collect()
}

/// The sample by which a posture is closed: a whole pose tells its assembly mode; where none was measured, the first.
pub fn telling<'s>(samples: impl Iterator<Item = &'s Sample> + Clone) -> Option<&'s Sample> {
    samples.clone().find(|sample| sample.measurement.pose().is_some()).or_else(|| samples.clone().next())
}

/// Numbers in order, -0 and 0 being one; equal only where all bits are.
fn compare(a: &[f64], b: &[f64]) -> Ordering {
    let mut each = a.iter().zip(b).map(|(a, b)| (a + 0.0).total_cmp(&(b + 0.0)));
    each.find(|order| order.is_ne()).unwrap_or_else(|| a.len().cmp(&b.len()))
}

/// What a posture is called after the names of its samples: by the first and the last of several.
pub fn posture_name(names: &[&str]) -> String {
    match names {
        [] => String::new(),
        [only] => (*only).to_owned(),
        [first, second] => format!("{first} and {second}"),
        [first, .., last] => format!("{first} to {last} ({} samples)", names.len()),
    }
}
