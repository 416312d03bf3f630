//! The `data` of a problem file: where the measured postures are, and what is known of their noise.

use super::columns::ColumnsDrawing;
use super::dataset::{DataSet, Kind, MeasuredPose, PlannedPosture};
use super::error::FileError;
use super::fault::Fault;
use super::noise::{CovarianceDrawing, NoiseDrawing, assumed_noise, read_noise};
use super::place::Place;
use super::pose::PoseDrawing;
use super::problem::DataPlaces;
use super::readings::{readings, variables};
use super::table::{self, PoseColumns, TableRequest};
use super::units::Units;
use crate::calibration::Sample;
use crate::lie::Se3;
use crate::model::Mechanism;
use nalgebra::Matrix6;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Measured postures, inline or in a CSV file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DataDrawing {
    /// What was measured: a name of [`Kind`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kind: Option<String>,
    /// Where the data come from, in words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origin: Option<String>,
    /// Of every sample that does not state its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise: Option<NoiseDrawing>,
    /// Instead of `noise`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub covariance: Option<CovarianceDrawing>,
    /// CSV file, beside the problem file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// What the columns of the file are called, where it has names of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub columns: Option<ColumnsDrawing>,
    /// The rows of the file that count: those with this text in this column.
    #[serde(default, rename = "where", skip_serializing_if = "Option::is_none")]
    pub filter: Option<BTreeMap<String, String>>,
    /// Samples inline.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples: Option<Vec<SampleDrawing>>,
    /// Like this, never used to identify.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub holdout: Option<Box<DataDrawing>>,
}

/// One measured posture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SampleDrawing {
    /// Readings in actuator order, angle or length of the file.
    pub actuators: Vec<f64>,
    /// Measured pose; left out where the posture is only planned.
    #[serde(default, skip_serializing_if = "PoseDrawing::is_empty")]
    pub pose: PoseDrawing,
    /// Of this sample.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise: Option<NoiseDrawing>,
    /// Instead of `noise`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub covariance: Option<CovarianceDrawing>,
}

impl SampleDrawing {
    /// A posture with joint variables `variables` (rad or m, actuator order) measured at `pose`.
    pub fn of(mechanism: &Mechanism, units: Units, variables: &[f64], pose: &Se3) -> Self {
        let actuators = readings(mechanism, units, variables);
        Self { actuators, pose: PoseDrawing::of(pose, units), noise: None, covariance: None }
    }
}

/// What the data of a problem refer to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Context<'a> {
    pub mechanism: &'a Mechanism,
    pub units: Units,
    /// Folder of the problem file.
    pub folder: &'a Path,
    pub places: &'a DataPlaces,
}

impl DataDrawing {
    /// The postures, and those of the hold-out.
    pub(super) fn read(
        &self,
        context: &Context<'_>,
        at: &Place<'_>,
    ) -> Result<(DataSet, DataSet), FileError> {
        let data = self.read_set(context, at)?;
        let holdout = match &self.holdout {
            None => DataSet::default(),
            Some(holdout) if holdout.holdout.is_some() => {
                return Err(at.key("holdout").key("holdout").error(Fault::NestedHoldout));
            }
            Some(holdout) => holdout.inheriting(self).read_set(context, &at.key("holdout"))?,
        };
        Ok((data, holdout))
    }

    /// The same, with what is left out taken from `data`: kind and noise, and the names of the columns.
    fn inheriting(&self, data: &DataDrawing) -> DataDrawing {
        let mut whole = self.clone();
        whole.kind = whole.kind.or_else(|| data.kind.clone());
        if whole.noise.is_none() && whole.covariance.is_none() {
            (whole.noise, whole.covariance) = (data.noise.clone(), data.covariance.clone());
        }
        if whole.samples.is_none() && whole.file.is_none() && whole.filter.is_some() {
            whole.file.clone_from(&data.file);
        }
        if whole.file.is_some() && whole.columns.is_none() {
            whole.columns.clone_from(&data.columns);
        }
        whole
    }

