//! Measured postures, read.

use super::data::SampleDrawing;
use super::error::{FileError, quoted};
use super::fault::Fault;
use super::place::Place;
use super::pose::{Components, PoseDrawing};
use crate::calibration::Sample;
use crate::lie::Se3;
use crate::measure::pose::NotPositive;
use crate::measure::{Measurement, OfPosture, Pose, PostureNoise, Weighted, Weights};
use crate::model::Motion;
use nalgebra::Matrix6;
use std::sync::Arc;

/// What the instrument measures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    /// Position and rotation of the tool.
    #[default]
    Pose,
    /// Position of the tool point, or of a target on the tool.
    Position,
    /// Distance of the tool point or a target from a fixed point.
    Distance,
    /// Distance between the places of the tool point or a target in two postures.
    Separation,
    /// Touch of a plane, or height above it.
    Plane,
    /// Readings of sensors on passive joints.
    PassiveJoint,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Kind; 6] =
        [Kind::Pose, Kind::Position, Kind::Distance, Kind::Separation, Kind::Plane, Kind::PassiveJoint];

    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Pose => "pose",
            Kind::Position => "position",
            Kind::Distance => "distance",
            Kind::Separation => "separation",
            Kind::Plane => "plane",
            Kind::PassiveJoint => "passive-joint",
        }
    }

    /// The kind of this name; `pose` where there is none.
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

/// A measurement without readings, with what it refers to.
#[derive(Clone, Debug)]
pub struct Blank {
    /// As a file writes it.
    pub drawing: SampleDrawing,
    /// Weighted by the stated noise.
    pub measurement: Arc<dyn Measurement>,
    /// How each sensed joint moves, and its reading at home (rad, m).
    pub sensed: Vec<(Motion, f64)>,
}

/// A posture of which nothing was measured yet.
#[derive(Clone, Debug)]
pub struct PlannedPosture {
    /// Where it stands in its source.
    pub name: String,
    /// Actuator variables (reading - home) in actuator order, rad or m.
    pub actuators: Vec<f64>,
    /// Those of the posture that it is compared with, where the file states them.
    pub second: Option<Vec<f64>>,
    /// What is to be measured there, without readings, weighted by noise and weight. What the file does not name is taken
    /// in turn from what there is.
    pub measurement: Arc<dyn Measurement>,
}

/// The postures that a problem's `data` or `holdout` holds; none where only noise is stated.
#[derive(Clone, Debug, Default)]
pub struct DataSet {
    /// What was measured.
    pub kind: Kind,
    /// The samples, weighted by the stated noise, or else by [`super::noise::assumed_noise`].
    pub samples: Vec<Sample>,
    /// Samples of weight 0: they are predicted, never used.
    pub unused: Vec<Sample>,
    /// What was measured in each of the samples.
    pub measured: Vec<MeasuredPose>,
    /// The same as the file writes it, in its units.
    pub written: Vec<PoseDrawing>,
    /// Postures that are planned: readings without a pose.
    pub planned: Vec<PlannedPosture>,
    /// Covariance of a measured pose (rotation first, rad and m), where it is stated for all samples.
    pub noise: Option<Matrix6<f64>>,
    /// What all samples of one posture have in common, where it is stated.
    pub posture_noise: Option<PostureNoise>,
    /// Where the data come from, in words.
    pub origin: Option<String>,
    /// One for each combination of what the measurements of this kind refer to; empty where there are several sets.
    pub blanks: Vec<Blank>,
    /// The sensed joints: index of the limb, and name `limb.joint`.
    pub sensed: Vec<(usize, String)>,
    /// Whether every reading, those of the actuators included, is an angle.
    pub angles_only: bool,
    /// The sets that these data consist of, where there are several.
    pub sets: Vec<DataSet>,
}

impl DataSet {
    /// Whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// Whether the noise of every sample is stated.
    pub fn has_noise(&self) -> bool {
        if !self.sets.is_empty() {
            return self.sets.iter().all(DataSet::has_noise);
        }
        self.noise.is_some() || (!self.is_empty() && self.measured.iter().all(|m| m.noise.is_some()))
    }

    /// The sets, one where there are no several.
    pub fn parts(&self) -> &[DataSet] {
        if self.sets.is_empty() { std::slice::from_ref(self) } else { &self.sets }
    }

