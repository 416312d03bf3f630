//! What each kind of measurement needs of a file, how it is read, and how it is written.

use super::data::SampleDrawing;
use super::dataset::{Blank, Kind, MeasuredPose};
use super::error::{FileError, quoted};
use super::fault::Fault;
use super::instrument::{Instrument, named};
use super::noise::NoiseNeeds;
use super::place::Place;
use super::pose::{Components, PoseDrawing};
use super::readings::{readings, variables};
use super::table::OtherColumns;
use super::units::Units;
use crate::lie::{Se3, so3};
use crate::measure::{
    Distance, Gauge, Measurement, PassiveJoints, Point, Position, SensedJoint, Separation, Touch,
};
use crate::model::{Joint, Mechanism, Motion, Prior};
use nalgebra::{Matrix6, Vector3};
use std::sync::Arc;

/// Standard deviations by which a distance may be read below zero.
const SPREADS: f64 = 10.0;

/// A sensed joint: where it stands in the machine, its name in files, and the joint.
#[derive(Clone, Debug)]
pub(super) struct Sensed<'a> {
    pub at: SensedJoint,
    pub name: String,
    pub joint: &'a Joint,
}

/// The passive joints of these names, all of them where none are given.
pub(super) fn sensed<'a>(
    mechanism: &'a Mechanism,
    names: Option<&Vec<String>>,
    at: &Place<'_>,
) -> Result<Vec<Sensed<'a>>, FileError> {
    let mut all = Vec::new();
    let mut index = 0;
    for (limb, drawn) in mechanism.limbs.iter().enumerate() {
        let mut passive = 0;
        for joint in &drawn.joints {
            if !joint.actuated {
                let angular = joint.motion.is_angular();
                let name = format!("{}.{}", drawn.name, joint.name);
                all.push(Sensed { at: SensedJoint { limb, passive, joint: index, angular }, name, joint });
                passive += 1;
            }
            index += 1;
        }
    }
    if all.is_empty() {
        return Err(at.error(Fault::NoPassiveJoint));
    }
    let Some(names) = names else { return Ok(all) };
    let find = |(i, name): (usize, &String)| match all.iter().find(|joint| joint.name == *name) {
        Some(found) if names[..i].contains(name) => {
            Err(at.index(i).error(Fault::DuplicateName(quoted(&found.name))))
        }
        Some(found) => Ok(found.clone()),
        None => {
            let known = all.iter().map(|joint| joint.name.as_str()).collect::<Vec<_>>().join(", ");
            Err(at.index(i).error(Fault::UnknownJoint { found: quoted(name), known }))
        }
    };
    names.iter().enumerate().map(find).collect()
}

impl Kind {
    /// What must be stated of its noise.
    pub(super) fn needs(self, sensed: &[Sensed<'_>]) -> NoiseNeeds {
        let angular = sensed.iter().any(|joint| joint.at.angular);
        let linear = sensed.iter().any(|joint| !joint.at.angular);
        let (angle, length) = match self {
            Kind::Pose => (true, true),
            Kind::Position | Kind::Distance | Kind::Separation | Kind::Plane => (false, true),
            Kind::PassiveJoint => (angular, linear),
        };
        let number = !matches!(self, Kind::Pose | Kind::Position);
        NoiseNeeds { kind: self.name(), angle, length, number }
    }

    /// Which columns it reads besides actuators and parts of poses.
    pub(super) fn columns(self, sensed: &[String]) -> OtherColumns<'_> {
        OtherColumns {
            second: self == Kind::Separation,
            distance: matches!(self, Kind::Distance | Kind::Separation),
            height: self == Kind::Plane,
            joints: if self == Kind::PassiveJoint { sensed } else { &[] },
            names: !matches!(self, Kind::Pose | Kind::PassiveJoint),
        }
    }
}

/// A sample as written, where it stands, and whether its parts stand under keys of their own.
pub(super) struct Written<'a> {
    pub sample: &'a SampleDrawing,
    pub at: &'a Place<'a>,
    pub keyed: bool,
}

impl<'a> Written<'a> {
    /// Where a part of it stands.
    pub fn part(&self, key: &'a str) -> Place<'a> {
        if self.keyed { self.at.key(key) } else { *self.at }
    }
}

/// What turns samples of one kind into measurements.
pub(super) struct Reader<'a> {
    pub kind: Kind,
    pub mechanism: &'a Mechanism,
    pub units: Units,
    pub instrument: &'a Instrument,
    pub sensed: Vec<Sensed<'a>>,
}

