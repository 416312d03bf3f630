//! What was seen of the tool at each posture: its pose, or a point of it.
//!
//! Three targets that do not lie on one line give a pose. Where the targets are known, it is that of the tool; where they are
//! free, it is where the first posture's targets went, and the tool counts as free.

use super::reading::Reading;
use crate::lie::{Se3, so3};
use crate::measure::Point;
use crate::model::{Mechanism, Prior};
use nalgebra::{Matrix3, Vector3};

/// Least second singular value of the places of targets, relative to the first, at which they do not lie on a line.
const OFF_LINE: f64 = 0.05;
/// Least spread of positions that counts, machine sizes, and of rotations, rad: below, a machine hardly moved.
const HARDLY: [f64; 2] = [0.01, 0.05];

/// Of each posture, in its order.
#[derive(Clone, Debug)]
pub(super) enum Seen {
    /// Poses.
    Poses(Vec<Option<Se3>>),
    /// Places of one point of the tool (m), and where it is in the tool's frame.
    Points(Vec<Option<Vector3<f64>>>, Vector3<f64>),
}

/// Observations of all postures.
#[derive(Clone, Debug)]
pub(super) struct Observed {
    pub seen: Seen,
    /// Whether nothing is known of the point, or of the frame whose pose was seen.
    pub loose: bool,
    /// Root mean square distance of the positions from their mean, m, and of the rotations from theirs, rad.
    pub spread: [f64; 2],
    /// The same, at least what counts.
    pub scale: [f64; 2],
}

impl Observed {
    /// Of `postures`, lists of indices of `data`.
    pub fn new(mechanism: &Mechanism, data: &[Reading], postures: &[Vec<usize>]) -> Option<Self> {
        let first = |list: &Vec<usize>| list.first().and_then(|k| data.get(*k));
        let (seen, loose) = if data.iter().all(|reading| reading.rotation.is_some()) {
            (Seen::Poses(postures.iter().map(|list| first(list)?.pose()).collect()), false)
        } else {
            let targets = Targets::new(mechanism, data, postures);
            let loose = targets.loose;
            match targets.poses(loose) {
                Some(poses) => (Seen::Poses(poses), loose),
                None => {
                    let (points, at) = targets.most_common()?;
                    (Seen::Points(points, at), loose)
                }
            }
        };
        let (positions, rotations): (Vec<Vector3<f64>>, Vec<Matrix3<f64>>) = match &seen {
            Seen::Poses(poses) => poses.iter().flatten().map(|pose| (pose.p, pose.r)).unzip(),
            Seen::Points(points, _) => (points.iter().flatten().copied().collect(), Vec::new()),
        };
        let spread = [spread(&positions), turn_spread(&rotations)];
        let length = mechanism.characteristic_length();
        let scale = [spread[0].max(HARDLY[0] * length), spread[1].max(HARDLY[1])];
        spread.iter().all(|v| v.is_finite()).then_some(Self { seen, loose, spread, scale })
    }

    /// Whether positions or rotations spread as those of a machine that moves.
    pub fn moves(&self) -> bool {
        self.spread.iter().zip(&self.scale).any(|(spread, scale)| spread >= scale)
    }
}

fn spread(positions: &[Vector3<f64>]) -> f64 {
    let count = positions.len().max(1) as f64;
    let mean = positions.iter().sum::<Vector3<f64>>() / count;
    (positions.iter().map(|p| (p - mean).norm_squared()).sum::<f64>() / count).sqrt()
}

fn turn_spread(rotations: &[Matrix3<f64>]) -> f64 {
    let Some(mean) = so3::nearest(&rotations.iter().sum()).map(|near| near.rotation) else { return 0.0 };
    let square: f64 = rotations.iter().map(|r| so3::log(&(mean.transpose() * r)).norm_squared()).sum();
    (square / rotations.len().max(1) as f64).sqrt()
}

/// A target: its place in the tool's frame as far as it is known, by which targets are told apart.
type Key = (Option<usize>, [u64; 3]);

/// A target that is seen: which, its nominal place in the tool's frame and the measured one, m.
type Sight = (Key, Vector3<f64>, Vector3<f64>);

/// The places of one target by posture, and where it is in the tool's frame, m.
type Track = (Vec<Option<Vector3<f64>>>, Vector3<f64>);

struct Targets<'a> {
    /// Of each posture the targets seen.
    seen: Vec<Vec<Sight>>,
    loose: bool,
    data: &'a [Reading],
}

