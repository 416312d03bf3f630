//! Postures: the joint variables and frames of a machine whose loops are closed.
//!
//! Twists here are those of the tool point, `[w; dp]`, lengths divided by the machine's size.

use super::joint::{Joint, Motion};
use super::limb::Limb;
use super::mechanism::{Geometry, Mechanism};
use super::passive::PassiveSplit;
use crate::lie::{Columns, Se3};
use crate::wide::wide;
use nalgebra::Matrix6;

/// Longest Newton step of one joint, rad or machine sizes.
pub(super) const LONGEST_STEP: f64 = 0.4;
/// Reciprocal condition of `Jr` below which a posture counts as singular.
pub(super) const SINGULAR: f64 = 1e-9;
/// Most iterations of a decomposition; without a limit one of numbers that are not finite never ends.
pub(super) const ITERATIONS: usize = 1000;

/// A joint variable with its sine and cosine, which cost more than what is done with them.
#[derive(Clone, Copy, Debug)]
pub struct Turn {
    /// The joint variable, rad or m.
    pub q: f64,
    /// Its sine and cosine; 0 and 1 where it is a length.
    sin_cos: (f64, f64),
}

impl Turn {
    fn zero() -> Self {
        Self { q: 0.0, sin_cos: (0.0, 1.0) }
    }

    fn of(motion: Motion, q: f64) -> Self {
        Self { q, sin_cos: if motion.is_angular() { q.sin_cos() } else { (0.0, 1.0) } }
    }
}

/// Working state and result of closing one posture; reused from one to the next.
#[derive(Clone, Debug)]
pub struct Posture {
    /// Joint variables, limb by limb, rad or m.
    pub q: Vec<f64>,
    /// The joint variables that were placed last.
    turns: Vec<Turn>,
    /// Frames in {S} behind each link, limb by limb: f_i + 1 each, the last one that limb's tool.
    pub frames: Vec<Columns>,
    /// Per limb, passive twists and wrenches.
    pub splits: Vec<PassiveSplit>,
    /// Inverse of the stacked wrenches `Jr`.
    pub wrench_inverse: Matrix6<f64>,
    /// Newton iterations of the last closure.
    pub iterations: usize,
    /// Sign of `det Jr`: it changes only across a singularity.
    pub mode: f64,
    pub(super) wrench_matrix: Matrix6<f64>,
    pub(super) length: f64,
    pub(super) columns: Vec<[f64; 6]>,
    /// Twist `[w; dp / length]` from each limb's tool to the first limb's.
    pub(super) gaps: Vec<[f64; 6]>,
    pub(super) first_tool: usize,
    /// Whether there is nothing to close.
    open: bool,
}

impl Posture {
    /// Home posture of the machine, not closed.
    pub fn new(mechanism: &Mechanism) -> Self {
        let joints: usize = mechanism.limbs.iter().map(|limb| limb.joints.len()).sum();
        Self {
            q: vec![0.0; joints],
            turns: vec![Turn::zero(); joints],
            frames: vec![Columns::identity(); joints + mechanism.limbs.len()],
            splits: vec![PassiveSplit::rigid(); mechanism.limbs.len()],
            wrench_inverse: Matrix6::identity(),
            iterations: 0,
            mode: 1.0,
            wrench_matrix: Matrix6::identity(),
            length: mechanism.characteristic_length(),
            columns: Vec::with_capacity(6),
            gaps: vec![[0.0; 6]; mechanism.limbs.len()],
            first_tool: mechanism.limbs.first().map_or(0, |limb| limb.joints.len()),
            open: mechanism.is_open_chain(),
        }
    }

    /// Size of the machine by which lengths are divided, m.
    pub fn length(&self) -> f64 {
        self.length
    }

    /// Whether the machine is an open chain of actuated joints.
    pub fn is_open_chain(&self) -> bool {
        self.open
    }

