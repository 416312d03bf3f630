//! Whether a drawing is a machine that this model describes: neither over-constrained nor under-actuated.

use super::closure::NotClosed;
use super::limb::{Prior, Tolerance};
use super::mechanism::{Ends, Geometry, Mechanism};
use super::posture::{ITERATIONS, Posture};
use crate::lie::Se3;
use nalgebra::{DMatrix, DVector};

/// Ratio of the extreme singular values of the wrench matrix below which home counts as nearly singular.
const NEAR_SINGULAR: f64 = 2e-3;

/// What is wrong with the mobility of a drawing.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MobilityError {
    /// Nothing drives the machine.
    #[error("no joint is actuated: mark the driven or sensed joints with \"actuated\": true")]
    NoActuator,
    /// A machine built in code that has not the parts that a machine has.
    #[error("{limb} is no limb: {why}; Mechanism::builder makes machines that hold together")]
    NoLimb {
        /// The limb, or where it would stand.
        limb: String,
        /// What it lacks.
        why: String,
    },
    /// Passive joints of one limb can move without moving the platform.
    #[error(
        "{limb} can spin: its passive joints {joints} can move together at home without moving the platform; \
         a universal joint in place of a spherical one at one end cures the spin of a leg between two \
         spherical joints, another home cures a posture that is singular at home only"
    )]
    LimbSpins {
        /// The limb.
        limb: String,
        /// The joints that take part, by name.
        joints: String,
    },
    /// More wrenches than six.
    #[error(
        "over-constrained: the limbs transmit {wrenches} wrenches to the platform where 6 determine it ({per_limb}); \
         give the limbs more passive joints or fewer actuators (a planar linkage needs joints that leave \
         its plane free)"
    )]
    OverConstrained {
        /// Sum of 6 - m over the limbs.
        wrenches: usize,
        /// The sum in words.
        per_limb: String,
    },
    /// Fewer wrenches than six.
    #[error(
        "under-actuated: the limbs transmit only {wrenches} wrenches to the platform where 6 determine it \
         ({per_limb}); actuate more joints or remove passive ones"
    )]
    UnderActuated {
        /// Sum of 6 - m over the limbs.
        wrenches: usize,
        /// The sum in words.
        per_limb: String,
    },
    /// Six wrenches that depend on each other.
    #[error(
        "singular at home: the limbs' six wrenches depend on each other (smallest singular value {smallest:.1e} of \
         the largest), so the platform can move with all actuators held, {motion}; draw the machine at \
         another home, or it is over-constrained one way and under-actuated another"
    )]
    Singular {
        /// Ratio of the extreme singular values of `Jr` at home.
        smallest: f64,
        /// The free motion in words.
        motion: String,
    },
    /// The drawing's loops do not close.
    #[error("the loops do not close at home: {0}")]
    Open(NotClosed),
}

/// A home from which paths to other postures hardly lead.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "home is nearly singular: the smallest singular value of the wrench matrix is {regularity:.1e} of the largest, so that \
     the platform all but moves with all actuators held, {motion}; links that deviate by little leave it open, or close it \
     in another assembly mode; draw the machine at another home"
)]
pub struct NearSingularHome {
    /// Ratio of the extreme singular values of `Jr` at home.
    pub regularity: f64,
    /// The motion that is hardly held, in words.
    pub motion: String,
}

/// What to say of a home that is nearly singular; `None` of others, and of one that does not close.
pub fn near_singular_home(mechanism: &Mechanism, geometry: &Geometry) -> Option<NearSingularHome> {
    let mut posture = Posture::new(mechanism);
    posture.close(mechanism, geometry).ok()?;
    let regularity = posture.regularity();
    let near = regularity < NEAR_SINGULAR && !mechanism.is_open_chain();
    near.then(|| NearSingularHome { regularity, motion: posture.free_motion() })
}

/// Checks the machine at home with the given links.
pub fn check(mechanism: &Mechanism, geometry: &Geometry) -> Result<Posture, MobilityError> {
    check_structure(mechanism, geometry)?;
    let mut posture = Posture::new(mechanism);
    match posture.close(mechanism, geometry) {
        Ok(()) => Ok(posture),
        Err(NotClosed::Singular { smallest }) => {
            Err(MobilityError::Singular { smallest, motion: posture.free_motion() })
        }
        Err(why) => match posture.singularity_at_home(mechanism, geometry) {
            Some((smallest, motion)) => Err(MobilityError::Singular { smallest, motion }),
            None => Err(MobilityError::Open(why)),
        },
    }
}

