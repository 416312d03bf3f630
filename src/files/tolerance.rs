//! Tolerances and bounds of links as a problem file writes them.

use super::error::FileError;
use super::fault::Fault;
use super::place::Place;
use super::units::Units;
use crate::model::{Prior, Tolerance};
use serde::de::value::MapAccessDeserializer;
use serde::de::{self, Deserialize, Deserializer, Visitor};
use serde::{Deserialize as DeriveDeserialize, Serialize};
use std::fmt;

/// A standard deviation, angle or length of the file, or the word `free`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Spread {
    /// Standard deviation; 0 holds the component.
    Sigma(f64),
    /// Nothing is known.
    Free,
}

impl Serialize for Spread {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Spread::Sigma(sigma) => serializer.serialize_f64(*sigma),
            Spread::Free => serializer.serialize_str("free"),
        }
    }
}

impl<'de> Deserialize<'de> for Spread {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(SpreadVisitor)
    }
}

struct SpreadVisitor;

impl Visitor<'_> for SpreadVisitor {
    type Value = Spread;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a standard deviation, or \"free\"")
    }

    fn visit_f64<E: de::Error>(self, value: f64) -> Result<Spread, E> {
        Ok(Spread::Sigma(value))
    }

    fn visit_i64<E: de::Error>(self, value: i64) -> Result<Spread, E> {
        Ok(Spread::Sigma(value as f64))
    }

    fn visit_u64<E: de::Error>(self, value: u64) -> Result<Spread, E> {
        Ok(Spread::Sigma(value as f64))
    }

    fn visit_str<E: de::Error>(self, value: &str) -> Result<Spread, E> {
        if value == "free" {
            Ok(Spread::Free)
        } else {
            Err(E::invalid_value(de::Unexpected::Str(value), &self))
        }
    }
}

/// Tolerance of links: standard deviations of angle and length, or `free` for both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToleranceDrawing {
    /// Of each rotation component, angle of the file.
    pub angle: Spread,
    /// Of each translation component, length of the file.
    pub length: Spread,
}

#[derive(Serialize, DeriveDeserialize)]
#[serde(deny_unknown_fields)]
struct SpreadPair {
    angle: Spread,
    length: Spread,
}

impl Serialize for ToleranceDrawing {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match (self.angle, self.length) {
            (Spread::Free, Spread::Free) => serializer.serialize_str("free"),
            (angle, length) => SpreadPair { angle, length }.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for ToleranceDrawing {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ToleranceVisitor)
    }
}

struct ToleranceVisitor;

impl<'de> Visitor<'de> for ToleranceVisitor {
    type Value = ToleranceDrawing;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("{\"angle\": ..., \"length\": ...} or \"free\"")
    }

    fn visit_str<E: de::Error>(self, value: &str) -> Result<ToleranceDrawing, E> {
        let spread = SpreadVisitor.visit_str(value)?;
        Ok(ToleranceDrawing { angle: spread, length: spread })
    }

    fn visit_map<A: de::MapAccess<'de>>(self, map: A) -> Result<ToleranceDrawing, A::Error> {
        let SpreadPair { angle, length } = SpreadPair::deserialize(MapAccessDeserializer::new(map))?;
        Ok(ToleranceDrawing { angle, length })
    }
}

impl ToleranceDrawing {
    pub(super) fn of(tolerance: &Tolerance, units: Units) -> Self {
        let spread = |prior, convert: fn(Units, f64) -> f64| match prior {
            Prior::Held => Spread::Sigma(0.0),
            Prior::Sigma(sigma) => Spread::Sigma(convert(units, sigma)),
            Prior::Free => Spread::Free,
        };
        Self {
            angle: spread(tolerance.angle, Units::from_radians),
            length: spread(tolerance.length, Units::from_metres),
        }
    }

    pub(super) fn read(&self, units: Units, at: &Place<'_>) -> Result<Tolerance, FileError> {
        Ok(Tolerance {
            angle: prior(self.angle, |v, at| units.angle(v, at), &at.key("angle"))?,
            length: prior(self.length, |v, at| units.length(v, at), &at.key("length"))?,
        })
    }
}

pub(super) fn prior(
    spread: Spread,
    convert: impl Fn(f64, &Place<'_>) -> Result<f64, FileError>,
    at: &Place<'_>,
) -> Result<Prior, FileError> {
    match spread {
        Spread::Free => Ok(Prior::Free),
        Spread::Sigma(sigma) if sigma < 0.0 => Err(at.error(Fault::NegativeTolerance(sigma))),
        Spread::Sigma(sigma) => match convert(sigma, at)? {
            0.0 => Ok(Prior::Held),
            sigma => Ok(Prior::Sigma(sigma)),
        },
    }
}

/// Hard limits on the components of links' deviations.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, DeriveDeserialize)]
#[serde(deny_unknown_fields)]
pub struct BoundsDrawing {
    /// Of each rotation component, angle of the file; none where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub angle: Option<f64>,
    /// Of each translation component, length of the file; none where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub length: Option<f64>,
}

impl BoundsDrawing {
    pub(super) fn of(bounds: (f64, f64), units: Units) -> Self {
        let finite = |v: f64| v.is_finite().then_some(v);
        Self {
            angle: finite(bounds.0).map(|v| units.from_radians(v)),
            length: finite(bounds.1).map(|v| units.from_metres(v)),
        }
    }

    /// Limits on angle (rad) and length (m), infinite where there are none.
    pub(super) fn read(&self, units: Units, at: &Place<'_>) -> Result<(f64, f64), FileError> {
        let angle = limit(self.angle, |v, at| units.angle(v, at), &at.key("angle"))?;
        let length = limit(self.length, |v, at| units.length(v, at), &at.key("length"))?;
        Ok((angle, length))
    }
}

pub(super) fn limit(
    value: Option<f64>,
    convert: impl Fn(f64, &Place<'_>) -> Result<f64, FileError>,
    at: &Place<'_>,
) -> Result<f64, FileError> {
    match value {
        None => Ok(f64::INFINITY),
        Some(value) if value < 0.0 => Err(at.error(Fault::NegativeBound(value))),
        Some(value) => convert(value, at),
    }
}
