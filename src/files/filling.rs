//! Samples of `data`, inline or of a table, as they become a set of measured postures.

use super::data::{Context, DataDrawing, SampleDrawing};
use super::dataset::{Blank, DataSet, Kind, PlannedPosture};
use super::error::FileError;
use super::fault::Fault;
use super::kinds::{Reader, Written};
use super::noise::read_noise;
use super::place::Place;
use super::readings::variables;
use super::table::{self, PoseColumns, TableRequest};
use crate::calibration::Sample;
use crate::measure::{Measurement, Weighted};
use nalgebra::Matrix6;
use std::sync::Arc;

/// Least weight of a sample that counts at all, and the inverse of the largest.
const LIGHTEST: f64 = 1e-6;

/// The weight of a sample: 1 where none is stated.
fn read_weight(stated: Option<f64>, at: &Place<'_>) -> Result<f64, FileError> {
    match stated {
        None => Ok(1.0),
        Some(weight) if weight == 0.0 || (LIGHTEST..=1.0 / LIGHTEST).contains(&weight) => Ok(weight.abs()),
        Some(found) => Err(at.error(Fault::Weight { found, least: LIGHTEST, most: 1.0 / LIGHTEST })),
    }
}

/// A set of data while it is read.
pub(super) struct Filling<'a> {
    pub set: DataSet,
    /// Covariance by which samples are weighted.
    pub weight: Matrix6<f64>,
    pub context: &'a Context<'a>,
    pub reader: Reader<'a>,
    /// What samples refer to that name nothing themselves.
    pub common: &'a DataDrawing,
    /// Of the names of samples.
    pub prefix: &'a str,
}

