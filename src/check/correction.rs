//! Usual mistakes, each with the change of the data that undoes it.

use super::misfit::{Reading, measurement, vector};
use super::offsets::offsets;
use crate::calibration::Sample;
use crate::identify::registration::{FreeEnds, register};
use crate::lie::{Se3, so3};
use crate::model::{Joint, Mechanism};
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};
use std::f64::consts::PI;
use std::sync::Arc;

/// rad per degree.
const DEGREE: f64 = PI / 180.0;

/// A change of the data, or of where the machine stands.
#[derive(Clone, Debug, PartialEq)]
pub enum Correction {
    /// Positions times a factor.
    PositionScale(f64),
    /// Rotation vectors times a factor.
    RotationScale(f64),
    /// Readings of all sliding (true) or turning (false) actuators times a factor.
    ActuatorScale(bool, f64),
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
    /// Three angles about fixed axes x, y, z (or moving ones), times a factor, in place of a rotation vector.
    Euler(bool, f64),
    /// Two actuators' columns exchanged.
    Swapped(usize, usize),
    /// All actuators' columns shifted by so many places.
    Shifted(usize),
    /// All actuators' columns in reverse.
    Backwards,
    /// A reading's sign, about zero or about home.
    Reversed(usize, bool),
    /// Every reading's sign.
    AllReversed,
    /// Position columns in another order.
    PositionOrder([usize; 3]),
    /// Readings count from home.
    FromHome,
    /// Base, tool or both stand elsewhere.
    Elsewhere(FreeEnds),
    /// Readings at home, found from the data.
    Offsets,
}

/// Every correction that this machine and data can have, the plainest first.
pub fn corrections(mechanism: &Mechanism, data: &[Reading]) -> Vec<Correction> {
    let joints: Vec<&Joint> = actuated(mechanism);
    let angular: Vec<bool> = joints.iter().map(|joint| joint.motion.is_angular()).collect();
    let rotations = data.iter().all(|reading| reading.rotation.is_some());
    let vectors = rotations && data.iter().all(|reading| reading.vector.is_some());
    let mut list = vec![Correction::PositionScale(1e-3), Correction::PositionScale(1e3)];
    if vectors {
        list.extend([Correction::RotationScale(DEGREE), Correction::RotationScale(1.0 / DEGREE)]);
    }
    if angular.contains(&false) {
        list.extend([1e-3, 1e3].map(Correction::LengthScale));
    }
    if vectors && angular.contains(&true) {
        let homes = joints.iter().any(|joint| joint.motion.is_angular() && joint.home != 0.0);
        for factor in [DEGREE, 1.0 / DEGREE] {
            list.push(Correction::AngleScale(factor, false));
            list.extend(homes.then_some(Correction::AngleScale(factor, true)));
        }
    }
    for (sliding, factors) in [(true, [1e-3, 1e3]), (false, [DEGREE, 1.0 / DEGREE])] {
        if angular.contains(&!sliding) {
            list.extend(factors.map(|factor| Correction::ActuatorScale(sliding, factor)));
        }
    }
    if rotations {
        list.extend([Correction::Transposed, Correction::Inverted]);
        if data.iter().all(|reading| reading.quaternion) {
            list.push(Correction::QuaternionOrder);
        }
    }
    for (i, joint) in joints.iter().enumerate() {
        list.push(Correction::Reversed(i, false));
        if joint.home != 0.0 {
            list.push(Correction::Reversed(i, true));
        }
    }
    for i in 0..joints.len() {
        list.extend(
            (i + 1..joints.len()).filter(|&j| angular[i] == angular[j]).map(|j| Correction::Swapped(i, j)),
        );
    }
    if joints.len() > 1 {
        list.push(Correction::AllReversed);
    }
    if joints.len() > 2 && angular.iter().all(|a| *a == angular[0]) {
        list.push(Correction::Backwards);
        list.extend((1..joints.len()).map(Correction::Shifted));
    }
    if joints.iter().any(|joint| joint.home != 0.0) {
        list.push(Correction::FromHome);
    }
    list.extend([[0, 2, 1], [1, 0, 2], [2, 1, 0], [1, 2, 0], [2, 0, 1]].map(Correction::PositionOrder));
    if vectors {
        for factor in [1.0, DEGREE, 1.0 / DEGREE] {
            list.extend([true, false].map(|fixed| Correction::Euler(fixed, factor)));
        }
    }
    if rotations {
        list.push(Correction::Offsets);
    }
    for (base, tool) in [(true, false), (false, true), (true, true)] {
        if rotations || !tool {
            list.push(Correction::Elsewhere(FreeEnds { base, tool }));
        }
    }
    list
}

