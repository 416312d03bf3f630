//! The `instrument` of a problem's data: targets on the tool, fixed points, planes and gauges, known or to be identified.

use super::error::{FileError, quoted};
use super::fault::Fault;
use super::name;
use super::place::Place;
use super::tolerance::{BoundsDrawing, Spread, ToleranceDrawing, limit, prior};
use super::units::{Units, limited};
use crate::measure::{Gauge, Plane, Point};
use crate::model::{Constant, Prior, Quantity};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What measurements refer to, by name.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InstrumentDrawing {
    /// On the tool.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub targets: BTreeMap<String, TargetDrawing>,
    /// Fixed in {S}.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub points: BTreeMap<String, FixedPointDrawing>,
    /// Fixed in {S}.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub planes: BTreeMap<String, PlaneDrawing>,
    /// What readings of distances are worth.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub gauges: BTreeMap<String, GaugeDrawing>,
}

/// A point of the tool.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TargetDrawing {
    /// In the tool's frame, length of the file; may be left out where it is free.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub offset: Option<[f64; 3]>,
    /// Of each component, length of the file; known exactly where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tolerance: Option<Spread>,
    /// Hard limit on each component's deviation, length of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bounds: Option<f64>,
}

/// A fixed point.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FixedPointDrawing {
    /// In {S}, length of the file; may be left out where it is free.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position: Option<[f64; 3]>,
    /// Of each component, length of the file; known exactly where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tolerance: Option<Spread>,
    /// Hard limit on each component's deviation, length of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bounds: Option<f64>,
}

/// A plane `n . p = offset`, `n` the normal at unit length.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlaneDrawing {
    /// Direction in {S}, any length but zero.
    pub normal: [f64; 3],
    /// Distance of {S} from it along the normal, length of the file; may be left out where it is free.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub offset: Option<f64>,
    /// Of the tilts and of the offset; known exactly where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tolerance: Option<ToleranceDrawing>,
    /// Hard limits on the deviations of tilts and offset.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bounds: Option<BoundsDrawing>,
}

/// A gauge: reading = scale * distance + zero.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GaugeDrawing {
    /// Length of the file; 0 where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub zero: Option<f64>,
    /// 1 where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
    /// Of the zero, length of the file; known exactly where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub zero_tolerance: Option<Spread>,
    /// Of the scale; known exactly where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale_tolerance: Option<Spread>,
}

/// The instrument, read: rad and m.
#[derive(Clone, Debug, Default)]
pub struct Instrument {
    /// What is unknown of it.
    pub constants: Vec<Constant>,
    /// Targets by name.
    pub targets: Vec<(String, Point)>,
    /// Fixed points by name.
    pub points: Vec<(String, Point)>,
    /// Planes by name.
    pub planes: Vec<(String, Plane)>,
    /// Gauges by name.
    pub gauges: Vec<(String, Gauge)>,
}

impl InstrumentDrawing {
    pub(super) fn read(&self, units: Units, at: &Place<'_>) -> Result<Instrument, FileError> {
        let mut read = Instrument::default();
        let list = at.key("targets");
        for (name, t) in &self.targets {
            let here = list.key(name);
            name::check(name, &here)?;
            let point =
                read.point("target", name, t.offset, t.tolerance, t.bounds, units, &here, "offset")?;
            read.targets.push((name.clone(), point));
        }
        let list = at.key("points");
        for (name, p) in &self.points {
            let here = list.key(name);
            name::check(name, &here)?;
            let point =
                read.point("point", name, p.position, p.tolerance, p.bounds, units, &here, "position")?;
            read.points.push((name.clone(), point));
        }
        let list = at.key("planes");
        for (name, plane) in &self.planes {
            let here = list.key(name);
            name::check(name, &here)?;
            let plane = read.plane(name, plane, units, &here)?;
            read.planes.push((name.clone(), plane));
        }
        let list = at.key("gauges");
        for (name, gauge) in &self.gauges {
            let here = list.key(name);
            name::check(name, &here)?;
            let gauge = read.gauge(name, gauge, units, &here)?;
            read.gauges.push((name.clone(), gauge));
        }
        Ok(read)
    }
}

impl Instrument {
    /// Lists a constant unless it is held; its index.
    fn constant(
        &mut self,
        element: &str,
        component: &'static str,
        quantity: Quantity,
        nominal: f64,
        (prior, bounds): (Prior, Option<f64>),
    ) -> Option<usize> {
        if prior == Prior::Held {
            return None;
        }
        let element = element.to_owned();
        self.constants.push(Constant { element, component, quantity, nominal, prior, bounds });
        Some(self.constants.len() - 1)
    }

    #[allow(clippy::too_many_arguments, reason = "the fields of two drawings that differ in one name")]
    fn point(
        &mut self,
        what: &str,
        name: &str,
        stated: Option<[f64; 3]>,
        tolerance: Option<Spread>,
        bounds: Option<f64>,
        units: Units,
        at: &Place<'_>,
        key: &'static str,
    ) -> Result<Point, FileError> {
        let prior = length_prior(tolerance, units, &at.key("tolerance"))?;
        let here = at.key(key);
        let nominal = match stated {
            Some(stated) => units.point(&stated, &here)?,
            None if prior == Prior::Free => Vector3::zeros(),
            None => return Err(at.error(Fault::NotStated(key))),
        };
        let bounds = match bounds {
            None => None,
            Some(_) => Some(limit(bounds, |v, at| units.length(v, at), &at.key("bounds"))?),
        };
        let element = format!("{what} {name}");
        let mut constants = None;
        for (component, value) in ["x", "y", "z"].into_iter().zip(nominal.iter()) {
            let index = self.constant(&element, component, Quantity::Length, *value, (prior, bounds));
            constants = constants.or(index);
        }
        Ok(Point { nominal, constants })
    }

