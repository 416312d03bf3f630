//! Units of a file. Inside there is one of each, m and rad; files are converted here.

use super::error::FileError;
use super::fault::Fault;
use super::place::Place;
use crate::lie::{Se3, so3};
use crate::model::Motion;
use nalgebra::{Matrix6, Vector3};
use serde::{Deserialize, Serialize};

/// Largest length (m) and angle (rad) that a file may hold: no machine is larger, squares stay exact.
pub const LARGEST: f64 = 1e6;

/// Unit of length of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum LengthUnit {
    /// m
    #[serde(rename = "m")]
    Metre,
    /// mm
    #[serde(rename = "mm")]
    Millimetre,
}

/// Unit of angle of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum AngleUnit {
    /// rad
    #[serde(rename = "rad")]
    Radian,
    /// deg
    #[serde(rename = "deg")]
    Degree,
}

/// Units of every number of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Units {
    /// Of lengths.
    pub length: LengthUnit,
    /// Of angles.
    pub angle: AngleUnit,
}

impl Units {
    /// m and rad.
    pub const SI: Units = Units { length: LengthUnit::Metre, angle: AngleUnit::Radian };

    /// Symbol of the unit of length.
    pub fn length_symbol(self) -> &'static str {
        match self.length {
            LengthUnit::Metre => "m",
            LengthUnit::Millimetre => "mm",
        }
    }

    /// Symbol of the unit of angle.
    pub fn angle_symbol(self) -> &'static str {
        match self.angle {
            AngleUnit::Radian => "rad",
            AngleUnit::Degree => "deg",
        }
    }

    /// Length of the file in m.
    pub fn to_metres(self, length: f64) -> f64 {
        match self.length {
            LengthUnit::Metre => length,
            LengthUnit::Millimetre => length / 1000.0,
        }
    }

    /// Angle of the file in rad.
    pub fn to_radians(self, angle: f64) -> f64 {
        match self.angle {
            AngleUnit::Radian => angle,
            AngleUnit::Degree => angle.to_radians(),
        }
    }

    /// Length in m as the file states it.
    pub fn from_metres(self, metres: f64) -> f64 {
        match self.length {
            LengthUnit::Metre => metres,
            LengthUnit::Millimetre => metres * 1000.0,
        }
    }

    /// Angle in rad as the file states it.
    pub fn from_radians(self, radians: f64) -> f64 {
        match self.angle {
            AngleUnit::Radian => radians,
            AngleUnit::Degree => radians.to_degrees(),
        }
    }

    /// Joint variable or reading, rad or m, as the file states it.
    pub fn from_joint(self, motion: Motion, value: f64) -> f64 {
        if motion.is_angular() { self.from_radians(value) } else { self.from_metres(value) }
    }

    /// Position and rotation vector of a pose as the file states them.
    pub fn from_pose(self, pose: &Se3) -> ([f64; 3], [f64; 3]) {
        let w: [f64; 3] = so3::log(&pose.r).into();
        let p: [f64; 3] = pose.p.into();
        (p.map(|v| self.from_metres(v)), w.map(|v| self.from_radians(v)))
    }

    /// Covariance, rotation first (rad and m), as the file states it.
    pub fn from_covariance(self, covariance: &Matrix6<f64>) -> [[f64; 6]; 6] {
        let scale = |i: usize| if i < 3 { self.from_radians(1.0) } else { self.from_metres(1.0) };
        std::array::from_fn(|i| std::array::from_fn(|j| covariance[(i, j)] * scale(i) * scale(j)))
    }

    /// Checked length of the file in m.
    pub(super) fn length(self, value: f64, at: &Place<'_>) -> Result<f64, FileError> {
        limited(self.to_metres(value), "m", at)
    }

    /// Checked angle of the file in rad.
    pub(super) fn angle(self, value: f64, at: &Place<'_>) -> Result<f64, FileError> {
        limited(self.to_radians(value), "rad", at)
    }

    /// Checked joint variable or reading of the file in rad or m.
    pub(super) fn joint(self, motion: Motion, value: f64, at: &Place<'_>) -> Result<f64, FileError> {
        if motion.is_angular() { self.angle(value, at) } else { self.length(value, at) }
    }

    /// Checked point of the file in m.
    pub(super) fn point(self, value: &[f64; 3], at: &Place<'_>) -> Result<Vector3<f64>, FileError> {
        let mut point = Vector3::zeros();
        for (i, (to, from)) in point.iter_mut().zip(value).enumerate() {
            *to = self.length(*from, &at.index(i))?;
        }
        Ok(point)
    }
}

/// The value, if it is finite and not too large to be meant.
pub(super) fn limited(value: f64, unit: &'static str, at: &Place<'_>) -> Result<f64, FileError> {
    if !value.is_finite() {
        Err(at.error(Fault::NotFinite(value)))
    } else if value.abs() > LARGEST {
        Err(at.error(Fault::Huge { value, limit: LARGEST, unit }))
    } else {
        Ok(value)
    }
}