impl Reader<'_> {
    /// The measurement, weighted by `own` covariance or else by `weight` (rotation first, rad and m), and what was
    /// measured of a pose.
    pub fn measurement(
        &self,
        of: &Written<'_>,
        weight: &Matrix6<f64>,
        own: Option<Matrix6<f64>>,
    ) -> Result<(Arc<dyn Measurement>, MeasuredPose), FileError> {
        let units = self.units;
        let covariance = own.as_ref().unwrap_or(weight);
        let (angle, length) = (covariance[(0, 0)].sqrt(), covariance[(3, 3)].sqrt());
        let pose_at = of.part("pose");
        let nothing = MeasuredPose::new(
            Components { pose: Se3::identity(), rotation: false, position: [false; 3] },
            own,
        );
        match self.kind {
            Kind::Pose | Kind::Position => {
                let seen = match self.kind {
                    Kind::Pose => of.sample.pose.components(units, &pose_at)?,
                    _ => of.sample.pose.position_only(units, &pose_at)?,
                };
                if !seen.rotation && seen.position == [false; 3] {
                    return Err(pose_at.error(Fault::NothingMeasured));
                }
                let positive = |_| pose_at.error(Fault::NotPositive);
                let target = match self.kind {
                    Kind::Position => self.target(of)?,
                    _ => Point::default(),
                };
                if target == Point::default() {
                    let measured = MeasuredPose::new(seen, own);
                    return Ok((measured.measurement(weight).map_err(positive)?, measured));
                }
                let position = Position::new(seen.pose.p, seen.position, target, covariance);
                Ok((Arc::new(position.map_err(positive)?), nothing))
            }
            Kind::Distance => {
                let gauge = self.gauge(of)?;
                let reading = self.distance(of, &gauge, length)?;
                let point = named(&self.instrument.points, of.sample.point.as_deref(), "point", None, of.at)?;
                let measurement = Distance::new(reading, self.target(of)?, point, gauge, length);
                Ok((Arc::new(measurement), nothing))
            }
            Kind::Separation => {
                let gauge = self.gauge(of)?;
                let reading = self.distance(of, &gauge, length)?;
                let at = of.part("second");
                let Some(second) = &of.sample.second else {
                    return Err(of.at.error(Fault::NoNumber("second", self.kind.name())));
                };
                let second = variables(self.mechanism, units, second, &at)?;
                let measurement = Separation::new(reading, second, self.target(of)?, gauge, length);
                Ok((Arc::new(measurement), nothing))
            }
            Kind::Plane => {
                let at = of.part("height");
                let height = of.sample.height.map(|height| units.length(height, &at)).transpose()?;
                let plane = named(&self.instrument.planes, of.sample.plane.as_deref(), "plane", None, of.at)?;
                Ok((Arc::new(Touch::new(height, self.target(of)?, plane, length)), nothing))
            }
            Kind::PassiveJoint => {
                let at = of.part("joints");
                let stated = of.sample.joints.as_deref().unwrap_or_default();
                if stated.len() != self.sensed.len() {
                    let names: Vec<&str> = self.sensed.iter().map(|joint| joint.name.as_str()).collect();
                    let (found, wanted) = (stated.len(), names.len());
                    return Err(at.error(Fault::JointCount { found, wanted, names: names.join(", ") }));
                }
                let mut read = Vec::with_capacity(stated.len());
                for (i, (joint, value)) in self.sensed.iter().zip(stated).enumerate() {
                    if let Some(value) = value {
                        let value = units.joint(joint.joint.motion, *value, &at.index(i))?;
                        read.push((joint.at, value - joint.joint.home));
                    }
                }
                if read.is_empty() {
                    return Err(at.error(Fault::NothingMeasured));
                }
                Ok((Arc::new(PassiveJoints::new(&read, angle, length)), nothing))
            }
        }
    }

    /// The distance read, m; below zero only as far as the gauge's zero and noise of `sigma` (m) may take it.
    fn distance(&self, of: &Written<'_>, gauge: &Gauge, sigma: f64) -> Result<f64, FileError> {
        let at = of.part("distance");
        let Some(stated) = of.sample.distance else {
            return Err(of.at.error(Fault::NoNumber("distance", self.kind.name())));
        };
        let distance = self.units.length(stated, &at)?;
        let of_zero = gauge.zero_constant.and_then(|k| self.instrument.constants.get(k)).map(|c| c.prior);
        let spread = match of_zero {
            None | Some(Prior::Held) => sigma,
            Some(Prior::Sigma(zero)) => sigma.hypot(zero),
            Some(Prior::Free) => f64::INFINITY,
        };
        if gauge.scale > 0.0 && distance < gauge.zero.min(0.0) - SPREADS * spread {
            return Err(at.error(Fault::NegativeDistance(stated, self.units.from_metres(gauge.zero))));
        }
        Ok(distance)
    }

    fn target(&self, of: &Written<'_>) -> Result<Point, FileError> {
        let name = of.sample.target.as_deref();
        named(&self.instrument.targets, name, "target", Some(Point::default()), of.at)
    }

    fn gauge(&self, of: &Written<'_>) -> Result<Gauge, FileError> {
        let name = of.sample.gauge.as_deref();
        named(&self.instrument.gauges, name, "gauge", Some(Gauge::default()), of.at)
    }

    /// A sample without readings for every combination of what this kind may refer to.
    pub fn blanks(&self, set: &SampleDrawing) -> Vec<SampleDrawing> {
        fn choices<T>(stated: Option<&String>, list: &[(String, T)], used: bool) -> Vec<Option<String>> {
            match (stated, used && !list.is_empty()) {
                (Some(name), true) => vec![Some(name.clone())],
                (None, true) => list.iter().map(|(name, _)| Some(name.clone())).collect(),
                (_, false) => vec![None],
            }
        }
        let (kind, instrument) = (self.kind, self.instrument);
        let plain = matches!(kind, Kind::Pose | Kind::PassiveJoint);
        let gauged = matches!(kind, Kind::Distance | Kind::Separation);
        let mut blanks = Vec::new();
        for gauge in choices(set.gauge.as_ref(), &instrument.gauges, gauged) {
            for plane in choices(set.plane.as_ref(), &instrument.planes, kind == Kind::Plane) {
                for point in choices(set.point.as_ref(), &instrument.points, kind == Kind::Distance) {
                    for target in choices(set.target.as_ref(), &instrument.targets, !plain) {
                        let (gauge, plane, point) = (gauge.clone(), plane.clone(), point.clone());
                        blanks.push(SampleDrawing {
                            target,
                            point,
                            plane,
                            gauge,
                            ..SampleDrawing::default()
                        });
                    }
                }
            }
        }
        let home = vec![0.0; self.mechanism.actuator_count()];
        let zero = Se3::identity();
        for blank in &mut blanks {
            blank.actuators = readings(self.mechanism, self.units, &home);
            match kind {
                Kind::Pose | Kind::Position => blank.pose = PoseDrawing::of(&zero, self.units),
                Kind::Distance => blank.distance = Some(0.0),
                Kind::Separation => {
                    blank.distance = Some(0.0);
                    blank.second = Some(blank.actuators.clone());
                }
                Kind::Plane => {}
                Kind::PassiveJoint => blank.joints = Some(vec![Some(0.0); self.sensed.len()]),
            }
        }
        blanks
    }
}

