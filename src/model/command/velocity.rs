//! How actuators move the tool (12.1), and the passive joints with it (12.2).

use crate::model::mechanism::Mechanism;
use crate::model::posture::{Posture, scaled};
use nalgebra::{DMatrix, DVector, Vector6};

/// Twists of the tool by the actuators of a closed posture, lengths in machine sizes.
pub(super) struct Velocity {
    /// Twist of the platform per unit of each actuator, 6 x actuators.
    by_actuators: DMatrix<f64>,
    /// Twist of each actuator's own limb, the other joints of the limb at rest.
    own: Vec<[f64; 6]>,
}

impl Velocity {
    pub(super) fn of(mechanism: &Mechanism, posture: &Posture) -> Self {
        let open = mechanism.is_open_chain();
        let count = mechanism.actuator_count();
        let mut by_actuators = DMatrix::zeros(6, count);
        let mut own = Vec::with_capacity(count);
        let (mut frame, mut wrench) = (0, 0);
        for (limb, split) in mechanism.limbs.iter().zip(&posture.splits) {
            let tool = posture.frames[frame + limb.joints.len()].p();
            let driven = limb.joints.iter().zip(&posture.frames[frame..]).filter(|(joint, _)| joint.actuated);
            for (joint, g) in driven {
                let twist = scaled(joint.motion.tool_twist(g, &tool), posture.length());
                let mut column = Vector6::from(twist);
                if !open {
                    column = Vector6::zeros();
                    for (k, w) in split.wrenches().iter().enumerate() {
                        let power: f64 = w.iter().zip(&twist).map(|(w, t)| w * t).sum();
                        column += posture.wrench_inverse.column(wrench + k) * power;
                    }
                }
                by_actuators.set_column(own.len(), &column);
                own.push(twist);
            }
            frame += limb.joints.len() + 1;
            wrench += split.wrenches().len();
        }
        Self { by_actuators, own }
    }

    /// Its rows of the components `followed`.
    pub(super) fn followed(&self, followed: [bool; 6]) -> DMatrix<f64> {
        let rows: Vec<usize> = (0..6).filter(|&i| followed[i]).collect();
        self.by_actuators.select_rows(&rows)
    }

    /// Motions of all joints, in machine order, that go with `motion` of the actuators; `None` where they are not finite.
    pub(super) fn of_joints(
        &self,
        mechanism: &Mechanism,
        posture: &Posture,
        motion: &DVector<f64>,
    ) -> Option<Vec<f64>> {
        let platform = &self.by_actuators * motion;
        let mut step = Vec::with_capacity(posture.q.len());
        let mut actuator = 0;
        for (limb, split) in mechanism.limbs.iter().zip(&posture.splits) {
            let mut rest: [f64; 6] = std::array::from_fn(|i| platform[i]);
            let first = actuator;
            for _ in 0..limb.joints.len() - limb.passive_count() {
                for (rest, t) in rest.iter_mut().zip(&self.own[actuator]) {
                    *rest -= t * motion[actuator];
                }
                actuator += 1;
            }
            let passive = split.motions(&rest);
            let (mut a, mut p) = (motion.iter().skip(first), passive.iter());
            for joint in &limb.joints {
                let next = if joint.actuated { a.next() } else { p.next() };
                step.push(next.copied().unwrap_or(0.0));
            }
        }
        step.iter().all(|s| s.is_finite()).then_some(step)
    }
}