    /// Several sets as one: samples in their order, kind and noise of the first.
    pub(super) fn of_sets(sets: Vec<DataSet>, origin: Option<String>) -> Self {
        let first = sets.first();
        Self {
            kind: first.map_or(Kind::default(), |set| set.kind),
            samples: sets.iter().flat_map(|set| set.samples.iter().cloned()).collect(),
            unused: sets.iter().flat_map(|set| set.unused.iter().cloned()).collect(),
            measured: sets.iter().flat_map(|set| set.measured.iter().cloned()).collect(),
            planned: sets.iter().flat_map(|set| set.planned.iter().cloned()).collect(),
            written: sets.iter().flat_map(|set| set.written.iter().cloned()).collect(),
            noise: first.and_then(|set| set.noise),
            posture_noise: None,
            origin,
            blanks: Vec::new(),
            angles_only: false,
            sensed: sets.iter().flat_map(|set| set.sensed.iter().cloned()).collect(),
            sets,
        }
    }

    /// The same, whose samples have this in common with the others of their posture.
    pub(super) fn with_posture_noise(mut self, noise: PostureNoise) -> Self {
        let of = |measurement: &mut Arc<dyn Measurement>| {
            *measurement = OfPosture::by(measurement.clone(), noise);
        };
        self.samples.iter_mut().chain(&mut self.unused).for_each(|sample| of(&mut sample.measurement));
        self.planned.iter_mut().for_each(|planned| of(&mut planned.measurement));
        self.blanks.iter_mut().for_each(|blank| of(&mut blank.measurement));
        self.sets = self.sets.into_iter().map(|set| set.with_posture_noise(noise)).collect();
        self.posture_noise = Some(noise);
        self
    }

    /// What these kinds of measurement cannot see however many there are, in words.
    pub fn kind_notes(&self) -> Vec<&'static str> {
        let kinds: Vec<Kind> = self.parts().iter().map(|set| set.kind).collect();
        let only = |of: &[Kind]| !kinds.is_empty() && kinds.iter().all(|kind| of.contains(kind));
        let mut notes = Vec::new();
        if only(&[Kind::Separation, Kind::PassiveJoint]) {
            notes.push(
                "no reading refers to {S}: where the base stands cannot be seen and stays as drawn (6 directions)",
            );
        } else if only(&[Kind::Distance, Kind::Separation, Kind::PassiveJoint]) {
            notes.push(
                "distances see {S} only through fixed points: if these are identified, {S} stays where the drawing and \
                 the tolerances put it",
            );
        } else if only(&[Kind::Plane, Kind::Separation, Kind::PassiveJoint]) {
            notes.push(
                "a plane fixes {S} in height and two tilts: shifts along it and the turn about its normal cannot be seen",
            );
        }
        if only(&[Kind::PassiveJoint]) && self.parts().iter().all(|set| set.angles_only) {
            notes.push(
                "angles alone have no scale: the size of the machine cannot be seen and stays as drawn",
            );
        }
        notes
    }

    /// What points alone cannot see, in words; `None` where something else was measured too.
    pub fn point_note(&self) -> Option<&'static str> {
        let points = self.parts().iter().all(|set| !matches!(set.kind, Kind::Pose | Kind::PassiveJoint));
        points.then_some(
            "points alone do not see how the tool frame is turned about the point that is measured, unless several \
             targets are",
        )
    }

    /// The samples weighted anew by `covariance` (rotation first, rad and m), but for those with noise of their own.
    pub fn weighted(&self, covariance: &Matrix6<f64>) -> Result<Vec<Sample>, NotPositive> {
        let pairs = self.samples.iter().zip(&self.measured);
        pairs
            .map(|(sample, measured)| {
                let (angle, length) = (covariance[(0, 0)].sqrt(), covariance[(3, 3)].sqrt());
                let measurement =
                    match (&measured.noise, measured.rotation || measured.position.contains(&true)) {
                        (_, true) => {
                            Weighted::by(measured.measurement(covariance)?, sample.measurement.weight())
                        }
                        (Some(_), false) => sample.measurement.clone(),
                        (None, false) => sample.measurement.reweighted(Weights::Isotropic { angle, length }),
                    };
                let common = sample.measurement.posture_noise().unwrap_or_default();
                Ok(Sample { measurement: OfPosture::by(measurement, common), ..sample.clone() })
            })
            .collect()
    }
}
