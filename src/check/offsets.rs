//! Readings at home that data ask for.

use super::misfit::Reading;
use crate::model::Mechanism;
use crate::model::inverse::passive_at_pose;
use crate::statistics::median;

/// Offset of every actuator's reading (rad or m, actuator order): the median of what inverse kinematics of the measured
/// poses wants less what was read. `None` without whole poses.
pub fn offsets(mechanism: &Mechanism, data: &[Reading]) -> Option<Vec<f64>> {
    let geometry = mechanism.nominal();
    let mut free = mechanism.clone();
    for joint in free.limbs.iter_mut().flat_map(|limb| &mut limb.joints) {
        joint.actuated = false;
    }
    let mut differences = vec![Vec::new(); mechanism.actuator_count()];
    for reading in data {
        let pose = reading.pose()?;
        let variables = reading.variables(mechanism);
        let mut next = variables.iter();
        let joints = || mechanism.limbs.iter().flat_map(|limb| &limb.joints);
        let start: Vec<f64> =
            joints().map(|j| if j.actuated { next.next().copied().unwrap_or(0.0) } else { 0.0 }).collect();
        let solved = passive_at_pose(&free, &geometry, &[], &start, &pose);
        let wanted = solved.iter().zip(joints()).filter(|(_, joint)| joint.actuated).map(|(q, _)| *q);
        for ((list, wanted), read) in differences.iter_mut().zip(wanted).zip(&variables) {
            list.push(wanted - read);
        }
    }
    differences.into_iter().map(median).collect()
}