    fn read_set(&self, context: &Context<'_>, at: &Place<'_>) -> Result<DataSet, FileError> {
        let kind = Kind::read(self.kind.as_deref(), &at.key("kind"))?;
        let noise = read_noise(self.noise.as_ref(), self.covariance.as_ref(), kind, context.units, at)?;
        let set = DataSet { kind, noise, origin: self.origin.clone(), ..DataSet::default() };
        let weight = noise.unwrap_or_else(|| assumed_noise(context.mechanism));
        let mut filling = Filling { set, weight, context };
        match (&self.samples, &self.file) {
            (Some(_), Some(_)) => return Err(at.key("file").error(Fault::TwoSources)),
            (None, Some(file)) => filling.add_table(self, file, at)?,
            (_, None) if self.columns.is_some() => {
                return Err(at.key("columns").error(Fault::WithoutFile("columns")));
            }
            (_, None) if self.filter.is_some() => {
                return Err(at.key("where").error(Fault::WithoutFile("where")));
            }
            (samples, None) => filling.add_samples(samples.as_deref().unwrap_or_default(), at)?,
        }
        Ok(filling.set)
    }
}

/// A set of data while it is read.
struct Filling<'a> {
    set: DataSet,
    /// Covariance by which samples are weighted.
    weight: Matrix6<f64>,
    context: &'a Context<'a>,
}

impl Filling<'_> {
    fn add_samples(&mut self, samples: &[SampleDrawing], at: &Place<'_>) -> Result<(), FileError> {
        let list = at.key("samples");
        for (i, sample) in samples.iter().enumerate() {
            let name = format!("sample {}", i + 1);
            let entry = list.index(i);
            let here = entry.named(&name);
            let (noise, covariance) = (sample.noise.as_ref(), sample.covariance.as_ref());
            let own = read_noise(noise, covariance, self.set.kind, self.context.units, &here)?;
            let (readings_at, pose_at) = (here.key("actuators"), here.key("pose"));
            self.add(name.clone(), (&sample.actuators, &readings_at), (&sample.pose, &pose_at), own)?;
        }
        Ok(())
    }

    fn add_table(&mut self, drawing: &DataDrawing, file: &str, at: &Place<'_>) -> Result<(), FileError> {
        let path = self.context.places.find(self.context.folder, file, &at.key("file"))?;
        let names = self.context.mechanism.actuator_names();
        let request = TableRequest {
            actuators: &names,
            columns: drawing.columns.as_ref(),
            filter: drawing.filter.as_ref(),
            poses: match self.set.kind {
                Kind::Pose => PoseColumns::Complete,
                Kind::Position => PoseColumns::Position,
            },
        };
        let shown = path.display().to_string();
        let whole = Place::file(&shown);
        let short =
            path.file_name().map_or_else(|| shown.clone(), |name| name.to_string_lossy().into_owned());
        for row in table::parse(&shown, &table::read(&path)?, &request)? {
            let line = whole.line(row.line);
            let name = format!("{short} line {}", row.line);
            self.add(name, (&row.readings, &line), (&row.pose, &line), None)?;
        }
        Ok(())
    }

    fn add(
        &mut self,
        name: String,
        (readings, readings_at): (&[f64], &Place<'_>),
        (pose, pose_at): (&PoseDrawing, &Place<'_>),
        own: Option<Matrix6<f64>>,
    ) -> Result<(), FileError> {
        let Context { mechanism, units, .. } = *self.context;
        let actuators = variables(mechanism, units, readings, readings_at)?;
        if pose.is_empty() {
            self.set.planned.push(PlannedPosture { name, actuators });
            return Ok(());
        }
        let seen = match self.set.kind {
            Kind::Pose => pose.components(units, pose_at)?,
            Kind::Position => pose.position_only(units, pose_at)?,
        };
        if !seen.rotation && seen.position == [false; 3] {
            return Err(pose_at.error(Fault::NothingMeasured));
        }
        let measured = MeasuredPose::new(seen, own);
        let measurement =
            measured.measurement(&self.weight).map_err(|_| pose_at.error(Fault::NotPositive))?;
        self.set.samples.push(Sample { name, actuators, measurement });
        self.set.measured.push(measured);
        Ok(())
    }
}