/// Checks what holds for the machine wherever it stands: its parts are there, something drives it, no limb spins, and the
/// limbs transmit six wrenches to the platform in all.
pub fn check_structure(mechanism: &Mechanism, geometry: &Geometry) -> Result<(), MobilityError> {
    check_parts(mechanism, geometry)?;
    if mechanism.actuator_count() == 0 {
        return Err(MobilityError::NoActuator);
    }
    check_limbs(mechanism, geometry)?;
    check_wrenches(mechanism)
}

/// What reading a file makes sure of, for machines that were built in code.
fn check_parts(mechanism: &Mechanism, geometry: &Geometry) -> Result<(), MobilityError> {
    let refuse = |limb: &str, why: String| Err(MobilityError::NoLimb { limb: limb.to_owned(), why });
    if mechanism.limbs.is_empty() {
        return refuse("an empty list of limbs", "there is none".into());
    }
    let usable = |prior: Prior| !matches!(prior, Prior::Sigma(sigma) if !(sigma > 0.0 && sigma.is_finite()));
    let both = |tolerance: Tolerance| usable(tolerance.angle) && usable(tolerance.length);
    let Ends { placement, tool_mounting } = mechanism.ends;
    if ![placement, tool_mounting].into_iter().flatten().all(both) {
        return refuse(
            "the machine",
            "the tolerance of its placement or tool mounting is no positive number".into(),
        );
    }
    for (i, limb) in mechanism.limbs.iter().enumerate() {
        let (joints, links) = (limb.joints.len(), geometry.limbs.get(i).map_or(0, Vec::len));
        if joints == 0 || links != joints + 1 || links != limb.links.len() {
            return refuse(
                &limb.name,
                format!("it has {joints} joints and {links} links, one more than joints are needed"),
            );
        }
        let lines = limb.joints.iter().all(|joint| joint.frame.is_finite() && joint.home.is_finite());
        if !lines || !geometry.limbs[i].iter().all(Se3::is_finite) {
            return refuse(&limb.name, "a joint or a link is not finite".into());
        }
        for link in &limb.links {
            if !both(link.tolerance) {
                return refuse(
                    &limb.name,
                    format!("the tolerance of link {} is no positive number", link.name),
                );
            }
        }
    }
    Ok(())
}

fn check_limbs(mechanism: &Mechanism, geometry: &Geometry) -> Result<(), MobilityError> {
    let mut posture = Posture::new(mechanism);
    let jacobians = posture.passive_jacobians(mechanism, geometry);
    for (limb, jacobian) in mechanism.limbs.iter().zip(&jacobians) {
        if let Some(joints) = dependent(jacobian) {
            let passive: Vec<&str> =
                limb.joints.iter().filter(|j| !j.actuated).map(|j| j.name.as_str()).collect();
            let names: Vec<&str> = joints.iter().filter_map(|&j| passive.get(j).copied()).collect();
            return Err(MobilityError::LimbSpins { limb: limb.name.clone(), joints: names.join(", ") });
        }
    }
    Ok(())
}

fn check_wrenches(mechanism: &Mechanism) -> Result<(), MobilityError> {
    let counts: Vec<usize> = mechanism.limbs.iter().map(|limb| 6 - limb.passive_count().min(6)).collect();
    let wrenches: usize = counts.iter().sum();
    let words: Vec<String> =
        mechanism.limbs.iter().zip(&counts).map(|(limb, count)| format!("{} {count}", limb.name)).collect();
    let per_limb = words.join(", ");
    if wrenches > 6 {
        return Err(MobilityError::OverConstrained { wrenches, per_limb });
    }
    if wrenches < 6 {
        return Err(MobilityError::UnderActuated { wrenches, per_limb });
    }
    Ok(())
}

/// Columns that take part in the dependency of a 6 x m matrix, if there is one.
fn dependent(columns: &[[f64; 6]]) -> Option<Vec<usize>> {
    let m = columns.len();
    if m == 0 {
        return None;
    }
    // Padded to square, so that the right vectors are complete.
    let size = m.max(6);
    let mut a = DMatrix::<f64>::zeros(size, m);
    for (j, column) in columns.iter().enumerate() {
        a.view_mut((0, j), (6, 1)).copy_from(&DVector::from_column_slice(column));
    }
    let svd = a.try_svd(false, true, 5.0 * f64::EPSILON, ITERATIONS)?;
    let v_t = svd.v_t?;
    let largest = svd.singular_values.max();
    let (at, smallest) = svd.singular_values.argmin();
    if smallest > 1e-9 * largest {
        return None;
    }
    Some((0..m).filter(|&j| v_t[(at, j)].abs() > 1e-6).collect())
}