fn actuated(mechanism: &Mechanism) -> Vec<&Joint> {
    mechanism.limbs.iter().flat_map(|limb| &limb.joints).filter(|joint| joint.actuated).collect()
}

impl Correction {
    /// How many sets of numbers it fits to the data: readings at home, or a frame each; none for a plain mistake.
    pub fn fitted(&self) -> usize {
        match self {
            Correction::Offsets => 1,
            Correction::Elsewhere(FreeEnds { base, tool }) => usize::from(*base) + usize::from(*tool),
            _ => 0,
        }
    }

    /// The machine and the data with this correction; `None` where it cannot be made.
    pub fn apply(&self, mechanism: &Mechanism, data: &[Reading]) -> Option<(Mechanism, Vec<Reading>)> {
        if let Correction::Elsewhere(free) = self {
            let samples: Option<Vec<Sample>> = data
                .iter()
                .map(|reading| {
                    let (name, actuators) = (reading.name.clone(), reading.variables(mechanism));
                    Some(Sample { name, actuators, measurement: Arc::new(measurement(reading)?) })
                })
                .collect();
            return Some((register(mechanism, &samples?, *free)?.machine, data.to_vec()));
        }
        let found = match self {
            Correction::Offsets => offsets(mechanism, data)?,
            Correction::FromHome => actuated(mechanism).iter().map(|joint| joint.home).collect(),
            _ => Vec::new(),
        };
        let joints = actuated(mechanism);
        let mut changed = data.to_vec();
        for reading in &mut changed {
            self.change(reading, &joints, &found)?;
        }
        let mut mechanism = mechanism.clone();
        if let Correction::AngleScale(factor, true) = self {
            let joints = mechanism.limbs.iter_mut().flat_map(|limb| &mut limb.joints);
            joints.filter(|joint| joint.motion.is_angular()).for_each(|joint| joint.home *= factor);
        }
        Some((mechanism, changed))
    }

    /// Multiplies the readings of all sliding, or of all turning actuators.
    fn scale(readings: &mut [f64], joints: &[&Joint], sliding: bool, factor: f64) {
        let some = readings.iter_mut().zip(joints).filter(|(_, joint)| joint.motion.is_angular() != sliding);
        some.for_each(|(reading, _)| *reading *= factor);
    }