    /// Pose of the tool in {S}: that of the first limb, which the others meet.
    pub fn tool(&self) -> Se3 {
        self.frames[self.first_tool].into()
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

    /// Whether no singularity, of the platform or of a limb, separates it from another posture by sign: both closed, their
    /// determinants have the same signs.
    pub fn is_on_branch_of(&self, other: &Self) -> bool {
        let mut limbs = self.splits.iter().zip(&other.splits);
        self.mode == other.mode && limbs.all(|(a, b)| a.orientation() == b.orientation())
    }

    /// Longest motion of a joint from the joint variables `from`, rad or machine sizes.
    pub fn moved_from(&self, mechanism: &Mechanism, from: &[f64]) -> f64 {
        let joints = mechanism.limbs.iter().flat_map(|limb| &limb.joints);
        let moved =
            |((to, from), joint): ((&f64, &f64), &Joint)| joint.motion.size_of(to - from, self.length);
        self.q.iter().zip(from).zip(joints).map(moved).fold(0.0, f64::max)
    }

    /// The joint variables that were placed last, limb by limb.
    pub fn turns(&self) -> &[Turn] {
        &self.turns
    }

    /// Sets all joint variables to those of another posture of the machine.
    pub fn set_turns(&mut self, turns: &[Turn]) {
        self.turns.copy_from_slice(turns);
        self.q.iter_mut().zip(turns).for_each(|(q, turn)| *q = turn.q);
    }

    /// Actuator variables in machine order.
    pub fn actuators(&self, mechanism: &Mechanism) -> Vec<f64> {
        let joints = mechanism.limbs.iter().flat_map(|limb| &limb.joints);
        self.q.iter().zip(joints).filter(|(_, joint)| joint.actuated).map(|(q, _)| *q).collect()
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

    /// Singular values of the wrench matrix `Jr`, descending; the smallest tells how near a singularity is.
    pub fn wrench_singular_values(&self) -> [f64; 6] {
        // A matrix that is not finite has none: it counts as singular.
        let svd = self.wrench_matrix.try_svd(false, false, 5.0 * f64::EPSILON, ITERATIONS);
        let mut s: [f64; 6] = svd.map_or([1.0, 0.0, 0.0, 0.0, 0.0, 0.0], |svd| svd.singular_values.into());
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
            let mut columns = Vec::with_capacity(6);
            passive_twists(limb, &self.frames[frame..], self.length, &mut columns);
            out.push(columns);
            frame += limb.links.len();
        }
        out
    }

    /// Sign of `det Jr` at the joint variables as set, the limbs not necessarily meeting.
    pub fn assembly_mode(&mut self, mechanism: &Mechanism, geometry: &Geometry) -> f64 {
        if self.open {
            return 1.0;
        }
        self.open(mechanism, geometry);
        self.wrench_matrix.determinant().signum()
    }

    /// The platform twist that the wrenches resist least, in words.
    pub fn free_motion(&self) -> String {
        let svd = self.wrench_matrix.try_svd(false, true, 5.0 * f64::EPSILON, ITERATIONS);
        let Some((svd, v_t)) = svd.and_then(|svd| Some((svd, svd.v_t?))) else {
            return "in an unknown direction".into();
        };
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
        self.open(mechanism, geometry);
        let s = self.wrench_singular_values();
        (s[5] <= SINGULAR * s[0]).then(|| (s[5] / s[0], self.free_motion()))
    }

    /// Forward kinematics of every limb (3).
    pub(super) fn place(&mut self, mechanism: &Mechanism, geometry: &Geometry) {
        let mut variables = self.q.iter().zip(&mut self.turns);
        for limb in &mechanism.limbs {
            for (joint, (q, turn)) in limb.joints.iter().zip(variables.by_ref()) {
                if *q != turn.q {
                    *turn = Turn::of(joint.motion, *q);
                }
            }
        }
        wide(
            #[inline(always)]
            || self.place_limbs(mechanism, geometry),
        );
    }

    #[inline(always)]
    fn place_limbs(&mut self, mechanism: &Mechanism, geometry: &Geometry) {
        let mut turns = self.turns.iter();
        let mut first = 0;
        for (limb, links) in mechanism.limbs.iter().zip(&geometry.limbs) {
            let frames = &mut self.frames[first..first + links.len()];
            frames[0] = Columns::from(&links[0]);
            for (i, ((joint, link), turn)) in limb.joints.iter().zip(&links[1..]).zip(&mut turns).enumerate()
            {
                // From memory to memory: in registers, the compiler would take the columns apart.
                if let [before, behind, ..] = &mut frames[i..] {
                    *behind = joint.motion.moved_by(before, turn.q, turn.sin_cos).times(link);
                }
            }
            first += links.len();
        }
    }

    /// Places the one limb of a machine that has no other; returns the twists of its passive joints, lengths in machine
    /// sizes.
    pub fn place_alone(&mut self, mechanism: &Mechanism, geometry: &Geometry) -> &[[f64; 6]] {
        self.place(mechanism, geometry);
        if let Some(limb) = mechanism.limbs.first() {
            passive_twists(limb, &self.frames, self.length, &mut self.columns);
        }
        &self.columns
    }

    pub(super) fn split(&mut self, mechanism: &Mechanism) {
        wide(
            #[inline(always)]
            || self.split_limbs(mechanism),
        );
    }

    #[inline(always)]
    fn split_limbs(&mut self, mechanism: &Mechanism) {
        let (mut frame, mut row) = (0, 0);
        for (limb, split) in mechanism.limbs.iter().zip(&mut self.splits) {
            passive_twists(limb, &self.frames[frame..], self.length, &mut self.columns);
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
}

/// Twists of a limb's passive joints with its frames, written over `columns`.
#[inline(always)]
fn passive_twists(limb: &Limb, frames: &[Columns], length: f64, columns: &mut Vec<[f64; 6]>) {
    let tool = frames[limb.joints.len()].p();
    columns.clear();
    for (joint, g) in limb.joints.iter().zip(frames) {
        if !joint.actuated {
            columns.push(scaled(joint.motion.tool_twist(g, &tool), length));
        }
    }
}

/// A tool twist with its length part in machine sizes.
#[inline(always)]
pub(super) fn scaled([a, b, c, x, y, z]: [f64; 6], length: f64) -> [f64; 6] {
    let per_length = 1.0 / length;
    [a, b, c, x * per_length, y * per_length, z * per_length]
}
