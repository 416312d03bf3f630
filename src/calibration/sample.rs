//! Measured postures, and how the machine is brought into them.

use crate::measure::Measurement;
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
        let passive_count: usize = mechanism.limbs.iter().map(|limb| limb.passive_count()).sum();
        let home = vec![0.0; passive_count];
        if passive_count == 0 {
            posture.set_joints(mechanism, &self.actuators, &home);
            return posture.close(mechanism, geometry);
        }
        if let Some(pose) = self.measurement.pose() {
            let passive = passive_at_pose(mechanism, geometry, &self.actuators, &home, pose);
            posture.set_joints(mechanism, &self.actuators, &passive);
            let mode = posture.assembly_mode(mechanism, geometry);
            posture.close(mechanism, geometry)?;
            return if posture.mode == mode { Ok(()) } else { Err(NotClosed::OtherMode) };
        }
        posture.set_joints(mechanism, &vec![0.0; self.actuators.len()], &home);
        posture.close(mechanism, geometry)?;
        close_from_home(mechanism, geometry, posture, &self.actuators)
    }
}
