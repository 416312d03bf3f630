//! Postures: the joint variables and frames of a machine whose loops are closed.
//!
//! Newton's method on the passive joints (26)-(28). Each limb's passive joints are eliminated through its
//! reciprocal wrenches, which leaves one 6 x 6 system for the platform's twist (docs/theory.md section 7).
//! Twists here are those of the tool point, `[w; dp]`, lengths divided by the machine's size.

use super::mechanism::{Geometry, Mechanism, pose_difference};
use super::passive::PassiveSplit;
use crate::lie::Se3;
use nalgebra::{Matrix6, Vector6};

/// Largest disagreement of the limbs at closure, rad and machine sizes.
const CLOSED: f64 = 1e-13;
/// Accepted where rounding allows no better.
const CLOSED_TO_ROUNDING: f64 = 1e-10;
const MAX_ITERATIONS: usize = 40;
/// Longest Newton step of one joint, rad or machine sizes.
pub(super) const LONGEST_STEP: f64 = 0.4;
/// Reciprocal condition of `Jr` below which a posture counts as singular.
const SINGULAR: f64 = 1e-9;

/// Why the loops of a posture do not close.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NotClosed {
    /// Newton's method ended with the limbs apart.
    #[error(
        "the limbs do not meet: {rotation:.3e} rad and {translation:.3e} m apart ({iterations} Newton steps)"
    )]
    Apart {
        /// Largest rotation between two limbs' tools, rad.
        rotation: f64,
        /// Largest distance between two limbs' tools, m.
        translation: f64,
        /// Newton iterations.
        iterations: usize,
    },
    /// The platform can move with all actuators held.
    #[error(
        "singular posture: smallest singular value of the wrench matrix is {smallest:.1e} of the largest"
    )]
    Singular {
        /// Ratio of the extreme singular values of `Jr`.
        smallest: f64,
    },
    /// The passive joints of a limb depend on each other here.
    #[error("the passive joints of {limb} depend on each other in this posture")]
    LimbSingular {
        /// The limb.
        limb: String,
    },
    /// The limbs meet, but beyond a singularity.
    #[error("the posture closes only in another assembly mode")]
    OtherMode,
    /// A number overflowed.
    #[error("the posture is not finite")]
    NotFinite,
}

/// Working state and result of closing one posture; reused from one to the next.
#[derive(Clone, Debug)]
pub struct Posture {
    /// Joint variables, limb by limb, rad or m.
    pub q: Vec<f64>,
    /// Frames in {S} behind each link, limb by limb: f_i + 1 each, the last one that limb's tool.
    pub frames: Vec<Se3>,
    /// Per limb, passive twists and wrenches.
    pub splits: Vec<PassiveSplit>,
    /// Inverse of the stacked wrenches `Jr`.
    pub wrench_inverse: Matrix6<f64>,
    /// Newton iterations of the last closure.
    pub iterations: usize,
    /// Sign of `det Jr`: it changes only across a singularity.
    pub mode: f64,
    wrench_matrix: Matrix6<f64>,
    length: f64,
    columns: Vec<[f64; 6]>,
    first_tool: usize,
}

impl Posture {
    /// Home posture of the machine, not closed.
    pub fn new(mechanism: &Mechanism) -> Self {
        let joints: usize = mechanism.limbs.iter().map(|limb| limb.joints.len()).sum();
        Self {
            q: vec![0.0; joints],
            frames: vec![Se3::identity(); joints + mechanism.limbs.len()],
            splits: vec![PassiveSplit::rigid(); mechanism.limbs.len()],
            wrench_inverse: Matrix6::identity(),
            iterations: 0,
            mode: 1.0,
            wrench_matrix: Matrix6::identity(),
            length: mechanism.characteristic_length(),
            columns: Vec::with_capacity(6),
            first_tool: mechanism.limbs.first().map_or(0, |limb| limb.joints.len()),
        }
    }