    fn plane(
        &mut self,
        name: &str,
        drawn: &PlaneDrawing,
        units: Units,
        at: &Place<'_>,
    ) -> Result<Plane, FileError> {
        let here = at.key("normal");
        for (i, v) in drawn.normal.iter().enumerate() {
            limited(*v, "", &here.index(i))?;
        }
        let normal = Vector3::from(drawn.normal);
        if normal.norm() == 0.0 {
            return Err(here.error(Fault::ZeroNormal));
        }
        let tolerance = match &drawn.tolerance {
            None => None,
            Some(tolerance) => Some(tolerance.read(units, &at.key("tolerance"))?),
        };
        let (tilt, shift) = tolerance.map_or((Prior::Held, Prior::Held), |t| (t.angle, t.length));
        let offset = match drawn.offset {
            Some(offset) => units.length(offset, &at.key("offset"))?,
            None if shift == Prior::Free => 0.0,
            None => return Err(at.error(Fault::NotStated("offset"))),
        };
        let (angle, length) = match &drawn.bounds {
            Some(bounds) => bounds.read(units, &at.key("bounds"))?,
            None => (f64::INFINITY, f64::INFINITY),
        };
        let element = format!("plane {name}");
        let mut plane = Plane::known(normal, offset);
        plane.tilts = self.constant(&element, "tilt 1", Quantity::Angle, 0.0, (tilt, Some(angle)));
        self.constant(&element, "tilt 2", Quantity::Angle, 0.0, (tilt, Some(angle)));
        plane.shift = self.constant(&element, "offset", Quantity::Length, offset, (shift, Some(length)));
        Ok(plane)
    }

    fn gauge(
        &mut self,
        name: &str,
        drawn: &GaugeDrawing,
        units: Units,
        at: &Place<'_>,
    ) -> Result<Gauge, FileError> {
        let zero = units.length(drawn.zero.unwrap_or(0.0), &at.key("zero"))?;
        let scale = limited(drawn.scale.unwrap_or(1.0), "", &at.key("scale"))?;
        if scale == 0.0 {
            return Err(at.key("scale").error(Fault::ZeroScale));
        }
        let of_zero = length_prior(drawn.zero_tolerance, units, &at.key("zero_tolerance"))?;
        let of_scale = match drawn.scale_tolerance {
            None => Prior::Held,
            Some(spread) => prior(spread, |v, at| limited(v, "", at), "", &at.key("scale_tolerance"))?,
        };
        let element = format!("gauge {name}");
        let zero_constant = self.constant(&element, "zero", Quantity::Length, zero, (of_zero, None));
        let scale_constant = self.constant(&element, "scale", Quantity::Ratio, scale, (of_scale, None));
        Ok(Gauge { zero, scale, zero_constant, scale_constant })
    }
}

fn length_prior(spread: Option<Spread>, units: Units, at: &Place<'_>) -> Result<Prior, FileError> {
    match spread {
        None => Ok(Prior::Held),
        Some(spread) => prior(spread, |v, at| units.length(v, at), "m", at),
    }
}

/// The thing of this name; where no name is given, the only one there is, or else `otherwise`.
pub(super) fn named<T: Copy>(
    list: &[(String, T)],
    name: Option<&str>,
    what: &'static str,
    otherwise: Option<T>,
    at: &Place<'_>,
) -> Result<T, FileError> {
    let known = || list.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ");
    match (name, list) {
        (Some(name), _) => match list.iter().find(|(found, _)| found == name) {
            Some((_, found)) => Ok(*found),
            None => {
                let known = if list.is_empty() { "none".to_owned() } else { known() };
                Err(at.key(what).error(Fault::UnknownReference { what, found: quoted(name), known }))
            }
        },
        (None, [(_, only)]) => Ok(*only),
        (None, []) => otherwise.ok_or_else(|| at.error(Fault::NoReference(what))),
        (None, _) => Err(at.error(Fault::WhichReference { what, known: known() })),
    }
}

/// A value (rad, m or 1) of such a quantity in units of the file.
pub fn from_quantity(units: Units, quantity: Quantity, value: f64) -> f64 {
    match quantity {
        Quantity::Angle => units.from_radians(value),
        Quantity::Length => units.from_metres(value),
        Quantity::Ratio => value,
    }
}

/// The values of the constants, by name, as a file with these units states them.
pub fn constant_values(constants: &[Constant], values: &[f64], units: Units) -> BTreeMap<String, f64> {
    let shown = |(c, v): (&Constant, &f64)| (c.name(), from_quantity(units, c.quantity, *v));
    constants.iter().zip(values).map(shown).collect()
}

/// The constants with true values as their nominal ones.
pub(super) fn true_constants(
    constants: &[Constant],
    stated: &BTreeMap<String, f64>,
    units: Units,
    at: &Place<'_>,
) -> Result<Vec<Constant>, FileError> {
    if let Some(name) = stated.keys().find(|name| constants.iter().all(|c| c.name() != **name)) {
        let known: Vec<String> = constants.iter().map(Constant::name).collect();
        let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
        let fault = Fault::UnknownReference { what: "constant", found: quoted(name), known };
        return Err(at.error(fault));
    }
    let true_one = |c: &Constant| {
        let name = c.name();
        let here = at.key(&name);
        let nominal = match (stated.get(&name), c.quantity) {
            (None, _) => c.nominal,
            (Some(v), Quantity::Angle) => units.angle(*v, &here)?,
            (Some(v), Quantity::Length) => units.length(*v, &here)?,
            (Some(v), Quantity::Ratio) => limited(*v, "", &here)?,
        };
        Ok(Constant { nominal, ..c.clone() })
    };
    constants.iter().map(true_one).collect()
}
