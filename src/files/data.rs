//! The `data` of a problem file: where the measured postures are, and what is known of their noise.

use super::columns::ColumnsDrawing;
use super::dataset::{DataSet, Kind};
use super::error::FileError;
use super::fault::Fault;
use super::filling::Filling;
use super::instrument::{Instrument, InstrumentDrawing};
use super::kinds::{self, Reader};
use super::noise::{CovarianceDrawing, NoiseDrawing, PostureNoiseDrawing, assumed_noise, read_noise};
use super::place::Place;
use super::pose::PoseDrawing;
use super::problem::DataPlaces;
use super::readings::readings;
use super::units::Units;
use crate::lie::Se3;
use crate::model::Mechanism;
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
    /// What all samples of one posture have in common beside their own noise. Of the data as a whole, their hold-out
    /// included.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub posture_noise: Option<PostureNoiseDrawing>,
    /// CSV file, beside the problem file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// What the columns of the file are called, where it has names of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub columns: Option<ColumnsDrawing>,
    /// The rows of the file that count: those with this text in this column.
    #[serde(default, rename = "where", skip_serializing_if = "Option::is_none")]
    pub filter: Option<BTreeMap<String, String>>,
    /// What the measurements refer to. Of the data as a whole, their hold-out included.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub instrument: Option<InstrumentDrawing>,
    /// Names `limb.joint` of the sensed passive joints, in the order of readings; all passive joints where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joints: Option<Vec<String>>,
    /// The target of every sample that does not name its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target: Option<String>,
    /// The fixed point of every sample that does not name its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub point: Option<String>,
    /// The plane of every sample that does not name its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plane: Option<String>,
    /// The gauge of every sample that does not name its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gauge: Option<String>,
    /// Samples inline.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples: Option<Vec<SampleDrawing>>,
    /// Several sets, each of its own kind and noise, instead of `samples` or `file`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sets: Option<Vec<DataDrawing>>,
    /// Like this, never used to identify.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub holdout: Option<Box<DataDrawing>>,
}

/// One measured posture.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SampleDrawing {
    /// Readings in actuator order, angle or length of the file.
    pub actuators: Vec<f64>,
    /// Measured pose; left out where the posture is only planned.
    #[serde(default, skip_serializing_if = "PoseDrawing::is_empty")]
    pub pose: PoseDrawing,
    /// Actuator readings of the posture that this one is compared with.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub second: Option<Vec<f64>>,
    /// Measured distance, length of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distance: Option<f64>,
    /// Measured height above the plane, length of the file; a touch where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height: Option<f64>,
    /// Readings of the sensed joints, angle or length of the file; `null` for one that was not read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joints: Option<Vec<Option<f64>>>,
    /// Name of the target on the tool.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target: Option<String>,
    /// Name of the fixed point.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub point: Option<String>,
    /// Name of the plane.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plane: Option<String>,
    /// Name of the gauge.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gauge: Option<String>,
    /// Of this sample.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise: Option<NoiseDrawing>,
    /// Instead of `noise`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub covariance: Option<CovarianceDrawing>,
    /// Factor on what the sample is worth, 1 where left out; with 0 it is not used, only predicted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weight: Option<f64>,
}

impl SampleDrawing {
    /// Whether nothing was read but actuators, of two postures where `kind` compares them: it is planned, not measured. A
    /// touch has nothing else to read, so that it is always measured.
    pub(super) fn is_planned(&self, kind: Kind) -> bool {
        kind != Kind::Plane
            && self.pose.is_empty()
            && (self.second.is_none() || kind == Kind::Separation)
            && self.distance.is_none()
            && self.height.is_none()
            && self.joints.is_none()
    }

    /// A posture with joint variables `variables` (rad or m, actuator order) measured at `pose`.
    pub fn of(mechanism: &Mechanism, units: Units, variables: &[f64], pose: &Se3) -> Self {
        let actuators = readings(mechanism, units, variables);
        Self { actuators, pose: PoseDrawing::of(pose, units), ..Self::default() }
    }
}

/// What the data of a problem refer to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Context<'a> {
    pub mechanism: &'a Mechanism,
    pub units: Units,
    pub instrument: &'a Instrument,
    /// Folder of the problem file.
    pub folder: &'a Path,
    pub places: &'a DataPlaces,
}

