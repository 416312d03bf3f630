//! Noise from repeated measurements: postures measured more than once with the same readings differ by noise alone.

use super::reading::{Reading, postures};
use crate::lie::so3;
use nalgebra::Vector3;

/// Repeats that scatter by less than this part of the stated noise are one reading, copied.
const COPIED: f64 = 1e-6;

/// Pooled noise of groups of equal readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Repeats {
    /// Groups of two or more.
    pub groups: usize,
    /// Measurements in them.
    pub samples: usize,
    /// Standard deviation of each rotation component, rad; `None` where no rotation was measured.
    pub angle: Option<f64>,
    /// Standard deviation of each length, m.
    pub length: f64,
    /// Degrees of freedom of either: three for every measurement beyond a group's first.
    pub freedom: usize,
}

impl Repeats {
    /// Whether nothing that was measured differs within any group, beside the stated noise (`length` in m, `angle` in
    /// rad): the readings are copies.
    pub fn are_copies(&self, length: f64, angle: f64) -> bool {
        self.length <= COPIED * length && self.angle.is_none_or(|found| found <= COPIED * angle)
    }

    /// How many of its own standard errors the variance of a pooled value `found` is from that of the `stated` one.
    pub fn surprise(&self, found: f64, stated: f64) -> f64 {
        ((found / stated).powi(2) - 1.0) * (self.freedom as f64 / 2.0).sqrt()
    }
}

/// The noise that repeated postures show; `None` where none is repeated.
pub fn repeats(data: &[Reading]) -> Option<Repeats> {
    let mut groups: Vec<Vec<&Reading>> = Vec::new();
    for posture in postures(data) {
        // Targets of one posture are different things, each of which may be measured again.
        let first = groups.len();
        for reading in posture.iter().filter_map(|k| data.get(*k)) {
            let of_posture = groups.get_mut(first..).unwrap_or_default();
            let same = |group: &&mut Vec<&Reading>| {
                group.first().is_some_and(|other| other.target == reading.target)
            };
            match of_posture.iter_mut().find(same) {
                Some(group) => group.push(reading),
                None => groups.push(vec![reading]),
            }
        }
    }
    groups.retain(|group| group.len() > 1);
    let (mut position, mut rotation, mut freedom) = (0.0, 0.0, 0);
    for group in &groups {
        freedom += 3 * (group.len() - 1);
        position += scatter(&group.iter().map(|reading| reading.position).collect::<Vec<_>>());
        let first = group.first()?.rotation;
        let turns: Option<Vec<Vector3<f64>>> =
            group.iter().map(|reading| Some(so3::log(&(reading.rotation? * first?.transpose())))).collect();
        rotation += turns.map_or(f64::NAN, |turns| scatter(&turns));
    }
    let sigma = |square: f64| (square / freedom as f64).sqrt();
    let samples = groups.iter().map(Vec::len).sum();
    (freedom > 0).then(|| Repeats {
        groups: groups.len(),
        samples,
        angle: Some(sigma(rotation)).filter(|angle| angle.is_finite()),
        length: sigma(position),
        freedom,
    })
}

/// Sum of squares about the mean.
fn scatter(values: &[Vector3<f64>]) -> f64 {
    let mean = values.iter().sum::<Vector3<f64>>() / values.len() as f64;
    values.iter().map(|v| (v - mean).norm_squared()).sum()
}
