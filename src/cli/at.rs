//! A machine in the place of the one that was drawn.

use crate::model::Mechanism;

/// The drawing with the links and joints of `other`, which stands where that machine stands; tolerances, ranges and names
/// stay those of the drawing. `None` where the two have not the same limbs and joints.
pub fn with_links_of(mut drawn: Mechanism, other: &Mechanism) -> Option<Mechanism> {
    let alike = other.limbs.len() == drawn.limbs.len()
        && other.limbs.iter().zip(&drawn.limbs).all(|(a, b)| {
            a.joints.len() == b.joints.len()
                && a.joints
                    .iter()
                    .zip(&b.joints)
                    .all(|(a, b)| a.motion.is_angular() == b.motion.is_angular() && a.actuated == b.actuated)
        });
    if !alike {
        return None;
    }
    for (limb, other) in drawn.limbs.iter_mut().zip(&other.limbs) {
        for (link, other) in limb.links.iter_mut().zip(&other.links) {
            link.nominal = other.nominal;
        }
        for (joint, other) in limb.joints.iter_mut().zip(&other.joints) {
            joint.frame = other.frame;
            joint.motion = other.motion;
            joint.home = other.home;
        }
    }
    Some(drawn)
}
