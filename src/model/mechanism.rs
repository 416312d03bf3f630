//! A mechanism: limbs that join base and platform, with the same code for one limb and many.

use super::instrument::Constant;
use super::limb::{Limb, Tolerance};
use crate::lie::se3::{self, Twist};
use crate::lie::{Se3, so3};
use nalgebra::Vector3;

/// Limbs between base and platform at nominal. One limb without passive joints is a serial robot.
#[derive(Clone, Debug)]
pub struct Mechanism {
    /// The limbs.
    pub limbs: Vec<Limb>,
    /// Unknown constants of the set-up that measures it.
    pub instrument: Vec<Constant>,
    /// What is known of motions that all limbs share.
    pub ends: Ends,
}

/// What is known of where the whole machine stands and of how its tool is mounted, beside the tolerances of its links.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ends {
    /// Of one rigid motion in front of every first link; `None` where there is none.
    pub placement: Option<Tolerance>,
    /// Of one rigid motion behind every last link; `None` where there is none.
    pub tool_mounting: Option<Tolerance>,
}

/// The links of a machine as they are believed to be: per limb `g_0..g_f`.
#[derive(Clone, Debug)]
pub struct Geometry {
    /// Links of each limb.
    pub limbs: Vec<Vec<Se3>>,
    /// Values of the instrument's constants, rad, m or 1.
    pub instrument: Vec<f64>,
}

impl Mechanism {
    /// The machine as drawn.
    pub fn nominal(&self) -> Geometry {
        let limbs = self.limbs.iter().map(|limb| limb.links.iter().map(|l| l.nominal).collect());
        Geometry { limbs: limbs.collect(), instrument: self.instrument.iter().map(|c| c.nominal).collect() }
    }

    /// The machine with deviations `d` (rad, m): six per link, limb by limb, `g_j = nominal exp(d_j)`, then one per
    /// constant of the instrument.
    pub fn deviated(&self, deviations: &[f64]) -> Geometry {
        let mut at = deviations.chunks_exact(6).map(Twist::from_column_slice);
        let limbs = self.limbs.iter().map(|limb| {
            let links = limb.links.iter().map(|link| match at.next() {
                Some(d) if d != Twist::zeros() => link.nominal * se3::exp(&d),
                _ => link.nominal,
            });
            links.collect()
        });
        let limbs = limbs.collect();
        let rest = deviations.get(self.link_component_count()..).unwrap_or_default();
        let by = |k: usize| rest.get(k).copied().unwrap_or(0.0);
        let instrument = self.instrument.iter().enumerate().map(|(k, c)| c.nominal + by(k)).collect();
        Geometry { limbs, instrument }
    }

    /// Number of deviation components: six per link, one per constant of the instrument.
    pub fn component_count(&self) -> usize {
        self.link_component_count() + self.instrument.len()
    }

    /// Number of deviation components of links, six each.
    pub fn link_component_count(&self) -> usize {
        self.limbs.iter().map(|limb| 6 * limb.links.len()).sum()
    }

    /// Whether it is one limb without passive joints: there is nothing to close.
    pub fn is_open_chain(&self) -> bool {
        self.limbs.len() == 1 && self.limbs[0].joints.iter().all(|joint| joint.actuated)
    }

    /// Number of actuators.
    pub fn actuator_count(&self) -> usize {
        self.limbs.iter().flat_map(|limb| &limb.joints).filter(|joint| joint.actuated).count()
    }

    /// Names `limb.joint` of the actuators in order.
    pub fn actuator_names(&self) -> Vec<String> {
        let mut names = Vec::new();
        for limb in &self.limbs {
            for joint in limb.joints.iter().filter(|joint| joint.actuated) {
                names.push(format!("{}.{}", limb.name, joint.name));
            }
        }
        names
    }

    /// Numbers of equivalent angular (r) and prismatic (p) joints.
    pub fn joint_counts(&self) -> (usize, usize) {
        let joints = self.limbs.iter().flat_map(|limb| &limb.joints);
        let all = joints.clone().count();
        let angular = joints.filter(|joint| joint.motion.is_angular()).count();
        (angular, all - angular)
    }

    /// Size of the machine: root mean square distance of its joints from the tool at home, m.
    ///
    /// It makes rotations and translations comparable; frames and units do not change it.
    pub fn characteristic_length(&self) -> f64 {
        let mut sum = 0.0;
        let mut count = 0;
        for limb in &self.limbs {
            let tool = limb.links.iter().zip(&limb.joints).fold(Se3::identity(), |g, (l, _)| g * l.nominal);
            let tool = limb.links.last().map_or(tool, |l| tool * l.nominal);
            for joint in &limb.joints {
                sum += (joint.frame.p - tool.p).norm_squared();
                count += 1;
            }
        }
        let length = (sum / f64::from(count.max(1))).sqrt();
        if length > 0.0 { length } else { 1.0 }
    }

    /// Moves base (left) and tool (right): every `g_i0` becomes `base g_i0`, every `g_if` becomes `g_if tool`.
    pub fn relocated(&self, base: &Se3, tool: &Se3) -> Mechanism {
        let mut moved = self.clone();
        for limb in &mut moved.limbs {
            for joint in &mut limb.joints {
                joint.frame = *base * joint.frame;
            }
            if let Some(first) = limb.links.first_mut() {
                first.nominal = *base * first.nominal;
            }
            if let Some(last) = limb.links.last_mut() {
                last.nominal = last.nominal * *tool;
            }
        }
        moved
    }
}

impl Geometry {
    /// Frames at home of limb `i`: one for each joint, then the tool's.
    pub fn home_frames(&self, i: usize) -> Vec<Se3> {
        let mut at = Se3::identity();
        self.limbs[i]
            .iter()
            .map(|link| {
                at = at * *link;
                at
            })
            .collect()
    }

    /// Deviation `d` with `self = nominal exp(d)`, six per link, then `d = self - nominal` of the instrument.
    pub fn deviations_from(&self, nominal: &Geometry) -> Vec<f64> {
        let mut out = Vec::new();
        for (links, drawn) in self.limbs.iter().zip(&nominal.limbs) {
            for (link, nominal) in links.iter().zip(drawn) {
                out.extend_from_slice(se3::log(&(nominal.inverse() * *link)).as_slice());
            }
        }
        out.extend(self.instrument.iter().zip(&nominal.instrument).map(|(value, nominal)| value - nominal));
        out
    }
}

/// Twist `[w; dp]` that takes pose `from` to pose `to`: rotation vector of `to.r from.r'` in {S}, and the
/// displacement of the tool point.
pub fn pose_difference(to: &Se3, from: &Se3) -> (Vector3<f64>, Vector3<f64>) {
    (so3::log(&(to.r * from.r.transpose())), to.p - from.p)
}
