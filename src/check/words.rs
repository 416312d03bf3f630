//! What looks wrong and what would put it right, in the words of the machine.

use super::correction::Correction;
use crate::identify::registration::FreeEnds;
use crate::measure::Point;
use crate::model::Mechanism;
use std::f64::consts::TAU;

fn lengths(factor: f64) -> &'static str {
    if factor < 1.0 { "mm where the file means m" } else { "m where the file means mm" }
}

fn angles(factor: f64) -> &'static str {
    if factor == TAU {
        return "turns where the file means rad";
    }
    if factor == 360.0 {
        return "turns where the file means degrees";
    }
    if factor < 1.0 { "degrees where the file means rad" } else { "rad where the file means degrees" }
}

impl Correction {
    /// One sentence without its stop; `target` names a target.
    pub fn words(&self, mechanism: &Mechanism, target: &dyn Fn(&Point) -> String) -> String {
        let names = mechanism.actuator_names();
        let name = |i: &usize| names.get(*i).cloned().unwrap_or_default();
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
            Correction::OneScale(i, f) => format!("readings of {} look like {}", name(i), angles(*f)),
            Correction::TurningScale(f) => {
                format!("readings of turning actuators and their \"home\" look like {}", angles(*f))
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
            Correction::Euler(convention, factor) => {
                let axes = if convention.fixed { "fixed" } else { "moving" };
                let [a, b, c] = convention.letters();
                let unit = if *factor == 1.0 { String::new() } else { format!(", {}", angles(*factor)) };
                let degrees = "degrees=True where they are degrees";
                format!(
                    "rotations look like angles about {axes} axes {a}, {b}, {c}{unit}: write rotation vectors, those of \
                     {} with the angles a, b, c as they stand (in SciPy Rotation.from_euler(\"{}\", [a, b, c]).as_rotvec(), \
                     {degrees})",
                    convention.formula(),
                    convention.name()
                )
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
            Correction::AllReversed(false) => {
                "all actuators look reversed: negate the readings, or the axes".to_owned()
            }
            Correction::AllReversed(true) => {
                "all actuators look reversed about their homes: turn their axes round".to_owned()
            }
            Correction::Unwrapped(which) => {
                let all: Vec<String> = which.iter().map(name).collect();
                format!(
                    "readings of {} look counted within one turn: write them with the whole turns that the screw made",
                    all.join(", ")
                )
            }
            Correction::Handed(screws) => {
                let named = |(limb, joint): &(usize, usize)| {
                    let limb = mechanism.limbs.get(*limb)?;
                    Some(format!("{}.{}", limb.name, limb.joints.get(*joint)?.name))
                };
                let all: Vec<String> = screws.iter().filter_map(named).collect();
                let (looks, its) = if all.len() == 1 { ("looks", "its") } else { ("look", "their") };
                format!("{} {looks} of the other hand than drawn: negate {its} \"pitch\"", all.join(", "))
            }
            Correction::Exchanged(a, b) => {
                let mut both = [target(a), target(b)];
                both.sort();
                format!("targets {} look exchanged: exchange their names", both.join(" and "))
            }
            Correction::PositionOrder(order) => {
                let columns = order.map(|i| ["x", "y", "z"][i]).join(", ");
                format!("position columns look out of order: x, y, z seem to be {columns}")
            }
            Correction::FromHome => {
                "readings look counted from home: remove \"home\" of the actuators".to_owned()
            }
            Correction::Coupled { joint, by, factor } => {
                let (joint, by) = (name(joint), name(by));
                let (sign, less) = if *factor > 0.0 { ("+", "plus") } else { ("-", "less") };
                format!(
                    "{joint} looks coupled to {by}: its joint angle seems to be {joint} {sign} {by} (from home), as where a \
                     controller counts {joint} from another link; write its reading {less} that of {by}"
                )
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
            Correction::Offsets(_) => "readings at home look different from \"home\"".to_owned(),
        }
    }
}
