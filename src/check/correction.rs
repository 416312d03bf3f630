//! Usual mistakes, each as the change of the numbers that undoes it.

use super::euler::Euler;
use super::reading::Reading;
use super::turns::unwrapped;
use crate::identify::registration::FreeEnds;
use crate::lie::so3;
use crate::measure::Point;
use crate::model::{Joint, Mechanism, Motion};
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};
use std::borrow::Cow;

/// A change of the data, or of where the machine stands.
#[derive(Clone, Debug, PartialEq)]
pub enum Correction {
    /// Positions times a factor.
    PositionScale(f64),
    /// Rotation vectors times a factor.
    RotationScale(f64),
    /// Readings of all sliding (true) or turning (false) actuators times a factor.
    ActuatorScale(bool, f64),
    /// Readings of one turning actuator times a factor.
    OneScale(usize, f64),
    /// Readings of turning actuators times a factor, and what they read at home.
    TurningScale(f64),
    /// Positions and readings of sliding actuators times a factor.
    LengthScale(f64),
    /// Rotation vectors and readings of turning actuators times a factor; true: what they read at home, too.
    AngleScale(f64, bool),
    /// The rotation's inverse.
    Transposed,
    /// The quaternion's components from x, y, z, w.
    QuaternionOrder,
    /// The pose's inverse.
    Inverted,
    /// Three angles, times a factor, in place of a rotation vector.
    Euler(Euler, f64),
    /// Two actuators' columns exchanged.
    Swapped(usize, usize),
    /// All actuators' columns shifted by so many places.
    Shifted(usize),
    /// All actuators' columns in reverse.
    Backwards,
    /// A reading's sign, about zero or about home.
    Reversed(usize, bool),
    /// Every reading's sign, about zero or about home.
    AllReversed(bool),
    /// Readings of these screws without the whole turns that they made: as many as bring the limb to the measured pose.
    Unwrapped(Vec<usize>),
    /// The hand of these screws of the drawing, by limb and joint.
    Handed(Vec<(usize, usize)>),
    /// Names of two targets exchanged.
    Exchanged(Point, Point),
    /// Position columns in another order.
    PositionOrder([usize; 3]),
    /// Readings count from home.
    FromHome,
    /// An actuator's variable times a factor, added to the reading of another one of the same limb.
    Coupled {
        /// The actuator whose reading lacks it.
        joint: usize,
        /// The other one.
        by: usize,
        /// 1 or -1.
        factor: f64,
    },
    /// Offsets (rad, m) of the readings of some actuators: their homes are less by these.
    Offsets(Vec<(usize, f64)>),
    /// Base, tool or both stand elsewhere.
    Elsewhere(FreeEnds),
}

/// Which numbers a correction changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Numbers {
    /// Readings of actuators.
    Readings,
    /// What was measured of the tool.
    Measured,
    /// Both.
    Both,
    /// None: the machine is moved.
    Place,
}

/// What only one correction of a story may change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Once {
    Positions,
    PositionOrder,
    Rotations,
    RotationKind,
    Sliding,
    Turning,
    Sign(usize),
    AllSigns,
    Hand(usize, usize),
    Home,
    Order,
    Place,
}

impl Correction {
    /// How many numbers it fits to the data: none for a plain mistake.
    pub fn fitted(&self) -> usize {
        match self {
            Correction::Offsets(offsets) => offsets.len(),
            Correction::Elsewhere(FreeEnds { base, tool }) => 6 * (usize::from(*base) + usize::from(*tool)),
            _ => 0,
        }
    }

    pub(super) fn numbers(&self) -> Numbers {
        match self {
            Correction::LengthScale(_) | Correction::AngleScale(..) => Numbers::Both,
            Correction::Elsewhere(_) => Numbers::Place,
            Correction::PositionScale(_)
            | Correction::RotationScale(_)
            | Correction::Transposed
            | Correction::QuaternionOrder
            | Correction::Inverted
            | Correction::Euler(..)
            | Correction::PositionOrder(_)
            | Correction::Exchanged(..) => Numbers::Measured,
            _ => Numbers::Readings,
        }
    }

    pub(super) fn once(&self) -> Vec<Once> {
        match self {
            Correction::PositionScale(_) => vec![Once::Positions],
            Correction::RotationScale(_) => vec![Once::Rotations],
            Correction::ActuatorScale(sliding, _) => {
                vec![if *sliding { Once::Sliding } else { Once::Turning }]
            }
            Correction::OneScale(..) => vec![Once::Turning],
            Correction::TurningScale(_) => vec![Once::Turning, Once::Home],
            Correction::LengthScale(_) => vec![Once::Positions, Once::Sliding],
            Correction::AngleScale(..) => vec![Once::Rotations, Once::Turning],
            Correction::Transposed | Correction::QuaternionOrder | Correction::Inverted => {
                vec![Once::RotationKind]
            }
            Correction::Euler(..) => vec![Once::RotationKind, Once::Rotations],
            Correction::Shifted(_) | Correction::Backwards => vec![Once::Order],
            Correction::Reversed(i, _) => vec![Once::Sign(*i)],
            Correction::AllReversed(_) => vec![Once::AllSigns],
            Correction::Handed(screws) => screws.iter().map(|(i, j)| Once::Hand(*i, *j)).collect(),
            Correction::PositionOrder(_) => vec![Once::PositionOrder],
            Correction::FromHome => vec![Once::Home],
            Correction::Elsewhere(_) => vec![Once::Place],
            Correction::Swapped(..)
            | Correction::Coupled { .. }
            | Correction::Unwrapped(_)
            | Correction::Exchanged(..)
            | Correction::Offsets(_) => Vec::new(),
        }
    }

