//! Measured postures, read.

use super::error::{FileError, quoted};
use super::fault::Fault;
use super::place::Place;
use super::pose::Components;
use crate::calibration::Sample;
use crate::lie::Se3;
use crate::measure::pose::NotPositive;
use crate::measure::{Measurement, Pose};
use nalgebra::Matrix6;
use std::sync::Arc;

/// What the instrument measures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    /// Position and rotation of the tool.
    #[default]
    Pose,
    /// Position of the tool point.
    Position,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Kind; 2] = [Kind::Pose, Kind::Position];

    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Pose => "pose",
            Kind::Position => "position",
        }
    }

    pub(super) fn read(name: Option<&str>, at: &Place<'_>) -> Result<Self, FileError> {
        let Some(name) = name else { return Ok(Kind::default()) };
        Kind::ALL.into_iter().find(|kind| kind.name() == name).ok_or_else(|| {
            let known = Kind::ALL.map(Kind::name).join(", ");
            at.error(Fault::UnknownKind { found: quoted(name), known })
        })
    }
}

/// A measured pose, rad and m, and which parts of it were measured; the others are placeholders.
#[derive(Clone, Debug)]
pub struct MeasuredPose {
    /// The pose, zero where it was not measured.
    pub pose: Se3,
    /// Whether the rotation was measured.
    pub rotation: bool,
    /// Which coordinates of the position were measured.
    pub position: [bool; 3],
    /// Covariance of this sample alone (rotation first, rad and m), where it states its own.
    pub noise: Option<Box<Matrix6<f64>>>,
}

impl MeasuredPose {
    pub(super) fn new(seen: Components, noise: Option<Matrix6<f64>>) -> Self {
        let Components { pose, rotation, position } = seen;
        Self { pose, rotation, position, noise: noise.map(Box::new) }
    }

    /// Whether no component is a placeholder.
    pub fn is_complete(&self) -> bool {
        self.rotation && self.position == [true; 3]
    }

    /// The measurement that it is, weighted by its own noise, or else by `covariance` (rotation first, rad and m).
    pub fn measurement(&self, covariance: &Matrix6<f64>) -> Result<Arc<dyn Measurement>, NotPositive> {
        let [x, y, z] = self.position;
        let seen = [self.rotation, self.rotation, self.rotation, x, y, z];
        Ok(Arc::new(Pose::new(self.pose, seen, self.noise.as_deref().unwrap_or(covariance))?))
    }
}

/// A posture of which nothing was measured yet.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedPosture {
    /// Where it stands in its source.
    pub name: String,
    /// Actuator variables (reading - home) in actuator order, rad or m.
    pub actuators: Vec<f64>,
}

/// The postures that a problem's `data` or `holdout` holds; none where only noise is stated.
#[derive(Clone, Debug, Default)]
pub struct DataSet {
    /// What was measured.
    pub kind: Kind,
    /// The samples, weighted by the stated noise, or else by [`super::noise::assumed_noise`].
    pub samples: Vec<Sample>,
    /// What was measured in each of the samples.
    pub measured: Vec<MeasuredPose>,
    /// Postures that are planned: readings without a pose.
    pub planned: Vec<PlannedPosture>,
    /// Covariance of a measured pose (rotation first, rad and m), where it is stated for all samples.
    pub noise: Option<Matrix6<f64>>,
    /// Where the data come from, in words.
    pub origin: Option<String>,
}

impl DataSet {
    /// Whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// Whether the noise of every sample is stated.
    pub fn has_noise(&self) -> bool {
        self.noise.is_some() || (!self.is_empty() && self.measured.iter().all(|m| m.noise.is_some()))
    }

    /// The samples weighted anew by `covariance` (rotation first, rad and m), but for those with noise of their own.
    pub fn weighted(&self, covariance: &Matrix6<f64>) -> Result<Vec<Sample>, NotPositive> {
        let pairs = self.samples.iter().zip(&self.measured);
        pairs
            .map(|(sample, measured)| {
                Ok(Sample { measurement: measured.measurement(covariance)?, ..sample.clone() })
            })
            .collect()
    }
}
