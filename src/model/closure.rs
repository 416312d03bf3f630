//! Newton's method on the passive joints (26)-(28).
//!
//! Each limb's passive joints are eliminated through its reciprocal wrenches, which leaves one 6 x 6 system for the
//! platform's twist (docs/theory.md section 7).

use super::mechanism::{Geometry, Mechanism, pose_difference};
use super::posture::{LONGEST_STEP, Posture, SINGULAR};
use nalgebra::Vector6;

/// Largest disagreement of the limbs at closure, rad and machine sizes.
const CLOSED: f64 = 1e-13;
/// Accepted where rounding allows no better.
const CLOSED_TO_ROUNDING: f64 = 1e-10;
const MAX_ITERATIONS: usize = 40;
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
    /// The reading has little to do with the posture that closes.
    #[error(
        "what was measured is {times:.0} times as far from the machine's posture as at the median sample"
    )]
    Unlike {
        /// Root mean square residual, in those of the median sample.
        times: f64,
    },
    /// The reading is that of another assembly mode.
    #[error(
        "measured in another assembly mode than the one that is followed, or on another branch of a limb's passive joints: \
         the residual is {followed:.3} times the noise, there {measured:.3} times"
    )]
    Elsewhere {
        /// Root mean square residual in the mode that is followed, in noise.
        followed: f64,
        /// The same in the other mode.
        measured: f64,
    },
    /// A number overflowed.
    #[error("the posture is not finite")]
    NotFinite,
}

impl NotClosed {
    /// The reason without angles and lengths, for messages that know no units.
    pub fn unitless(&self) -> String {
        match self {
            Self::Apart { iterations, .. } => format!("the limbs do not meet ({iterations} Newton steps)"),
            other => other.to_string(),
        }
    }
}

impl Posture {
    /// Closes the loops from the joint variables as set, actuated joints held.
    pub fn close(&mut self, mechanism: &Mechanism, geometry: &Geometry) -> Result<(), NotClosed> {
        self.iterations = 0;
        self.place(mechanism, geometry);
        if self.is_open_chain() {
            return if self.tool().is_finite() { Ok(()) } else { Err(NotClosed::NotFinite) };
        }
        let mut gap = self.gap(mechanism);
        let mut before = self.q.clone();
        let mut steps = vec![0.0; self.q.len()];
        loop {
            self.split(mechanism);
            if gap <= CLOSED {
                return self.check_regular(mechanism);
            }
            if !gap.is_finite() {
                return Err(NotClosed::NotFinite);
            }
            if self.iterations == MAX_ITERATIONS || !self.newton_step(mechanism, &mut steps) {
                return Err(self.apart(mechanism));
            }
            before.copy_from_slice(&self.q);
            let joints = mechanism.limbs.iter().flat_map(|limb| &limb.joints).zip(&steps);
            let sizes = joints.map(|(joint, s)| joint.motion.size_of(*s, self.length));
            let longest = sizes.fold(0.0_f64, f64::max);
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

    /// Index of the last frame of each limb.
    fn tools<'a>(mechanism: &'a Mechanism) -> impl Iterator<Item = usize> + 'a {
        mechanism.limbs.iter().scan(0, |next, limb| {
            *next += limb.links.len();
            Some(*next - 1)
        })
    }

    /// Measures how far each limb's tool is from the first limb's; the norm of it all, rad and machine sizes.
    fn gap(&mut self, mechanism: &Mechanism) -> f64 {
        let first = self.tool();
        let per_length = 1.0 / self.length;
        // Unlike fold with max, the sum lets a NaN through.
        let mut square = 0.0;
        for (gap, tool) in self.gaps.iter_mut().zip(Self::tools(mechanism)).skip(1) {
            let (w, v) = pose_difference(&first, &self.frames[tool].into());
            *gap = [w.x, w.y, w.z, v.x * per_length, v.y * per_length, v.z * per_length];
            square += gap.iter().map(|v| v * v).sum::<f64>();
        }
        square.sqrt()
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

    /// Newton step of every joint, 0 for actuated ones, written over `steps`; `false` where the wrenches cannot hold
    /// the platform. The gaps must have been measured.
    fn newton_step(&self, mechanism: &Mechanism, steps: &mut [f64]) -> bool {
        let mut rhs = Vector6::zeros();
        if self.splits.iter().map(|split| split.wrenches().len()).sum::<usize>() != rhs.len() {
            return false;
        }
        let mut row = 0;
        for (split, gap) in self.splits.iter().zip(&self.gaps) {
            for wrench in split.wrenches() {
                rhs[row] = -wrench.iter().zip(gap).map(|(w, e)| w * e).sum::<f64>();
                row += 1;
            }
        }
        if !self.wrench_matrix.lu().solve_mut(&mut rhs) || !rhs.sum().is_finite() {
            return false;
        }
        let mut at = 0;
        for ((limb, split), gap) in mechanism.limbs.iter().zip(&self.splits).zip(&self.gaps) {
            let mut twist = *gap;
            for (t, p) in twist.iter_mut().zip(rhs.iter()) {
                *t += p;
            }
            let motions = split.motions(&twist);
            let mut next = motions.iter();
            for joint in &limb.joints {
                let step = if joint.actuated { None } else { next.next() };
                steps[at] = step.copied().unwrap_or(0.0);
                at += 1;
            }
        }
        true
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
            let (w, v) = pose_difference(&self.tool(), &self.frames[tool].into());
            rotation = rotation.max(w.norm());
            translation = translation.max(v.norm());
        }
        NotClosed::Apart { rotation, translation, iterations: self.iterations }
    }
}
