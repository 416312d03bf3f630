//! A machine in the place of the one that was drawn.

use super::error::CliError;
use super::wording::not_identified;
use crate::files::ProblemFile;
use crate::identify::run::placed;
use crate::identify::{IdentifyError, Registration};
use crate::model::{Joint, Mechanism};
use std::mem::discriminant;

/// Difference of two readings at home, relative to 1 m or rad and to them, that rounding in other units explains.
const ROUNDING: f64 = 1e-9;
/// Difference of a length within a limb, in machine sizes, that no identification explains.
const OTHER_SIZE: f64 = 0.1;

/// The drawing where the problem's measurements say that it stands, as `identify` has it; as drawn where there are none.
pub fn registered(problem: &ProblemFile) -> Result<Registration, CliError> {
    if problem.data.is_empty() {
        return Ok(Registration::as_drawn(&problem.mechanism));
    }
    placed(&problem.mechanism, &problem.data.samples).ok_or_else(|| CliError::Identify {
        file: problem.file.clone(),
        why: not_identified(&IdentifyError::Unregistered, problem.units),
    })
}

/// Why a machine cannot stand in the place of the one that was drawn.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Unlike {
    /// Other limbs.
    #[error("its machine has other limbs than the drawing: {found} instead of {wanted}")]
    Limbs {
        /// Names of its limbs.
        found: String,
        /// Names of those of the drawing.
        wanted: String,
    },
    /// Other joints.
    #[error("{limb} of its machine has other joints than that of the drawing, or others that are actuated")]
    Joints {
        /// Name of the limb.
        limb: String,
    },
    /// Other lengths.
    #[error("its machine is not the one that is drawn: {limb} has other dimensions")]
    Size {
        /// Name of the limb.
        limb: String,
    },
    /// Another home.
    #[error(
        "{actuator} of its machine has another reading at home than in the drawing, so that readings mean other postures; \
         draw both at the same home"
    )]
    Home {
        /// Name `limb.joint` of the actuator.
        actuator: String,
    },
}

/// The drawing with the links, joints and instrument constants of `other`, which stands where that machine stands;
/// tolerances, ranges and names stay those of the drawing.
///
/// Refused is a machine whose limbs, by name, have not the same joints, and one with another home: data were read with
/// the home of the drawing.
pub fn with_links_of(mut drawn: Mechanism, other: &Mechanism) -> Result<Mechanism, Unlike> {
    let names = |of: &Mechanism| -> Vec<String> { of.limbs.iter().map(|limb| limb.name.clone()).collect() };
    let (found, wanted) = (names(other), names(&drawn));
    if found != wanted {
        return Err(Unlike::Limbs { found: found.join(", "), wanted: wanted.join(", ") });
    }
    let alike =
        |a: &Joint, b: &Joint| discriminant(&a.motion) == discriminant(&b.motion) && a.actuated == b.actuated;
    for (limb, other) in drawn.limbs.iter_mut().zip(&other.limbs) {
        let mut pairs = limb.joints.iter().zip(&other.joints);
        if limb.joints.len() != other.joints.len() || !pairs.clone().all(|(a, b)| alike(a, b)) {
            return Err(Unlike::Joints { limb: limb.name.clone() });
        }
        let moved = |a: &Joint, b: &Joint| (a.home - b.home).abs() > ROUNDING * (1.0 + a.home.abs());
        if let Some((joint, _)) = pairs.find(|(a, b)| a.actuated && moved(a, b)) {
            return Err(Unlike::Home { actuator: format!("{}.{}", limb.name, joint.name) });
        }
        for (link, other) in limb.links.iter_mut().zip(&other.links) {
            link.nominal = other.nominal;
        }
        for (joint, other) in limb.joints.iter_mut().zip(&other.joints) {
            joint.frame = other.frame;
            joint.motion = other.motion;
        }
    }
    for (constant, other) in drawn.instrument.iter_mut().zip(&other.instrument) {
        constant.nominal = other.nominal;
    }
    Ok(drawn)
}

/// Refuses a machine with the joints of the drawing but other dimensions: joints of a limb that are not about as far from
/// the next one. Where base and tool are does not matter.
pub fn require_size_of(drawn: &Mechanism, other: &Mechanism) -> Result<(), Unlike> {
    let least = OTHER_SIZE * drawn.characteristic_length();
    for (limb, other) in drawn.limbs.iter().zip(&other.limbs) {
        let step = |pair: &[Joint]| match pair {
            [a, b] => (b.frame.p - a.frame.p).norm(),
            _ => 0.0,
        };
        let mut pairs = limb.joints.windows(2).zip(other.joints.windows(2));
        if pairs.any(|(a, b)| (step(a) - step(b)).abs() > least) {
            return Err(Unlike::Size { limb: limb.name.clone() });
        }
    }
    Ok(())
}
