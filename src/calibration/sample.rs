//! Measured postures, and how the machine is brought into them.

use crate::lie::Se3;
use crate::measure::{Measurement, View};
use crate::model::inverse::{close_from_home, passive_at_pose};
use crate::model::{Geometry, Mechanism, NotClosed, Posture};
use std::sync::Arc;

/// One measured posture.
#[derive(Clone, Debug)]
pub struct Sample {
    /// Where it stands in its source, for messages: `sample 12`, `data.csv line 14`.
    pub name: String,
    /// Actuator variables (reading - home) in actuator order, rad or m.
    pub actuators: Vec<f64>,
    /// What was measured.
    pub measurement: Arc<dyn Measurement>,
}

/// A sample that takes no part, because its loops do not close on the branch that was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct SetAside {
    /// Index of the sample.
    pub sample: usize,
    /// Its name.
    pub name: String,
    /// Why.
    pub reason: NotClosed,
}

/// The posture of a sample and, where it compares two, the other one; reused from one sample to the next.
#[derive(Clone, Debug)]
pub struct Postures {
    /// The sample's own.
    pub first: Posture,
    /// The one that it is compared with.
    pub second: Posture,
}

impl Postures {
    /// Home postures, not closed.
    pub fn new(mechanism: &Mechanism) -> Self {
        let home = Posture::new(mechanism);
        Self { first: home.clone(), second: home }
    }

    /// What the instrument of a closed sample sees.
    pub fn view<'a>(&'a self, sample: &Sample, geometry: &'a Geometry) -> View<'a> {
        let tool = self.first.tool();
        let second = if sample.measurement.second().is_some() { self.second.tool() } else { tool };
        View { tool, posture: Some(&self.first), second, instrument: &geometry.instrument }
    }
}

impl Sample {
    /// Closes the posture with the given links and leaves it in `posture`.
    ///
    /// From the measured pose where there is one, so that the assembly mode is the measured one; else along the
    /// actuators' path from home.
    pub fn close(
        &self,
        mechanism: &Mechanism,
        geometry: &Geometry,
        posture: &mut Posture,
    ) -> Result<(), NotClosed> {
        close_at(mechanism, geometry, &self.actuators, self.measurement.pose(), posture)
    }

    /// Closes the posture, and the second one where two are compared.
    pub fn close_all(
        &self,
        mechanism: &Mechanism,
        geometry: &Geometry,
        postures: &mut Postures,
    ) -> Result<(), NotClosed> {
        self.close(mechanism, geometry, &mut postures.first)?;
        match self.measurement.second() {
            Some(actuators) => close_at(mechanism, geometry, actuators, None, &mut postures.second),
            None => Ok(()),
        }
    }
}

/// Closes the posture at these actuator variables (rad, m): from `pose` where it was measured, else along the path from
/// home.
pub fn close_at(
    mechanism: &Mechanism,
    geometry: &Geometry,
    actuators: &[f64],
    pose: Option<&Se3>,
    posture: &mut Posture,
) -> Result<(), NotClosed> {
    let passive_count: usize = mechanism.limbs.iter().map(|limb| limb.passive_count()).sum();
    let home = vec![0.0; passive_count];
    if passive_count == 0 {
        posture.set_joints(mechanism, actuators, &home);
        return posture.close(mechanism, geometry);
    }
    if let Some(pose) = pose {
        let passive = passive_at_pose(mechanism, geometry, actuators, &home, pose);
        posture.set_joints(mechanism, actuators, &passive);
        let mode = posture.assembly_mode(mechanism, geometry);
        posture.close(mechanism, geometry)?;
        return if posture.mode == mode { Ok(()) } else { Err(NotClosed::OtherMode) };
    }
    posture.set_joints(mechanism, &vec![0.0; actuators.len()], &home);
    posture.close(mechanism, geometry)?;
    close_from_home(mechanism, geometry, posture, actuators)
}