impl Filling<'_> {
    pub fn add_samples(&mut self, samples: &[SampleDrawing], at: &Place<'_>) -> Result<(), FileError> {
        let list = at.key("samples");
        for (i, sample) in samples.iter().enumerate() {
            let name = format!("{}sample {}", self.prefix, i + 1);
            let entry = list.index(i);
            let here = entry.named(&name);
            let (noise, covariance) = (sample.noise.as_ref(), sample.covariance.as_ref());
            let needs = self.set.kind.needs(&self.reader.sensed);
            let own = read_noise(noise, covariance, needs, self.context.units, &here)?;
            self.add(name.clone(), sample.clone(), &here, true, own)?;
        }
        Ok(())
    }

    pub fn add_table(&mut self, drawing: &DataDrawing, file: &str, at: &Place<'_>) -> Result<(), FileError> {
        let path = self.context.places.find(self.context.folder, file, &at.key("file"))?;
        let names = self.context.mechanism.actuator_names();
        let joints: Vec<String> = self.reader.sensed.iter().map(|joint| joint.name.clone()).collect();
        let request = TableRequest {
            actuators: &names,
            columns: drawing.columns.as_ref(),
            filter: drawing.filter.as_ref(),
            poses: match self.set.kind {
                Kind::Pose => PoseColumns::Complete,
                Kind::Position => PoseColumns::Position,
                _ => PoseColumns::Ignored,
            },
            others: self.set.kind.columns(&joints),
        };
        let shown = path.display().to_string();
        let whole = Place::file(&shown);
        let short =
            path.file_name().map_or_else(|| shown.clone(), |name| name.to_string_lossy().into_owned());
        for row in table::parse(&shown, &table::read(&path)?, &request)? {
            let line = whole.line(row.line);
            let name = format!("{}{short} line {}", self.prefix, row.line);
            let [target, point, plane, gauge] = row.names;
            let sample = SampleDrawing {
                actuators: row.readings,
                pose: row.pose,
                second: request.others.second.then_some(row.second),
                distance: row.distance,
                height: row.height,
                joints: (!joints.is_empty()).then_some(row.joints),
                target,
                point,
                plane,
                gauge,
                weight: row.weight,
                ..SampleDrawing::default()
            };
            self.add(name, sample, &line, false, None)?;
        }
        Ok(())
    }

    /// What a sample without names of its own refers to.
    fn name_things(&self, sample: &mut SampleDrawing) {
        let common = self.common;
        for (own, other) in [
            (&mut sample.target, &common.target),
            (&mut sample.point, &common.point),
            (&mut sample.plane, &common.plane),
            (&mut sample.gauge, &common.gauge),
        ] {
            if own.is_none() {
                own.clone_from(other);
            }
        }
    }

    fn add(
        &mut self,
        name: String,
        mut sample: SampleDrawing,
        at: &Place<'_>,
        keyed: bool,
        own: Option<Matrix6<f64>>,
    ) -> Result<(), FileError> {
        self.name_things(&mut sample);
        let written = Written { sample: &sample, at, keyed };
        let readings_at = written.part("actuators");
        let Context { mechanism, units, .. } = *self.context;
        let actuators = variables(mechanism, units, &sample.actuators, &readings_at)?;
        let weight = read_weight(sample.weight, &written.part("weight"))?;
        if sample.is_planned(self.set.kind) {
            let measurement = Weighted::by(self.to_be_measured(&written, own)?, weight);
            let second = sample.second.as_ref().and_then(|_| measurement.second().map(<[f64]>::to_vec));
            self.set.planned.push(PlannedPosture { name, actuators, second, measurement });
            return Ok(());
        }
        let (measurement, measured) = self.reader.measurement(&written, &self.weight, own)?;
        if weight == 0.0 {
            self.set.unused.push(Sample { name, actuators, measurement });
            return Ok(());
        }
        self.set.samples.push(Sample { name, actuators, measurement: Weighted::by(measurement, weight) });
        self.set.measured.push(measured);
        self.set.written.push(sample.pose);
        Ok(())
    }

    /// What a planned sample will measure: what it names, and in turn what it does not.
    fn to_be_measured(
        &self,
        planned: &Written<'_>,
        own: Option<Matrix6<f64>>,
    ) -> Result<Arc<dyn Measurement>, FileError> {
        let sample = planned.sample;
        let choices = self.reader.blanks(sample);
        let turn = self.set.planned.len() % choices.len().max(1);
        let blank = choices.into_iter().nth(turn).unwrap_or_default();
        let drawing = SampleDrawing {
            second: sample.second.clone().or(blank.second),
            target: sample.target.clone().or(blank.target),
            point: sample.point.clone().or(blank.point),
            plane: sample.plane.clone().or(blank.plane),
            gauge: sample.gauge.clone().or(blank.gauge),
            ..blank
        };
        let written = Written { sample: &drawing, at: planned.at, keyed: planned.keyed };
        Ok(self.reader.measurement(&written, &self.weight, own)?.0)
    }

    /// What this set could measure: planning and simulation start from it.
    pub fn add_blanks(&mut self, at: &Place<'_>) -> Result<(), FileError> {
        let mut common = SampleDrawing::default();
        self.name_things(&mut common);
        let sensed = self.reader.sensed.iter().map(|s| (s.joint.motion, s.joint.home));
        let sensed: Vec<_> = sensed.collect();
        for drawing in self.reader.blanks(&common) {
            let written = Written { sample: &drawing, at, keyed: false };
            let (measurement, _) = self.reader.measurement(&written, &self.weight, None)?;
            self.set.blanks.push(Blank { drawing, measurement, sensed: sensed.clone() });
        }
        let driven = self.reader.mechanism.limbs.iter().flat_map(|limb| &limb.joints).filter(|j| j.actuated);
        self.set.angles_only =
            driven.chain(self.reader.sensed.iter().map(|s| s.joint)).all(|j| j.motion.is_angular())
                && !self.reader.sensed.is_empty();
        self.set.sensed = self.reader.sensed.iter().map(|s| (s.at.limb, s.name.clone())).collect();
        Ok(())
    }
}
