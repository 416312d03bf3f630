//! A limb brought to measured poses, four postures side by side.

use super::limbwise::LimbStart;
use crate::model::mechanism::pose_difference;
use crate::model::passive::PassiveSplit;
use crate::model::{Geometry, Mechanism, Posture};
use crate::wide::{Four, wide};

/// Postures that are brought to their poses together.
pub(super) const ABREAST: usize = 4;
/// Passive joint step (rad, machine sizes) below which the limb is at the pose: the residual depends on it by
/// second order only, 1e-12.
const AT_POSE: f64 = 1e-6;
const MAX_ITERATIONS: usize = 30;

/// Up to four postures of one limb.
pub(super) struct Approach<'a> {
    /// A machine of that limb alone.
    mechanism: &'a Mechanism,
    geometry: &'a Geometry,
    /// As placed last.
    pub postures: [Posture; ABREAST],
    /// Way of each tool from its measured pose, `[w; dp]` in rad and m.
    pub errors: [[f64; 6]; ABREAST],
    split: PassiveSplit<Four>,
    columns: Vec<[Four; 6]>,
}

impl<'a> Approach<'a> {
    pub fn new(mechanism: &'a Mechanism, geometry: &'a Geometry, home: &Posture) -> Self {
        Self {
            mechanism,
            geometry,
            postures: std::array::from_fn(|_| home.clone()),
            errors: [[0.0; 6]; ABREAST],
            split: PassiveSplit::rigid(),
            columns: vec![[Four::default(); 6]; mechanism.limbs[0].passive_count()],
        }
    }

    /// Moves the passive joints to where each tool comes closest to its measured pose, from the joint variables as set.
    /// Lanes without a posture of their own go with the last; the error is the first posture that does not arrive.
    pub fn close(&mut self, starts: &[LimbStart<'_>]) -> Result<(), usize> {
        let of_lane = |lane: usize| lane.min(starts.len() - 1);
        for lane in starts.len()..ABREAST {
            self.postures[lane] = self.postures[of_lane(lane)].clone();
        }
        let mut arrived = [false; ABREAST];
        for _ in 0..MAX_ITERATIONS {
            let mut gaps = [Four::default(); 6];
            for (lane, posture) in self.postures.iter_mut().enumerate() {
                let twists = posture.place_alone(self.mechanism, self.geometry);
                for (column, twist) in self.columns.iter_mut().zip(twists) {
                    column.iter_mut().zip(twist).for_each(|(entry, v)| entry.0[lane] = *v);
                }
                let (w, v) = pose_difference(&starts[of_lane(lane)].pose.measured, &posture.tool());
                self.errors[lane] = [-w.x, -w.y, -w.z, -v.x, -v.y, -v.z];
                let length = posture.length();
                let gap = [w.x, w.y, w.z, v.x / length, v.y / length, v.z / length];
                gaps.iter_mut().zip(gap).for_each(|(entry, v)| entry.0[lane] = v);
            }
            let (split, columns) = (&mut self.split, &self.columns);
            let steps = wide(
                #[inline(always)]
                || {
                    split.factor(columns);
                    split.motions(&gaps)
                },
            );
            let joints = &self.mechanism.limbs[0].joints;
            for (lane, posture) in self.postures.iter_mut().enumerate() {
                let length = posture.length();
                let passive = joints.iter().zip(&mut posture.q).filter(|(joint, _)| !joint.actuated);
                arrived[lane] = true;
                for ((joint, q), step) in passive.zip(&steps) {
                    *q += step.0[lane];
                    // Not for NaN either.
                    arrived[lane] &= joint.motion.size_of(step.0[lane], length) <= AT_POSE;
                }
            }
            if arrived.iter().all(|arrived| *arrived) {
                return Ok(());
            }
        }
        Err(arrived.iter().position(|arrived| !arrived).map_or(0, of_lane))
    }

    /// Reciprocal wrenches of one posture, lengths in machine sizes.
    pub fn wrenches(&self, lane: usize) -> impl Iterator<Item = [f64; 6]> + '_ {
        self.split.wrenches().iter().map(move |wrench| wrench.map(|entry| entry.0[lane]))
    }
}