    /// Size of the machine by which lengths are divided, m.
    pub fn length(&self) -> f64 {
        self.length
    }

    /// Pose of the tool in {S}: that of the first limb, which the others meet.
    pub fn tool(&self) -> Se3 {
        self.frames[self.first_tool]
    }

    /// Sets the joint variables from actuator variables (reading - home) and passive joint variables, both
    /// in machine order.
    pub fn set_joints(&mut self, mechanism: &Mechanism, actuators: &[f64], passive: &[f64]) {
        let (mut a, mut p) = (actuators.iter(), passive.iter());
        let joints = mechanism.limbs.iter().flat_map(|limb| &limb.joints);
        for (q, joint) in self.q.iter_mut().zip(joints) {
            let next = if joint.actuated { a.next() } else { p.next() };
            *q = next.copied().unwrap_or(0.0);
        }
    }

    /// Passive joint variables in machine order.
    pub fn passive(&self, mechanism: &Mechanism) -> Vec<f64> {
        let joints = mechanism.limbs.iter().flat_map(|limb| &limb.joints);
        self.q.iter().zip(joints).filter(|(_, joint)| !joint.actuated).map(|(q, _)| *q).collect()
    }

    /// Places every limb at the joint variables as set, loops left open: frames, passive twists and wrenches.
    pub fn open(&mut self, mechanism: &Mechanism, geometry: &Geometry) {
        self.place(mechanism, geometry);
        self.split(mechanism);
    }

    /// Closes the loops from the joint variables as set, actuated joints held.
    pub fn close(&mut self, mechanism: &Mechanism, geometry: &Geometry) -> Result<(), NotClosed> {
        self.iterations = 0;
        self.place(mechanism, geometry);
        if self.is_open_chain(mechanism) {
            return if self.tool().is_finite() { Ok(()) } else { Err(NotClosed::NotFinite) };
        }
        let mut gap = self.gap(mechanism);
        let mut before = self.q.clone();
        loop {
            self.split(mechanism);
            if gap <= CLOSED {
                return self.check_regular(mechanism);
            }
            if !gap.is_finite() {
                return Err(NotClosed::NotFinite);
            }
            if self.iterations == MAX_ITERATIONS || !self.invert_wrenches() {
                return Err(self.apart(mechanism));
            }
            before.copy_from_slice(&self.q);
            let steps = self.newton_step(mechanism);
            let longest = steps.iter().fold(0.0_f64, |m, s| m.max(s.abs()));
            let mut fraction = (LONGEST_STEP / longest.max(LONGEST_STEP)).min(1.0);
            self.iterations += 1;
            loop {
                for ((q, b), step) in self.q.iter_mut().zip(&before).zip(&steps) {
                    *q = b + fraction * step;
                }
                self.place(mechanism, geometry);
                let trial = self.gap(mechanism);
                if trial < gap || trial <= CLOSED {
                    gap = trial;
                    break;
                }
                fraction *= 0.5;
                if fraction < 1e-3 {
                    // No progress: either closed to rounding, or at a minimum where the limbs cannot meet.
                    self.q.copy_from_slice(&before);
                    self.place(mechanism, geometry);
                    self.split(mechanism);
                    if gap <= CLOSED_TO_ROUNDING {
                        return self.check_regular(mechanism);
                    }
                    return Err(self.apart(mechanism));
                }
            }
        }
    }

    /// Singular values of the wrench matrix `Jr`, descending; the smallest tells how near a singularity is.
    pub fn wrench_singular_values(&self) -> [f64; 6] {
        let mut s: [f64; 6] = self.wrench_matrix.singular_values().into();
        s.sort_by(|a, b| b.total_cmp(a));
        s
    }

    /// Ratio of the extreme singular values of the wrench matrix: 0 at a singularity, at most 1.
    pub fn regularity(&self) -> f64 {
        let s = self.wrench_singular_values();
        s[5] / s[0]
    }