impl<'a> Targets<'a> {
    fn new(mechanism: &Mechanism, data: &'a [Reading], postures: &[Vec<usize>]) -> Self {
        let is_free = |k: usize| mechanism.instrument.get(k).is_some_and(|c| c.prior == Prior::Free);
        let nominal = mechanism.nominal().instrument;
        let key = |t: &Point| (t.constants, [t.nominal.x, t.nominal.y, t.nominal.z].map(f64::to_bits));
        let of = |list: &Vec<usize>| {
            let mut seen: Vec<(Key, Vector3<f64>, Vector3<f64>)> = Vec::new();
            for reading in list.iter().filter_map(|k| data.get(*k)) {
                let key = key(&reading.target);
                if !seen.iter().any(|(other, _, _)| *other == key) {
                    seen.push((key, reading.target.at(&nominal), reading.position));
                }
            }
            seen
        };
        let loose = data.iter().filter_map(|reading| reading.target.constants).any(is_free);
        Self { seen: postures.iter().map(of).collect(), loose, data }
    }

    /// The pose at each posture, from targets as drawn or as the posture with the most of them has them; `None` where
    /// too few are seen.
    fn poses(&self, loose: bool) -> Option<Vec<Option<Se3>>> {
        if self.data.iter().any(|reading| reading.rotation.is_some()) {
            return None;
        }
        let most = self.seen.iter().max_by_key(|targets| targets.len())?;
        // Of the most the first, so that it does not depend on how many others have as many.
        let most = self.seen.iter().find(|targets| targets.len() == most.len())?;
        let centre = most.iter().map(|(_, _, at)| at).sum::<Vector3<f64>>() / most.len().max(1) as f64;
        let place = |key: &Key, nominal: &Vector3<f64>| match loose {
            false => Some(*nominal),
            true => most.iter().find(|(other, _, _)| other == key).map(|(_, _, at)| at - centre),
        };
        let pose = |targets: &Vec<(Key, Vector3<f64>, Vector3<f64>)>| {
            let pairs: Option<Vec<(Vector3<f64>, Vector3<f64>)>> =
                targets.iter().map(|(key, nominal, at)| Some((place(key, nominal)?, *at))).collect();
            pose_of(&pairs?)
        };
        let poses: Vec<Option<Se3>> = self.seen.iter().map(pose).collect();
        (2 * poses.iter().flatten().count() > poses.len()).then_some(poses)
    }

    /// The places of the target that is seen most often, and where it is in the tool's frame.
    fn most_common(&self) -> Option<Track> {
        let all = || self.seen.iter().flatten();
        let count = |key: &Key| all().filter(|(other, _, _)| other == key).count();
        let mut best: Option<(usize, Key, Vector3<f64>)> = None;
        for (key, nominal, _) in self.seen.iter().flatten() {
            if best.is_none_or(|(_, other, _)| other != *key) && best.is_none_or(|(n, _, _)| count(key) > n) {
                best = Some((count(key), *key, *nominal));
            }
        }
        let (_, key, nominal) = best?;
        let at = |targets: &Vec<(Key, Vector3<f64>, Vector3<f64>)>| {
            targets.iter().find(|(other, _, _)| *other == key).map(|(_, _, at)| *at)
        };
        Some((self.seen.iter().map(at).collect(), nominal))
    }
}

/// The motion that brings the first points to the second; `None` where they are too few, or on a line.
fn pose_of(pairs: &[(Vector3<f64>, Vector3<f64>)]) -> Option<Se3> {
    if pairs.len() < 3 {
        return None;
    }
    let count = pairs.len() as f64;
    let from = pairs.iter().map(|(a, _)| a).sum::<Vector3<f64>>() / count;
    let to = pairs.iter().map(|(_, b)| b).sum::<Vector3<f64>>() / count;
    let own: Matrix3<f64> = pairs.iter().map(|(a, _)| (a - from) * (a - from).transpose()).sum();
    let mut sizes: [f64; 3] = own.try_svd(false, false, f64::EPSILON, 100)?.singular_values.into();
    sizes.sort_by(|a, b| b.total_cmp(a));
    if sizes[1].is_nan() || sizes[1] <= OFF_LINE * OFF_LINE * sizes[0] {
        return None;
    }
    let sum: Matrix3<f64> = pairs.iter().map(|(a, b)| (b - to) * (a - from).transpose()).sum();
    let r = so3::nearest(&sum)?.rotation;
    Some(Se3 { r, p: to - r * from })
}
