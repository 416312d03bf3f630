//! Readings against the ranges that the drawing states.

use super::wording::listed;
use crate::files::Model;
use crate::model::mobility::near_singular_home;
use crate::model::{Joint, Mechanism};

/// Says on standard error that home, whence postures are sought, is nearly singular, where it is.
pub fn warn_of_singular_home(mechanism: &Mechanism) {
    if let Some(home) = near_singular_home(mechanism, &mechanism.nominal()) {
        eprintln!("warning: {home}");
    }
}

/// The same, and which actuators of a closed-loop machine stand outside their own range at home. A serial arm is drawn
/// wherever its axes are easy to write down.
pub fn warn_of_home(mechanism: &Mechanism) {
    if mechanism.limbs.iter().all(|limb| limb.passive_count() == 0) {
        return;
    }
    warn_of_singular_home(mechanism);
    let joints = mechanism.limbs.iter().flat_map(|limb| &limb.joints).filter(|joint| joint.actuated);
    let outside =
        |joint: &&Joint| joint.range.is_some_and(|(low, high)| joint.home < low || joint.home > high);
    let named = joints.zip(mechanism.actuator_names()).filter(|(joint, _)| outside(joint));
    let names: Vec<String> = named.map(|(_, name)| name).collect();
    if !names.is_empty() {
        let names = listed(&names);
        eprintln!("warning: home lies outside the range of {names}: both are readings; is home stated?");
    }
}

/// Says on standard error that a result is not of a run that converged.
pub fn warn_unless_converged(model: &Model) {
    if !model.converged {
        eprintln!(
            "warning: {}: the identification did not converge: this is no calibrated machine",
            model.file
        );
    }
}

/// Actuators whose variables, over all `postures` (reading - home, rad or m), leave the range that the drawing states
/// by more than a tenth of it.
pub fn out_of_range<'a>(
    mechanism: &Mechanism,
    postures: impl Iterator<Item = &'a [f64]> + Clone,
) -> Vec<String> {
    let joints = mechanism.limbs.iter().flat_map(|limb| &limb.joints).filter(|joint| joint.actuated);
    let mut outside = Vec::new();
    for (index, (joint, name)) in joints.zip(mechanism.actuator_names()).enumerate() {
        let Some((low, high)) = joint.range else { continue };
        let slack = 0.1 * (high - low);
        let leaves = |variables: &[f64]| {
            let reading = variables.get(index).map_or(joint.home, |variable| variable + joint.home);
            reading < low - slack || reading > high + slack
        };
        if postures.clone().any(leaves) {
            outside.push(name);
        }
    }
    outside
}