    /// Twists of the passive joints of each limb at the joint variables as set, lengths in machine sizes.
    pub fn passive_jacobians(&mut self, mechanism: &Mechanism, geometry: &Geometry) -> Vec<Vec<[f64; 6]>> {
        self.place(mechanism, geometry);
        let mut frame = 0;
        let mut out = Vec::with_capacity(mechanism.limbs.len());
        for limb in &mechanism.limbs {
            let tool = self.frames[frame + limb.joints.len()].p;
            let passive = limb.joints.iter().zip(&self.frames[frame..]).filter(|(joint, _)| !joint.actuated);
            out.push(passive.map(|(j, g)| scaled(j.motion.tool_twist(g, &tool), self.length)).collect());
            frame += limb.links.len();
        }
        out
    }

    /// Sign of `det Jr` at the joint variables as set, the limbs not necessarily meeting.
    pub fn assembly_mode(&mut self, mechanism: &Mechanism, geometry: &Geometry) -> f64 {
        if self.is_open_chain(mechanism) {
            return 1.0;
        }
        self.place(mechanism, geometry);
        self.split(mechanism);
        self.wrench_matrix.determinant().signum()
    }

    /// The platform twist that the wrenches resist least, in words.
    pub fn free_motion(&self) -> String {
        let svd = self.wrench_matrix.svd(false, true);
        let Some(v_t) = svd.v_t else { return "in an unknown direction".into() };
        let row = v_t.row(svd.singular_values.argmin().0);
        let (w, v) = (row.columns(0, 3).norm(), row.columns(3, 3).norm());
        let (kind, part, size) = if w >= v { ("turning about", 0, w) } else { ("sliding along", 3, v) };
        let axis = row.columns(part, 3) / size;
        format!("{kind} [{:.2}, {:.2}, {:.2}]", axis[0], axis[1], axis[2])
    }

    /// Ratio of the extreme singular values of `Jr` and the free motion, where home itself is singular.
    pub fn singularity_at_home(
        &mut self,
        mechanism: &Mechanism,
        geometry: &Geometry,
    ) -> Option<(f64, String)> {
        self.q.fill(0.0);
        self.place(mechanism, geometry);
        self.split(mechanism);
        let s = self.wrench_singular_values();
        (s[5] <= SINGULAR * s[0]).then(|| (s[5] / s[0], self.free_motion()))
    }

    /// Whether the machine is one limb without passive joints: there is nothing to close.
    pub fn is_open_chain(&self, mechanism: &Mechanism) -> bool {
        mechanism.limbs.len() == 1 && mechanism.limbs[0].joints.iter().all(|joint| joint.actuated)
    }

    /// Forward kinematics of every limb (3).
    fn place(&mut self, mechanism: &Mechanism, geometry: &Geometry) {
        let (mut frame, mut joint) = (0, 0);
        for (limb, links) in mechanism.limbs.iter().zip(&geometry.limbs) {
            let mut at = links[0];
            self.frames[frame] = at;
            for (j, link) in limb.joints.iter().zip(&links[1..]) {
                at = j.motion.moved(&at, self.q[joint]) * *link;
                frame += 1;
                joint += 1;
                self.frames[frame] = at;
            }
            frame += 1;
        }
    }

