//! The interface between an instrument's readings and the kinematics.

use super::closed::ClosedAt;
use super::point::{Gauge, Plane, Point};
use super::posture_noise::PostureNoise;
use crate::lie::Se3;
use crate::model::Posture;
use nalgebra::Vector3;
use std::sync::Arc;

/// One whitened residual and its derivative by the tool twist `[w; dp]` (rad, m; {S} axes, at the tool point).
#[derive(Clone, Copy, Debug, Default)]
pub struct Row {
    /// Predicted minus measured, in standard deviations.
    pub r: f64,
    /// Derivative by the tool twist.
    pub by_tool: [f64; 6],
}

/// Derivative of a row by the twist that one limb's own links give its tool, the machine's tool held (8.9).
#[derive(Clone, Copy, Debug)]
pub struct LimbDerivative {
    /// The row.
    pub row: usize,
    /// The limb.
    pub limb: usize,
    /// By `[w; dp]` of that limb's tool.
    pub by_twist: [f64; 6],
}

/// Derivative of a row by one constant of the instrument.
#[derive(Clone, Copy, Debug)]
pub struct ConstantDerivative {
    /// The row.
    pub row: usize,
    /// Index of the constant in [`crate::model::Mechanism::instrument`].
    pub constant: usize,
    /// The derivative, per rad, m or 1.
    pub value: f64,
}

/// Residuals of one sample with all their derivatives. A pose fills the rows alone.
#[derive(Clone, Debug, Default)]
pub struct Evaluation {
    /// Residuals and derivatives by the tool twist.
    pub rows: Vec<Row>,
    /// Derivative of each row by the tool twist of the second posture; empty where there is one posture.
    pub by_second: Vec<[f64; 6]>,
    /// Derivatives by single limbs' own twists.
    pub by_limb: Vec<LimbDerivative>,
    /// Derivatives by the instrument's constants.
    pub by_constant: Vec<ConstantDerivative>,
}

impl Evaluation {
    /// Forgets the sample, keeps the memory.
    pub fn clear(&mut self) {
        self.rows.clear();
        self.by_second.clear();
        self.by_limb.clear();
        self.by_constant.clear();
    }

    /// Appends the rows of another sample of the same posture, or pair of postures.
    pub fn append(&mut self, other: &Evaluation) {
        let first = self.rows.len();
        self.rows.extend_from_slice(&other.rows);
        self.by_second.extend_from_slice(&other.by_second);
        self.by_limb.extend(other.by_limb.iter().map(|by| LimbDerivative { row: by.row + first, ..*by }));
        let constants = other.by_constant.iter();
        self.by_constant.extend(constants.map(|by| ConstantDerivative { row: by.row + first, ..*by }));
    }

    /// One row in place of all: each times its residual, added up. Its derivatives are the gradient of `|r|^2 / 2`.
    pub fn weighted_sum(&self) -> Evaluation {
        let weighted = |all: &mut dyn Iterator<Item = (f64, &[f64; 6])>| {
            let mut sum = [0.0; 6];
            for (r, by) in all {
                sum.iter_mut().zip(by).for_each(|(sum, by)| *sum += r * by);
            }
            sum
        };
        let r = |row: usize| self.rows[row].r;
        let by_tool = weighted(&mut self.rows.iter().map(|row| (row.r, &row.by_tool)));
        let by_second = weighted(&mut self.rows.iter().map(|row| row.r).zip(&self.by_second));
        let of_limb = |by: &LimbDerivative| LimbDerivative {
            row: 0,
            limb: by.limb,
            by_twist: by.by_twist.map(|v| v * r(by.row)),
        };
        let of_constant =
            |by: &ConstantDerivative| ConstantDerivative { row: 0, value: by.value * r(by.row), ..*by };
        Evaluation {
            rows: vec![Row { r: self.square(), by_tool }],
            by_second: if self.by_second.is_empty() { Vec::new() } else { vec![by_second] },
            by_limb: self.by_limb.iter().map(of_limb).collect(),
            by_constant: self.by_constant.iter().map(of_constant).collect(),
        }
    }

    /// Sum of the squares of the residuals.
    pub fn square(&self) -> f64 {
        self.rows.iter().map(|row| row.r * row.r).sum()
    }
}

/// What an instrument sees of the machine in one sample.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// Tool pose.
    pub tool: Se3,
    /// The closed posture; `None` where only a tool pose is known.
    pub posture: Option<&'a Posture>,
    /// Tool pose in the second posture; that of the first where there is one only.
    pub second: Se3,
    /// Values of the instrument's constants, rad, m or 1.
    pub instrument: &'a [f64],
}

impl View<'_> {
    /// A tool pose alone.
    pub fn of_tool(tool: &Se3) -> Self {
        Self { tool: *tool, posture: None, second: *tool, instrument: &[] }
    }
}

/// Weights by which a measurement's residuals may be multiplied instead of its stated noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Weights {
    /// None: residuals in rad and m, displacements those of the tool point.
    Unit,
    /// None, and the unweighted spatial twist in place of the tool point's displacement (30).
    SpatialTwist,
    /// Isotropic noise of one standard deviation.
    Isotropic {
        /// Of each rotation component, rad.
        angle: f64,
        /// Of each length, m.
        length: f64,
    },
    /// The present ones, for noise of so many times the size.
    Scaled(f64),
}

