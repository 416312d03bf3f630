//! Actuator readings of files, and the joint variables inside: variable = reading - home.

use super::error::FileError;
use super::fault::Fault;
use super::place::Place;
use super::units::Units;
use crate::model::{Joint, Mechanism};

fn actuated(mechanism: &Mechanism) -> impl Iterator<Item = &Joint> {
    mechanism.limbs.iter().flat_map(|limb| &limb.joints).filter(|joint| joint.actuated)
}

/// Joint variables (rad or m, actuator order) of readings in units of the file.
pub(super) fn variables(
    mechanism: &Mechanism,
    units: Units,
    readings: &[f64],
    at: &Place<'_>,
) -> Result<Vec<f64>, FileError> {
    let wanted = mechanism.actuator_count();
    if readings.len() != wanted {
        let names = mechanism.actuator_names().join(", ");
        return Err(at.error(Fault::ActuatorCount { found: readings.len(), wanted, names }));
    }
    let pairs = actuated(mechanism).zip(readings).enumerate();
    pairs
        .map(|(i, (joint, reading))| Ok(units.joint(joint.motion, *reading, &at.index(i))? - joint.home))
        .collect()
}

/// Readings in units of the file of joint variables (rad or m, actuator order).
pub fn readings(mechanism: &Mechanism, units: Units, variables: &[f64]) -> Vec<f64> {
    let pairs = actuated(mechanism).zip(variables);
    pairs.map(|(joint, variable)| units.from_joint(joint.motion, variable + joint.home)).collect()
}