    /// Index of the last frame of each limb.
    fn tools<'a>(mechanism: &'a Mechanism) -> impl Iterator<Item = usize> + 'a {
        mechanism.limbs.iter().scan(0, |next, limb| {
            *next += limb.links.len();
            Some(*next - 1)
        })
    }

    /// Twist `[w; dp / length]` from limb tool `frame` to the first limb's.
    fn gap_twist(&self, frame: usize) -> [f64; 6] {
        let (w, v) = pose_difference(&self.tool(), &self.frames[frame]);
        let v = v / self.length;
        [w.x, w.y, w.z, v.x, v.y, v.z]
    }

    fn gap(&self, mechanism: &Mechanism) -> f64 {
        // Unlike fold with max, the sum lets a NaN through.
        let square: f64 = Self::tools(mechanism).skip(1).flat_map(|t| self.gap_twist(t)).map(|v| v * v).sum();
        square.sqrt()
    }

    fn split(&mut self, mechanism: &Mechanism) {
        let (mut frame, mut row) = (0, 0);
        for (limb, split) in mechanism.limbs.iter().zip(&mut self.splits) {
            let tool = self.frames[frame + limb.joints.len()].p;
            self.columns.clear();
            for (joint, g) in limb.joints.iter().zip(&self.frames[frame..]) {
                if !joint.actuated {
                    self.columns.push(scaled(joint.motion.tool_twist(g, &tool), self.length));
                }
            }
            split.factor(&self.columns);
            for wrench in split.wrenches() {
                if row < 6 {
                    for (i, w) in wrench.iter().enumerate() {
                        self.wrench_matrix[(row, i)] = *w;
                    }
                }
                row += 1;
            }
            frame += limb.links.len();
        }
    }

    fn invert_wrenches(&mut self) -> bool {
        let lu = self.wrench_matrix.lu();
        match lu.try_inverse() {
            Some(inverse) if inverse.iter().all(|v| v.is_finite()) => {
                self.mode = lu.determinant().signum();
                self.wrench_inverse = inverse;
                true
            }
            _ => false,
        }
    }

    fn newton_step(&self, mechanism: &Mechanism) -> Vec<f64> {
        let mut rhs = Vector6::zeros();
        let mut row = 0;
        let gaps: Vec<[f64; 6]> = Self::tools(mechanism).map(|tool| self.gap_twist(tool)).collect();
        for (split, gap) in self.splits.iter().zip(&gaps) {
            for wrench in split.wrenches() {
                rhs[row] = -wrench.iter().zip(gap).map(|(w, e)| w * e).sum::<f64>();
                row += 1;
            }
        }
        let platform = self.wrench_inverse * rhs;
        let mut steps = Vec::with_capacity(self.q.len());
        for ((limb, split), gap) in mechanism.limbs.iter().zip(&self.splits).zip(&gaps) {
            let mut twist = *gap;
            for (t, p) in twist.iter_mut().zip(platform.iter()) {
                *t += p;
            }
            let motions = split.motions(&twist);
            let mut next = motions.iter();
            for joint in &limb.joints {
                let step = if joint.actuated { None } else { next.next() };
                steps.push(step.copied().unwrap_or(0.0));
            }
        }
        steps
    }

    fn check_regular(&mut self, mechanism: &Mechanism) -> Result<(), NotClosed> {
        for (limb, split) in mechanism.limbs.iter().zip(&self.splits) {
            if split.smallest_pivot() < SINGULAR {
                return Err(NotClosed::LimbSingular { limb: limb.name.clone() });
            }
        }
        let norm = self.wrench_matrix.norm();
        if !self.invert_wrenches() || norm * self.wrench_inverse.norm() * SINGULAR > 1.0 {
            let s = self.wrench_singular_values();
            return Err(NotClosed::Singular { smallest: s[5] / s[0] });
        }
        Ok(())
    }

    fn apart(&self, mechanism: &Mechanism) -> NotClosed {
        let (mut rotation, mut translation) = (0.0_f64, 0.0_f64);
        for tool in Self::tools(mechanism).skip(1) {
            let (w, v) = pose_difference(&self.tool(), &self.frames[tool]);
            rotation = rotation.max(w.norm());
            translation = translation.max(v.norm());
        }
        NotClosed::Apart { rotation, translation, iterations: self.iterations }
    }
}

/// A tool twist with its length part in machine sizes.
pub(super) fn scaled(mut twist: [f64; 6], length: f64) -> [f64; 6] {
    for v in &mut twist[3..] {
        *v /= length;
    }
    twist
}
