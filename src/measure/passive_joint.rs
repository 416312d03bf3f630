//! Readings of sensors on passive joints: what a machine knows of itself without an external instrument.

use super::measurement::{Clue, Errors, Evaluation, LimbDerivative, Measurement, Row, View, Weights};
use super::point::per_metre;
use std::sync::Arc;

/// A passive joint with a sensor, and where it stands in the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SensedJoint {
    /// Its limb.
    pub limb: usize,
    /// Which of the limb's passive joints it is.
    pub passive: usize,
    /// Which of the machine's joints it is, limb by limb.
    pub joint: usize,
    /// Whether it reads an angle; else a length.
    pub angular: bool,
}

/// Joint variables (reading - home) of passive joints.
#[derive(Clone, Debug)]
pub struct PassiveJoints {
    /// The joints, each with its reading less home (rad, m) and its standard deviation.
    read: Vec<(SensedJoint, f64, f64)>,
}

impl PassiveJoints {
    /// Joint variables (rad, m), each with the standard deviation `angle` (rad) or `length` (m).
    pub fn new(read: &[(SensedJoint, f64)], angle: f64, length: f64) -> Self {
        let sigma = |joint: &SensedJoint| if joint.angular { angle } else { length };
        Self { read: read.iter().map(|(joint, value)| (*joint, *value, sigma(joint))).collect() }
    }

    /// Predicted joint variable, NaN where no posture is known.
    fn predicted(joint: &SensedJoint, view: &View<'_>) -> f64 {
        view.posture.and_then(|posture| posture.q.get(joint.joint)).copied().unwrap_or(f64::NAN)
    }

    /// Predicted less measured, angles within half a turn.
    fn difference(joint: &SensedJoint, measured: f64, view: &View<'_>) -> f64 {
        use std::f64::consts::{PI, TAU};
        let difference = Self::predicted(joint, view) - measured;
        if joint.angular { (difference + PI).rem_euclid(TAU) - PI } else { difference }
    }
}

impl Measurement for PassiveJoints {
    fn rows(&self) -> usize {
        self.read.len()
    }

    /// (8.9)
    fn evaluate(&self, view: &View<'_>, out: &mut Evaluation) {
        for (joint, measured, sigma) in &self.read {
            let row = out.rows.len();
            let mut by_tool = [0.0; 6];
            if let Some((posture, split)) =
                view.posture.and_then(|posture| Some((posture, posture.splits.get(joint.limb)?)))
            {
                let covector = split.motion_covector(joint.passive);
                by_tool = per_metre(&covector, posture.length()).map(|v| v / sigma);
            }
            out.rows.push(Row { r: Self::difference(joint, *measured, view) / sigma, by_tool });
            out.by_limb.push(LimbDerivative { row, limb: joint.limb, by_twist: by_tool.map(|v| -v) });
        }
    }

    fn is_angle(&self, row: usize) -> bool {
        self.read.get(row).is_some_and(|(joint, ..)| joint.angular)
    }

    fn clue(&self) -> Clue {
        Clue::Internal
    }

    fn readings(&self) -> Vec<f64> {
        self.read.iter().map(|(_, value, _)| *value).collect()
    }

    fn error(&self, view: &View<'_>) -> Errors {
        let rms = |angular: bool| {
            let own = self.read.iter().filter(|(joint, ..)| joint.angular == angular);
            let squares: Vec<f64> =
                own.map(|(joint, value, _)| Self::difference(joint, *value, view).powi(2)).collect();
            (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
        };
        Errors { joint_angle: rms(true), joint_length: rms(false), ..Errors::default() }
    }

    fn expected(&self, view: &View<'_>) -> Arc<dyn Measurement> {
        let read = self.read.iter().map(|(joint, _, sigma)| (*joint, Self::predicted(joint, view), *sigma));
        Arc::new(Self { read: read.collect() })
    }

    fn perturbed(&self, normal: &mut dyn FnMut() -> f64) -> Arc<dyn Measurement> {
        let read = self.read.iter().map(|(joint, value, sigma)| (*joint, value + sigma * normal(), *sigma));
        Arc::new(Self { read: read.collect() })
    }

    fn reweighted(&self, weights: Weights) -> Arc<dyn Measurement> {
        let weigh = |present: f64, joint: &SensedJoint| weights.sigma(joint.angular, present);
        let read = self.read.iter().map(|(joint, value, sigma)| (*joint, *value, weigh(*sigma, joint)));
        Arc::new(Self { read: read.collect() })
    }
}