/// A sample as a file writes it: what `blank` refers to, at these actuator variables, with the readings of
/// `measurement` (rad, m).
pub fn drawn(
    mechanism: &Mechanism,
    units: Units,
    kind: Kind,
    blank: &Blank,
    actuators: &[f64],
    measurement: &dyn Measurement,
) -> SampleDrawing {
    let values = measurement.readings();
    let mut sample = SampleDrawing {
        actuators: readings(mechanism, units, actuators),
        pose: PoseDrawing::default(),
        noise: None,
        covariance: None,
        ..blank.drawing.clone()
    };
    let first = values.first().copied();
    match (kind, values.as_slice()) {
        (Kind::Pose | Kind::Position, [a, b, c, x, y, z]) => {
            let pose = Se3 { r: so3::exp(&Vector3::new(*a, *b, *c)), p: Vector3::new(*x, *y, *z) };
            sample.pose = PoseDrawing::of(&pose, units);
            if kind == Kind::Position {
                sample.pose.rotation = None;
            }
        }
        (Kind::Position, [x, y, z]) => {
            let position = [*x, *y, *z].map(|v| Some(units.from_metres(v)));
            sample.pose = PoseDrawing { position: Some(position), ..PoseDrawing::default() };
        }
        (Kind::Distance | Kind::Separation, _) => {
            sample.distance = first.map(|v| units.from_metres(v));
            sample.second = measurement.second().map(|second| readings(mechanism, units, second));
        }
        (Kind::Plane, _) => sample.height = first.map(|v| units.from_metres(v)),
        (Kind::PassiveJoint, values) => {
            let shown = |((motion, home), v): (&(Motion, f64), &f64)| units.from_joint(*motion, v + home);
            sample.joints = Some(blank.sensed.iter().zip(values).map(|pair| Some(shown(pair))).collect());
        }
        _ => {}
    }
    sample
}
