//! A pose made by every limb for itself: where loops close, each limb is an arm whose end is known, and what one limb finds
//! does not depend on the others.

use super::range::Ranges;
use super::self_motion::into_ranges;
use super::way::approach;
use super::{REACHED, active};
use crate::lie::Se3;
use crate::model::joint::{Joint, Motion};
use crate::model::limb::Limb;
use crate::model::mechanism::{Ends, Geometry, Mechanism};
use crate::model::posture::Posture;
use std::f64::consts::TAU;

/// Starts of a limb besides the posture in which it stands.
const STARTS: usize = 24;
/// Most solutions kept of a limb.
const MOST: usize = 8;
/// Most combinations of them that are looked at: those of six limbs of four solutions each.
const COMBINATIONS: usize = 4096;
/// Joint variables that differ by less are the same solution, rad or m.
const SAME: f64 = 1e-6;
/// All six components.
const WHOLE: [bool; 6] = [true; 6];

/// Readings within the ranges that make the pose: those in the assembly mode of `near` first, and of these the ones near to
/// it; none where a limb finds none. Which of them predictions lead to the pose is not asked: the sign that tells modes
/// apart turns over with limbs whose passive joints are turned over.
pub(super) fn readings_by_limb(
    mechanism: &Mechanism,
    geometry: &Geometry,
    near: &Posture,
    pose: &Se3,
) -> Vec<Vec<f64>> {
    let mut joint = 0;
    let mut solutions = Vec::with_capacity(mechanism.limbs.len());
    for (limb, links) in mechanism.limbs.iter().zip(&geometry.limbs) {
        let own = joint..joint + limb.joints.len();
        joint = own.end;
        solutions.push(of_limb(limb, links, &near.q[own], pose));
    }
    let counts: Vec<usize> = solutions.iter().map(Vec::len).collect();
    let (mut found, mut others) = (Vec::new(), Vec::new());
    for choice in by_rank(&counts, COMBINATIONS) {
        let mut posture = near.clone();
        posture.q = solutions.iter().zip(choice).flat_map(|(own, i)| own[i].iter().copied()).collect();
        let readings = active(mechanism, &posture);
        if posture.close(mechanism, geometry).is_ok() {
            if posture.mode == near.mode { &mut found } else { &mut others }.push(readings);
        }
    }
    found.append(&mut others);
    found
}

/// Joint variables of a limb that bring its end to the pose with readings within the ranges, those nearest to `near` first.
fn of_limb(limb: &Limb, links: &[Se3], near: &[f64], pose: &Se3) -> Vec<Vec<f64>> {
    // Every joint of an arm is driven; those that are passive here have no range to stay in.
    let driven = |joint: &Joint| Joint {
        actuated: true,
        range: joint.range.filter(|_| joint.actuated),
        ..joint.clone()
    };
    let arm = Limb { joints: limb.joints.iter().map(driven).collect(), ..limb.clone() };
    let arm = Mechanism { limbs: vec![arm], instrument: Vec::new(), ends: Ends::default() };
    let geometry = Geometry { limbs: vec![links.to_vec()], instrument: Vec::new() };
    let ranges = Ranges::of(&arm);
    let mut found: Vec<Vec<f64>> = Vec::new();
    for attempt in 0..=STARTS {
        let mut posture = Posture::new(&arm);
        posture.q = if attempt == 0 { near.to_vec() } else { ranges.start(attempt) };
        if posture.close(&arm, &geometry).is_err()
            || approach(&arm, &geometry, &mut posture, pose, WHOLE, 0.0) > REACHED
        {
            continue;
        }
        if !ranges.hold(&ranges.turned(&posture.q, near)) {
            posture = into_ranges(&arm, &geometry, &ranges, posture, pose, WHOLE);
        }
        let turned = ranges.turned(&posture.q, near);
        if !ranges.hold(&turned) {
            continue;
        }
        for turned in with_whole_turns(limb, &ranges, turned) {
            let driven = |q: &[f64]| -> Vec<f64> {
                q.iter().zip(&limb.joints).filter(|(_, joint)| joint.actuated).map(|(q, _)| *q).collect()
            };
            let (new, same) = (driven(&turned), |a: f64, b: f64| (a - b).abs() < SAME);
            if !found.iter().any(|old| driven(old).iter().zip(&new).all(|(a, b)| same(*a, *b))) {
                found.push(turned);
            }
        }
    }
    let away = |q: &[f64]| -> f64 {
        let each = limb.joints.iter().zip(q.iter().zip(near)).filter(|(joint, _)| joint.actuated);
        each.map(|(_, (a, b))| (a - b).abs()).fold(0.0, f64::max)
    };
    found.sort_by(|a, b| away(a).total_cmp(&away(b)));
    found.truncate(MOST);
    found
}

/// The joint variables, and the same with driven revolute joints one turn on or back within their ranges.
fn with_whole_turns(limb: &Limb, ranges: &Ranges, q: Vec<f64>) -> Vec<Vec<f64>> {
    let mut all = vec![q];
    for (i, joint) in limb.joints.iter().enumerate() {
        if !joint.actuated || joint.range.is_none() || joint.motion != Motion::Revolute {
            continue;
        }
        for known in all.clone() {
            for turn in [-TAU, TAU] {
                let mut other = known.clone();
                other[i] += turn;
                if ranges.hold(&other) {
                    all.push(other);
                }
            }
        }
    }
    all
}

/// Choices of one out of each of `counts`, at most `most`, in the order of the sum of their ranks.
fn by_rank(counts: &[usize], most: usize) -> Vec<Vec<usize>> {
    let mut all = Vec::new();
    let greatest: usize = counts.iter().map(|count| count.saturating_sub(1)).sum();
    if counts.contains(&0) {
        return all;
    }
    for sum in 0..=greatest {
        spread(counts, sum, &mut Vec::new(), most, &mut all);
    }
    all
}

/// Appends the choices whose ranks add up to `sum`, `begun` being the first of them.
fn spread(counts: &[usize], sum: usize, begun: &mut Vec<usize>, most: usize, all: &mut Vec<Vec<usize>>) {
    if all.len() >= most {
        return;
    }
    let Some(count) = counts.get(begun.len()) else {
        if sum == 0 {
            all.push(begun.clone());
        }
        return;
    };
    for rank in 0..=sum.min(count - 1) {
        begun.push(rank);
        spread(counts, sum - rank, begun, most, all);
        begun.pop();
    }
}

#[cfg(test)]
mod tests {
    use super::by_rank;

    #[test]
    fn choices_come_by_rank_and_none_is_missing() {
        let all = by_rank(&[2, 1, 3], 100);
        assert_eq!(
            all,
            [[0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 0, 2], [1, 0, 1], [1, 0, 2]].map(|c| c.to_vec()).to_vec()
        );
        assert_eq!(by_rank(&[3, 3], 4).len(), 4);
        assert!(by_rank(&[3, 0], 9).is_empty());
    }
}