impl Weights {
    /// Standard deviation (rad, m) of a reading that is an angle, or a length, and has `present` so far.
    pub(super) fn sigma(self, angular: bool, present: f64) -> f64 {
        match self {
            Weights::Unit | Weights::SpatialTwist => 1.0,
            Weights::Scaled(factor) => factor * present,
            Weights::Isotropic { angle, length } => {
                if angular {
                    angle
                } else {
                    length
                }
            }
        }
    }
}

/// Distance between what was predicted and what was measured, of the parts that were measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Errors {
    /// Angle of the rotation between predicted and measured pose, rad.
    pub rotation: Option<f64>,
    /// Displacement of the tool point or target, m.
    pub position: Option<f64>,
    /// Of a distance, m.
    pub distance: Option<f64>,
    /// Of a height above a plane, m.
    pub plane: Option<f64>,
    /// Of passive joints' angles, root mean square over the joints of the sample, rad.
    pub joint_angle: Option<f64>,
    /// Of passive joints' lengths, root mean square over the joints of the sample, m.
    pub joint_length: Option<f64>,
}

/// What a reading says about where things are, for starts in closed form.
#[derive(Clone, Copy, Debug)]
pub enum Clue {
    /// Where the tool is.
    Pose(Se3),
    /// Where a target on the tool is, m.
    Position {
        /// The target.
        target: Point,
        /// Its position in {S}.
        at: Vector3<f64>,
    },
    /// How far a target is from a fixed point.
    Range {
        /// The target.
        target: Point,
        /// The fixed point.
        point: Point,
        /// What the gauge makes of the distance.
        gauge: Gauge,
        /// Its reading, m.
        reading: f64,
    },
    /// That a target is near a plane.
    Touch {
        /// The target.
        target: Point,
        /// The plane.
        plane: Plane,
        /// Height above it, m.
        height: f64,
    },
    /// Only how the machine's own parts stand to each other: it has nothing to do with {S}.
    Internal,
    /// Part of a pose that is too little to start from.
    None,
}

/// Readings of one posture, or of two that are compared. The chain rule through tool twists is all that it shares
/// with the kinematics, so that a new kind of measurement never touches them.
pub trait Measurement: std::fmt::Debug + Send + Sync {
    /// What it wraps, if anything: where a default below says nothing else, that one answers.
    fn inner(&self) -> Option<&dyn Measurement> {
        None
    }

    /// Number of residuals.
    fn rows(&self) -> usize;

    /// Appends the residuals at what is predicted, as many as [`rows`](Self::rows), to an evaluation without rows.
    fn evaluate(&self, view: &View<'_>, out: &mut Evaluation);

    /// What one such reading is worth beside one of weight 1: a factor on its information, part of the residuals.
    fn weight(&self) -> f64 {
        self.inner().map_or(1.0, |inner| inner.weight())
    }

    /// By what it errs together with everything else that is measured at its posture; not part of its residuals, which
    /// whoever has all of the posture whitens by it.
    fn posture_noise(&self) -> Option<PostureNoise> {
        self.inner()?.posture_noise()
    }

    /// The same without posture noise, where it has some.
    fn alone(&self) -> Option<Arc<dyn Measurement>> {
        None
    }

    /// Whether residual `row` is an angle; else it is a length.
    fn is_angle(&self, row: usize) -> bool {
        self.inner().is_some_and(|inner| inner.is_angle(row))
    }

    /// Actuator variables (rad, m) of the second posture, for kinds that compare two.
    fn second(&self) -> Option<&[f64]> {
        self.inner()?.second()
    }

    /// The measured pose, where there is a whole one: the posture is sought from it.
    fn pose(&self) -> Option<&Se3> {
        self.inner()?.pose()
    }

    /// Joint variables at which the posture was closed, where it was: it is closed again from there.
    fn closed_at(&self) -> Option<&ClosedAt> {
        self.inner()?.closed_at()
    }

    /// What it says about where things are.
    fn clue(&self) -> Clue;

    /// Whether the posture was led to where the reading is what it is, as a probe is to a surface.
    fn is_contact(&self) -> bool {
        self.inner().is_some_and(|inner| inner.is_contact())
    }

    /// The numbers read, rad and m, in an order of the kind's own.
    fn readings(&self) -> Vec<f64>;

    /// How far the prediction is from what was measured.
    fn error(&self, view: &View<'_>) -> Errors;

    /// What the same instrument would read without noise.
    fn expected(&self, view: &View<'_>) -> Arc<dyn Measurement>;

    /// The same readings with noise of the stated size added; `normal` draws standard normal numbers.
    fn perturbed(&self, normal: &mut dyn FnMut() -> f64) -> Arc<dyn Measurement>;

    /// The same comparison for other actuator variables (rad, m) of the second posture; itself where there is none.
    fn with_second(&self, actuators: &[f64]) -> Option<Arc<dyn Measurement>> {
        let _ = actuators;
        None
    }

    /// The same readings, weighted otherwise.
    fn reweighted(&self, weights: Weights) -> Arc<dyn Measurement>;
}