    fn change(&self, reading: &mut Reading, joints: &[&Joint], found: &[f64]) -> Option<()> {
        let turned = |reading: &mut Reading, r: Matrix3<f64>| {
            (reading.rotation, reading.vector) = (Some(r), reading.vector.map(|_| so3::log(&r)));
        };
        let q = &mut reading.actuators;
        match self {
            Correction::PositionScale(factor) => reading.position *= *factor,
            Correction::PositionOrder(order) => {
                reading.position = Vector3::from(order.map(|i| reading.position[i]))
            }
            Correction::RotationScale(factor) => {
                let w = vector(reading)? * *factor;
                (reading.rotation, reading.vector) = (Some(so3::exp(&w)), Some(w));
            }
            Correction::Euler(fixed, factor) => {
                let w = vector(reading)? * *factor;
                let [x, y, z] = [0, 1, 2].map(|i| {
                    let mut axis = Vector3::zeros();
                    axis[i] = w[i];
                    so3::exp(&axis)
                });
                turned(reading, if *fixed { z * y * x } else { x * y * z });
            }
            Correction::Transposed => turned(reading, reading.rotation?.transpose()),
            Correction::QuaternionOrder => {
                let read = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(
                    reading.rotation?,
                ));
                let q = Quaternion::new(read.k, read.w, read.i, read.j);
                turned(reading, UnitQuaternion::from_quaternion(q).to_rotation_matrix().into_inner());
            }
            Correction::Inverted => {
                let inverse: Se3 = reading.pose()?.inverse();
                reading.position = inverse.p;
                turned(reading, inverse.r);
            }
            Correction::ActuatorScale(sliding, factor) => {
                Self::scale(q, joints, *sliding, *factor);
            }
            Correction::LengthScale(factor) => {
                Self::scale(q, joints, true, *factor);
                reading.position *= *factor;
            }
            Correction::AngleScale(factor, _) => {
                Self::scale(q, joints, false, *factor);
                let w = vector(reading)? * *factor;
                (reading.rotation, reading.vector) = (Some(so3::exp(&w)), Some(w));
            }
            Correction::Swapped(i, j) => q.swap(*i, *j),
            Correction::Shifted(places) => q.rotate_left(*places),
            Correction::Backwards => q.reverse(),
            Correction::Reversed(i, about_home) => {
                let about = if *about_home { 2.0 * joints.get(*i)?.home } else { 0.0 };
                let reading = q.get_mut(*i)?;
                *reading = about - *reading;
            }
            Correction::AllReversed => q.iter_mut().for_each(|reading| *reading = -*reading),
            Correction::FromHome | Correction::Offsets => {
                q.iter_mut().zip(found).for_each(|(reading, offset)| *reading += offset);
            }
            Correction::Elsewhere(_) => {}
        }
        Some(())
    }

    /// What looks wrong and what would put it right, in the words of the machine.
    pub fn words(&self, mechanism: &Mechanism) -> String {
        let names = mechanism.actuator_names();
        let name = |i: &usize| names.get(*i).cloned().unwrap_or_default();
        let lengths = |factor: f64| {
            if factor < 1.0 { "mm where the file means m" } else { "m where the file means mm" }
        };
        let angles = |factor: f64| match factor {
            f if f < 1.0 => "degrees where the file means rad",
            _ => "rad where the file means degrees",
        };
        match self {
            Correction::PositionScale(f) => {
                format!("measured positions look like {}: scale them by {f}", lengths(*f))
            }
            Correction::RotationScale(f) => format!("measured rotations look like {}", angles(*f)),
            Correction::ActuatorScale(true, f) => {
                format!("readings of sliding actuators look like {}: scale them by {f}", lengths(*f))
            }
            Correction::ActuatorScale(false, f) => {
                format!("readings of turning actuators look like {}", angles(*f))
            }
            Correction::LengthScale(f) => format!(
                "measured positions and readings of sliding actuators look like {}: scale all of them by {f} (or it is the \
                 drawing that has the other unit)",
                lengths(*f)
            ),
            Correction::AngleScale(f, _) => {
                format!(
                    "readings of turning actuators and measured rotations look like {}: correct units.angle",
                    angles(*f)
                )
            }
            Correction::Transposed => {
                "measured rotations look transposed (from {S} to {T}): invert them".to_owned()
            }
            Correction::QuaternionOrder => {
                "quaternions look like [x, y, z, w]: write [w, x, y, z]".to_owned()
            }
            Correction::Inverted => {
                "base and tool look exchanged: poses seem to be those of {S} in {T}; invert them".to_owned()
            }
            Correction::Euler(fixed, factor) => {
                let (axes, unit) = (
                    if *fixed { "fixed" } else { "moving" },
                    match *factor {
                        1.0 => "",
                        f => angles(f),
                    },
                );
                let unit = if unit.is_empty() { String::new() } else { format!(", {unit}") };
                format!("rotations look like angles about {axes} axes x, y, z{unit}: write rotation vectors")
            }
            Correction::Swapped(i, j) => format!("actuators {} and {} look swapped", name(i), name(j)),
            Correction::Shifted(places) => {
                format!(
                    "actuator columns look shifted by {places}: {} seems to be in the column of {}",
                    name(&0),
                    name(places)
                )
            }
            Correction::Backwards => "actuator columns look to be in reverse order".to_owned(),
            Correction::Reversed(i, false) => {
                format!("{} looks reversed: negate its readings, or its axis", name(i))
            }
            Correction::Reversed(i, true) => {
                format!("{} looks reversed about its home: turn its axis round", name(i))
            }
            Correction::AllReversed => {
                "all actuators look reversed: negate the readings, or the axes".to_owned()
            }
            Correction::PositionOrder(order) => {
                let columns = order.map(|i| ["x", "y", "z"][i]).join(", ");
                format!("position columns look out of order: x, y, z seem to be {columns}")
            }
            Correction::FromHome => {
                "readings look counted from home: remove \"home\" of the actuators".to_owned()
            }
            Correction::Elsewhere(FreeEnds { base, tool }) => {
                let (what, how) = match (base, tool) {
                    (true, true) => {
                        ("base and tool look", "the first joint of every limb, and \"tool_tolerance\",")
                    }
                    (true, false) => ("the base looks", "the first joint of every limb"),
                    (false, _) => ("the tool looks", "the last link of every limb (\"tool_tolerance\")"),
                };
                format!("{what} to stand elsewhere than drawn: set the tolerance of {how} to \"free\"")
            }
            Correction::Offsets => "readings at home look different from \"home\"".to_owned(),
        }
    }
}