impl DataDrawing {
    /// The instrument, of which the data and their hold-out are made.
    pub(super) fn instrument(&self, units: Units, at: &Place<'_>) -> Result<Instrument, FileError> {
        let list = at.key("sets");
        let sets = self.sets.iter().flatten().enumerate().map(|(i, set)| (set, list.index(i)));
        let holdout = self.holdout.iter().map(|holdout| (&**holdout, at.key("holdout")));
        for (part, at) in sets.chain(holdout) {
            for (key, stated) in
                [("instrument", part.instrument.is_some()), ("posture_noise", part.posture_noise.is_some())]
            {
                if stated {
                    return Err(at.key(key).error(Fault::OfWholeData(key)));
                }
            }
        }
        match &self.instrument {
            Some(instrument) => instrument.read(units, &at.key("instrument")),
            None => Ok(Instrument::default()),
        }
    }

    /// The postures, and those of the hold-out.
    pub(super) fn read(
        &self,
        context: &Context<'_>,
        at: &Place<'_>,
    ) -> Result<(DataSet, DataSet), FileError> {
        let data = self.read_sets(context, at)?;
        let holdout = match &self.holdout {
            None => DataSet::default(),
            Some(holdout) if holdout.holdout.is_some() => {
                return Err(at.key("holdout").key("holdout").error(Fault::NestedHoldout));
            }
            Some(holdout) => holdout.inheriting(self).read_sets(context, &at.key("holdout"))?,
        };
        let Some(stated) = &self.posture_noise else { return Ok((data, holdout)) };
        let common = stated.read(context.units, &at.key("posture_noise"))?;
        Ok((data.with_posture_noise(common), holdout.with_posture_noise(common)))
    }

    /// The same, with what is left out taken from `data`: kind and noise, the names of the columns, and what
    /// measurements refer to.
    fn inheriting(&self, data: &DataDrawing) -> DataDrawing {
        let mut whole = self.clone();
        whole.kind = whole.kind.or_else(|| data.kind.clone());
        if whole.noise.is_none() && whole.covariance.is_none() {
            (whole.noise, whole.covariance) = (data.noise.clone(), data.covariance.clone());
        }
        let none = whole.samples.is_none() && whole.sets.is_none();
        if none && whole.file.is_none() && whole.filter.is_some() {
            whole.file.clone_from(&data.file);
        }
        if whole.file.is_some() && whole.columns.is_none() {
            whole.columns.clone_from(&data.columns);
        }
        for (own, other) in [
            (&mut whole.target, &data.target),
            (&mut whole.point, &data.point),
            (&mut whole.plane, &data.plane),
            (&mut whole.gauge, &data.gauge),
        ] {
            if own.is_none() {
                own.clone_from(other);
            }
        }
        whole.joints = whole.joints.or_else(|| data.joints.clone());
        whole
    }

    fn read_sets(&self, context: &Context<'_>, at: &Place<'_>) -> Result<DataSet, FileError> {
        let Some(sets) = &self.sets else { return self.read_set(context, at, "") };
        for (key, stated) in [
            ("samples", self.samples.is_some()),
            ("file", self.file.is_some()),
            ("columns", self.columns.is_some()),
            ("where", self.filter.is_some()),
        ] {
            if stated {
                return Err(at.key(key).error(Fault::BesideSets(key)));
            }
        }
        let list = at.key("sets");
        if sets.is_empty() {
            return Err(list.error(Fault::NoSet));
        }
        let mut read = Vec::with_capacity(sets.len());
        for (i, set) in sets.iter().enumerate() {
            let here = list.index(i);
            for (key, stated) in [("sets", set.sets.is_some()), ("holdout", set.holdout.is_some())] {
                if stated {
                    return Err(here.key(key).error(Fault::OfWholeData(key)));
                }
            }
            let prefix = format!("set {} ", i + 1);
            read.push(set.inheriting(self).read_set(context, &here, &prefix)?);
        }
        Ok(DataSet::of_sets(read, self.origin.clone()))
    }

    fn read_set(&self, context: &Context<'_>, at: &Place<'_>, prefix: &str) -> Result<DataSet, FileError> {
        let kind = Kind::read(self.kind.as_deref(), &at.key("kind"))?;
        let Context { mechanism, units, instrument, .. } = *context;
        let sensed = match kind {
            Kind::PassiveJoint => kinds::sensed(mechanism, self.joints.as_ref(), &at.key("joints"))?,
            _ => Vec::new(),
        };
        let reader = Reader { kind, mechanism, units, instrument, sensed };
        let needs = kind.needs(&reader.sensed);
        let noise = read_noise(self.noise.as_ref(), self.covariance.as_ref(), needs, units, at)?;
        let set = DataSet { kind, noise, origin: self.origin.clone(), ..DataSet::default() };
        let weight = noise.unwrap_or_else(|| assumed_noise(mechanism));
        let mut filling = Filling { set, weight, context, reader, common: self, prefix };
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
        filling.add_blanks(at)?;
        Ok(filling.set)
    }
}
