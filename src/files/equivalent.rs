//! From a drawn joint to its equivalent joints of one degree of freedom.

use super::drawing::JointDrawing;
use super::error::{FileError, quoted};
use super::fault::Fault;
use super::place::Place;
use super::units::{Units, limited};
use super::values::OneOrEach;
use crate::model::joint::{KINDS, Kind, frame_on_axis};
use crate::model::{Joint, Motion};
use nalgebra::Vector3;
use std::f64::consts::TAU;

/// Largest component of a direction below which it counts as zero.
const ZERO_AXIS: f64 = 1e-9;

impl JointDrawing {
    /// The equivalent joints in chain order: `name`, or `name.1`, `name.2`... where there are several.
    pub(super) fn equivalents(
        &self,
        name: &str,
        units: Units,
        at: &Place<'_>,
    ) -> Result<Vec<Joint>, FileError> {
        let kind = self.known_kind(at)?;
        let count = kind.motions.len();
        let point = units.point(&self.point, &at.key("point"))?;
        let axes = self.directions(kind, at)?;
        let advance = self.advance(kind, units, at)?;
        let actuated = match &self.actuated {
            None => vec![false; count],
            Some(OneOrEach::One(all)) => vec![*all; count],
            Some(OneOrEach::Each(list)) => counted(list, count, &at.key("actuated"))?,
        };
        let homes = per_axis(self.home.as_ref(), &actuated, &at.key("home"))?;
        let at_range = at.key("range");
        let range = match self.range.as_ref().map(|range| range.meaning()) {
            Some(None) => return Err(at_range.error(Fault::RangeForm)),
            Some(meaning) => meaning,
            None => None,
        };
        let ranges = per_axis(range.as_ref(), &actuated, &at_range)?;
        let mut joints = Vec::with_capacity(count);
        let values = actuated.into_iter().zip(homes).zip(ranges);
        for (k, ((motion, axis), ((actuated, home), range))) in kind.motions.iter().zip(values).enumerate() {
            let motion = match motion {
                Motion::Helical { .. } => Motion::Helical { advance },
                other => *other,
            };
            let wrong_count = Fault::AxisCount { kind: kind.name, wanted: kind.axes, found: axes.len() };
            let axis = axes.get(*axis).ok_or_else(|| at.key("axes").error(wrong_count))?;
            joints.push(Joint {
                name: if count == 1 { name.to_owned() } else { format!("{name}.{}", k + 1) },
                motion,
                frame: frame_on_axis(point, axis),
                actuated,
                sensed: false,
                home: units.joint(motion, home.unwrap_or(0.0), &at.key("home"))?,
                range: range.flatten().map(|pair| read_range(pair, motion, units, &at_range)).transpose()?,
            });
        }
        Ok(joints)
    }

    fn known_kind(&self, at: &Place<'_>) -> Result<&'static Kind, FileError> {
        KINDS.iter().find(|kind| kind.name == self.kind).ok_or_else(|| {
            let known: Vec<&str> = KINDS.iter().map(|kind| kind.name).collect();
            at.key("type").error(Fault::UnknownType { found: quoted(&self.kind), known: known.join(", ") })
        })
    }

    /// Directions of the axes, as many as the kind has.
    fn directions(&self, kind: &Kind, at: &Place<'_>) -> Result<Vec<Vector3<f64>>, FileError> {
        if kind.axes == 1 {
            return match (&self.axis, &self.axes) {
                (Some(axis), None) => Ok(vec![direction(axis, &at.key("axis"))?]),
                (_, Some(_)) => Err(at.key("axes").error(one_axis(kind))),
                (None, None) => Err(at.error(one_axis(kind))),
            };
        }
        let several = Fault::AxisKey { kind: kind.name, wanted: "several axes", key: "axes" };
        let list = at.key("axes");
        match (&self.axis, &self.axes) {
            (None, Some(axes)) if axes.len() == kind.axes => {
                axes.iter().enumerate().map(|(i, axis)| direction(axis, &list.index(i))).collect()
            }
            (None, Some(axes)) => {
                let fault = Fault::AxisCount { kind: kind.name, wanted: kind.axes, found: axes.len() };
                Err(list.error(fault))
            }
            (Some(_), _) => Err(at.key("axis").error(several)),
            (None, None) => Err(at.error(several)),
        }
    }

    /// Advance of a helical joint, m per rad.
    fn advance(&self, kind: &Kind, units: Units, at: &Place<'_>) -> Result<f64, FileError> {
        match (kind.has_pitch(), self.pitch) {
            (true, Some(pitch)) => Ok(units.length(pitch, &at.key("pitch"))? / TAU),
            (true, None) => Err(at.error(Fault::NoPitch(kind.name))),
            (false, Some(_)) => Err(at.key("pitch").error(Fault::Pitch(kind.name))),
            (false, None) => Ok(0.0),
        }
    }
}

fn one_axis(kind: &Kind) -> Fault {
    Fault::AxisKey { kind: kind.name, wanted: "one axis", key: "axis" }
}

/// A direction with its largest component at 1, so that its square neither overflows nor vanishes.
fn direction(axis: &[f64; 3], at: &Place<'_>) -> Result<Vector3<f64>, FileError> {
    for (i, component) in axis.iter().enumerate() {
        limited(*component, "", &at.index(i))?;
    }
    let axis = Vector3::from(*axis);
    let largest = axis.amax();
    if largest < ZERO_AXIS { Err(at.error(Fault::ZeroAxis)) } else { Ok(axis / largest) }
}

fn counted<T: Copy>(list: &[T], count: usize, at: &Place<'_>) -> Result<Vec<T>, FileError> {
    if list.len() == count {
        Ok(list.to_vec())
    } else {
        Err(at.error(Fault::OnePerAxis { wanted: count, found: list.len() }))
    }
}

/// One value per equivalent joint. A single value for several axes means the one that is actuated.
fn per_axis<T: Copy>(
    stated: Option<&OneOrEach<T>>,
    actuated: &[bool],
    at: &Place<'_>,
) -> Result<Vec<Option<T>>, FileError> {
    let count = actuated.len();
    match stated {
        None => Ok(vec![None; count]),
        Some(OneOrEach::Each(list)) => Ok(counted(list, count, at)?.into_iter().map(Some).collect()),
        Some(OneOrEach::One(value)) if count == 1 => Ok(vec![Some(*value)]),
        Some(OneOrEach::One(value)) if actuated.iter().filter(|a| **a).count() == 1 => {
            Ok(actuated.iter().map(|a| a.then_some(*value)).collect())
        }
        Some(OneOrEach::One(_)) => Err(at.error(Fault::OnePerAxis { wanted: count, found: 1 })),
    }
}

fn read_range(
    [low, high]: [f64; 2],
    motion: Motion,
    units: Units,
    at: &Place<'_>,
) -> Result<(f64, f64), FileError> {
    if low > high {
        return Err(at.error(Fault::RangeOrder(low, high)));
    }
    Ok((units.joint(motion, low, &at.index(0))?, units.joint(motion, high, &at.index(1))?))
}