    /// Changes the numbers of one reading; `None` where it cannot.
    pub fn apply(&self, reading: &mut Reading, joints: &[&Joint]) -> Option<()> {
        self.apply_to_measured(reading)?;
        self.apply_to_actuators(&mut reading.actuators, joints)
    }

    fn apply_to_actuators(&self, q: &mut [f64], joints: &[&Joint]) -> Option<()> {
        let scale = |q: &mut [f64], sliding: bool, factor: f64, about_home: bool| {
            let some = q.iter_mut().zip(joints).filter(|(_, joint)| joint.motion.is_angular() != sliding);
            some.for_each(|(q, joint)| {
                let home = if about_home { joint.home } else { 0.0 };
                *q = (*q - home) * factor + home;
            });
        };
        match self {
            Correction::ActuatorScale(sliding, factor) => scale(q, *sliding, *factor, false),
            Correction::TurningScale(factor) => scale(q, false, *factor, true),
            Correction::LengthScale(factor) => scale(q, true, *factor, false),
            Correction::AngleScale(factor, homes) => scale(q, false, *factor, *homes),
            Correction::Swapped(i, j) => q.swap(*i, *j),
            Correction::Shifted(places) => q.rotate_left(*places),
            Correction::Backwards => q.reverse(),
            Correction::Reversed(i, about_home) => {
                let about = if *about_home { 2.0 * joints.get(*i)?.home } else { 0.0 };
                let reading = q.get_mut(*i)?;
                *reading = about - *reading;
            }
            Correction::OneScale(i, factor) => *q.get_mut(*i)? *= factor,
            Correction::AllReversed(about_home) => q.iter_mut().zip(joints).for_each(|(reading, joint)| {
                let about = if *about_home { 2.0 * joint.home } else { 0.0 };
                *reading = about - *reading;
            }),
            Correction::FromHome => q.iter_mut().zip(joints).for_each(|(q, joint)| *q += joint.home),
            Correction::Coupled { joint, by, factor } => {
                let other = q.get(*by)? - joints.get(*by)?.home;
                *q.get_mut(*joint)? += factor * other;
            }
            Correction::Offsets(offsets) => {
                for (i, offset) in offsets {
                    *q.get_mut(*i)? += offset;
                }
            }
            _ => {}
        }
        Some(())
    }

    fn apply_to_measured(&self, reading: &mut Reading) -> Option<()> {
        let turned = |reading: &mut Reading, r: Matrix3<f64>| {
            (reading.rotation, reading.vector) = (Some(r), reading.vector.map(|_| so3::log(&r)));
        };
        match self {
            Correction::PositionScale(factor) | Correction::LengthScale(factor) => {
                reading.position *= *factor
            }
            Correction::PositionOrder(order) => {
                reading.position = Vector3::from(order.map(|i| reading.position[i]));
            }
            Correction::RotationScale(factor) | Correction::AngleScale(factor, _) => {
                let w = reading.rotation_vector()? * *factor;
                (reading.rotation, reading.vector) = (Some(so3::exp(&w)), Some(w));
            }
            Correction::Euler(convention, factor) => {
                let w = reading.rotation_vector()? * *factor;
                turned(reading, convention.rotation(&w));
            }
            Correction::Transposed => turned(reading, reading.rotation?.transpose()),
            Correction::QuaternionOrder => {
                let read = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(
                    reading.rotation?,
                ));
                let q = Quaternion::new(read.k, read.w, read.i, read.j);
                turned(reading, UnitQuaternion::from_quaternion(q).to_rotation_matrix().into_inner());
            }
            Correction::Exchanged(a, b) => match reading.target {
                target if target == *a => reading.target = *b,
                target if target == *b => reading.target = *a,
                _ => {}
            },
            Correction::Inverted => {
                let inverse = reading.pose()?.inverse();
                reading.position = inverse.p;
                turned(reading, inverse.r);
            }
            _ => {}
        }
        Some(())
    }
}

/// The actuated joints in the order of their readings.
pub fn actuated(mechanism: &Mechanism) -> Vec<&Joint> {
    mechanism.limbs.iter().flat_map(|limb| &limb.joints).filter(|joint| joint.actuated).collect()
}

/// The readings with these corrections, in their order; `None` where one cannot be made.
pub fn applied(mechanism: &Mechanism, data: &[Reading], corrections: &[Correction]) -> Option<Vec<Reading>> {
    let joints = actuated(mechanism);
    let mut changed = data.to_vec();
    for correction in corrections {
        if let Correction::Unwrapped(which) = correction {
            changed = unwrapped(mechanism, &changed, which)?;
        }
        for reading in &mut changed {
            correction.apply(reading, &joints)?;
        }
    }
    Some(changed)
}

/// The drawing with those corrections that are its own.
pub fn redrawn<'m>(mechanism: &'m Mechanism, corrections: &[Correction]) -> Cow<'m, Mechanism> {
    let mut drawing = Cow::Borrowed(mechanism);
    for correction in corrections {
        let Correction::Handed(screws) = correction else { continue };
        for (limb, joint) in screws {
            let limb = drawing.to_mut().limbs.get_mut(*limb);
            if let Some(Motion::Helical { advance }) =
                limb.and_then(|limb| limb.joints.get_mut(*joint)).map(|joint| &mut joint.motion)
            {
                *advance = -*advance;
            }
        }
    }
    drawing
}
