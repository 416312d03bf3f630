//! The parts of a result file.

use super::units::Units;
use crate::lie::Se3;
use serde::{Deserialize, Deserializer, Serialize};

/// JSON has no infinities: what a diverged run leaves is written as `null`, and read as NaN.
pub(super) fn number<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::NAN))
}

/// Like [`number`], for a list.
pub(super) fn numbers<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<f64>, D::Error> {
    let list: Vec<Option<f64>> = Vec::deserialize(deserializer)?;
    Ok(list.into_iter().map(|v| v.unwrap_or(f64::NAN)).collect())
}

fn triple<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[f64; 3], D::Error> {
    let list: [Option<f64>; 3] = Deserialize::deserialize(deserializer)?;
    Ok(list.map(|v| v.unwrap_or(f64::NAN)))
}

/// One accepted iteration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TraceEntry {
    /// Merit after the step.
    #[serde(deserialize_with = "number")]
    pub cost: f64,
    /// Length of the step in the identifier's coordinates.
    #[serde(deserialize_with = "number")]
    pub step: f64,
    /// Directions kept, for identifiers that choose.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kept: Option<usize>,
}

/// How many parameters there are, and how many of them can be seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Counts {
    /// 4r + 2p + 6.
    pub structural: usize,
    /// Rank of the Jacobian.
    pub first_order: usize,
    /// Directions that the data tell apart from the tolerances.
    pub practical: usize,
}

/// Errors of predicted poses: position is the displacement of the tool point, rotation the angle.
///
/// `None` where that part was not measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseErrors {
    /// Root mean square, length of the file.
    pub position_rms: Option<f64>,
    /// Largest, length of the file.
    pub position_max: Option<f64>,
    /// Root mean square, angle of the file.
    pub rotation_rms: Option<f64>,
    /// Largest, angle of the file.
    pub rotation_max: Option<f64>,
    /// Of distances, root mean square, length of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distance_rms: Option<f64>,
    /// Largest, length of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distance_max: Option<f64>,
    /// Of heights above planes, root mean square, length of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plane_rms: Option<f64>,
    /// Largest, length of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plane_max: Option<f64>,
    /// Of passive joints' angles, root mean square, angle of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joint_angle_rms: Option<f64>,
    /// Largest of a sample, angle of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joint_angle_max: Option<f64>,
    /// Of passive joints' lengths, root mean square, length of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joint_length_rms: Option<f64>,
    /// Largest of a sample, length of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joint_length_max: Option<f64>,
    /// Root mean square of the whitened residual: 1 where the model fits to the noise.
    pub weighted_rms: Option<f64>,
}

impl PoseErrors {
    /// Errors in rad and m, in units of the file.
    pub fn in_units(self, units: Units) -> Self {
        Self {
            position_rms: self.position_rms.map(|v| units.from_metres(v)),
            position_max: self.position_max.map(|v| units.from_metres(v)),
            rotation_rms: self.rotation_rms.map(|v| units.from_radians(v)),
            rotation_max: self.rotation_max.map(|v| units.from_radians(v)),
            distance_rms: self.distance_rms.map(|v| units.from_metres(v)),
            distance_max: self.distance_max.map(|v| units.from_metres(v)),
            plane_rms: self.plane_rms.map(|v| units.from_metres(v)),
            plane_max: self.plane_max.map(|v| units.from_metres(v)),
            joint_angle_rms: self.joint_angle_rms.map(|v| units.from_radians(v)),
            joint_angle_max: self.joint_angle_max.map(|v| units.from_radians(v)),
            joint_length_rms: self.joint_length_rms.map(|v| units.from_metres(v)),
            joint_length_max: self.joint_length_max.map(|v| units.from_metres(v)),
            weighted_rms: self.weighted_rms,
        }
    }
}

/// Errors of the nominal and of the calibrated machine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BeforeAfter {
    /// Nominal.
    pub before: PoseErrors,
    /// Calibrated.
    pub after: PoseErrors,
}

/// Components of a deviation, or their standard errors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Deviation {
    /// Rotation vector, angle of the file.
    #[serde(deserialize_with = "triple")]
    pub rotation: [f64; 3],
    /// Translation part of the twist, length of the file.
    #[serde(deserialize_with = "triple")]
    pub translation: [f64; 3],
}

impl Deviation {
    /// Six components in rad and m, rotation first, in units of the file.
    pub fn of(components: &[f64; 6], units: Units) -> Self {
        let [a, b, c, x, y, z] = *components;
        Self {
            rotation: [a, b, c].map(|v| units.from_radians(v)),
            translation: [x, y, z].map(|v| units.from_metres(v)),
        }
    }
}

impl LinkResult {
    /// Deviation and standard errors beside placement and tool mounting; from the drawing where these do not move the link.
    pub fn own(&self) -> (&Deviation, Option<&Deviation>) {
        match &self.beside {
            Some(beside) => (beside, self.beside_std.as_ref()),
            None => (&self.deviation, self.std.as_ref()),
        }
    }
}

/// What was found of a link: nominal * exp(deviation), in the frame of the next joint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkResult {
    /// Its limb.
    pub limb: String,
    /// The joint that it carries, or `tool`.
    pub link: String,
    /// The deviation from the drawing.
    pub deviation: Deviation,
    /// The same beside placement and tool mounting, of links that these move: `placement * nominal * exp(beside)`, or
    /// `nominal * exp(beside) * tool_mounting`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beside: Option<Deviation>,
    /// Standard errors of `beside`, `None` where they are not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beside_std: Option<Deviation>,
    /// Standard errors, `None` where they are not known.
    pub std: Option<Deviation>,
    /// The same for noise `birge_ratio` times what was stated, where the residual contradicts it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scaled_std: Option<Deviation>,
    /// Of each variance, the share that stems from the tolerances and not from the measurements: 0 is data, 1 is prior.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prior_share: Option<Deviation>,
}

/// Where the machine was placed, or its tool mounted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MountResult {
    /// Length of the file: of the drawing's origin in {S}, or of the tool point in the frame of the tool as drawn.
    pub position: [f64; 3],
    /// Rotation vector, angle of the file.
    pub rotation: [f64; 3],
    /// Standard errors of the rotation and of the position, in the same axes; `None` where they are not known.
    pub std: Option<Deviation>,
}

impl MountResult {
    /// A motion with its standard errors (rotation first, rad and m), in units of the file.
    pub fn of(pose: &Se3, std: Option<&[f64; 6]>, units: Units) -> Self {
        let (position, rotation) = units.from_pose(pose);
        Self { position, rotation, std: std.map(|std| Deviation::of(std, units)) }
    }

    /// The motion, m.
    pub fn pose(&self, units: Units) -> Se3 {
        let rotation = self.rotation.map(|v| units.to_radians(v));
        let position = self.position.map(|v| units.to_metres(v));
        Se3::from_rotation_vector(position.into(), &rotation.into())
    }
}

/// What was found of a constant of the instrument.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConstantResult {
    /// Its name, such as `point bar1 x`.
    pub name: String,
    /// As the problem states it, in units of the file.
    pub nominal: f64,
    /// As identified, in units of the file.
    #[serde(deserialize_with = "number")]
    pub value: f64,
    /// Standard error, `None` where it is not known.
    pub std: Option<f64>,
}

/// A sample that took no part.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SetAsideEntry {
    /// Its name.
    pub sample: String,
    /// Why.
    pub reason: String,
}

/// A sample of weight 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UnusedEntry {
    /// Its name.
    pub sample: String,
    /// How the calibrated machine predicts it; `None` where its loops do not close.
    pub errors: Option<PoseErrors>,
}

/// A limit that holds with equality at the solution.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActiveBoundEntry {
    /// Parameter or link.
    pub name: String,
    /// The limit, in tolerances.
    #[serde(deserialize_with = "number")]
    pub limit: f64,
    /// Lagrange multiplier: decrease of the cost per unit that the limit gives way.
    #[serde(deserialize_with = "number")]
    pub multiplier: f64,
}

/// A regularisation weight that was tried.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WeightEntry {
    /// The weight.
    #[serde(deserialize_with = "number")]
    pub weight: f64,
    /// Its score.
    #[serde(deserialize_with = "number")]
    pub score: f64,
}

/// Residual against the stated noise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChiSquare {
    /// Sum of squares of the whitened residual.
    #[serde(deserialize_with = "number")]
    pub value: f64,
    /// Residuals less parameters, those that lean on the prior counted in part.
    #[serde(deserialize_with = "number")]
    pub degrees_of_freedom: f64,
    /// Probability that the stated noise alone makes it as large, or larger.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub probability: Option<f64>,
    /// What follows, in a sentence.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<String>,
    /// By how much the noise seems larger than stated, where the residual contradicts it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub birge_ratio: Option<f64>,
    /// The same test of groups of readings: by set, kind, component and axis.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub groups: Vec<GroupEntry>,
    /// Causes that the data name, the one with the most evidence first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub causes: Vec<CauseEntry>,
    /// Hold-out, with the covariance of its predictions beside the noise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub holdout: Option<GroupEntry>,
}

/// Chi-square of a group of readings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GroupEntry {
    /// What the group is called.
    pub name: String,
    /// Sum of squares of its whitened residual.
    #[serde(deserialize_with = "number")]
    pub value: f64,
    /// What the stated noise makes of it.
    #[serde(deserialize_with = "number")]
    pub degrees_of_freedom: f64,
}

/// A cause of a residual.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CauseEntry {
    /// `noise`, `outliers`, `order`, `drift` or `model`.
    pub kind: String,
    /// In words.
    pub text: String,
}

/// Deviations against the stated tolerances.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToleranceFactor {
    /// Most likely factor on all stated tolerances.
    #[serde(deserialize_with = "number")]
    pub value: f64,
    /// Its 95 % interval.
    pub interval: [f64; 2],
    /// Probability that tolerances as stated make deviations as large, or larger.
    #[serde(deserialize_with = "number")]
    pub probability: f64,
    /// Directions that the data know better than the stated tolerances.
    pub directions: usize,
    /// Factor under which estimate, standard errors and predictions are: 1 where the tolerances are trusted as stated.
    pub in_force: f64,
    /// What follows, in a sentence.
    pub verdict: String,
}

/// Errors of postures predicted without them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CrossValidationEntry {
    /// Into how many parts the postures were divided.
    pub folds: usize,
    /// Parts for which the machine was identified again; for the others the change follows from the influence matrix.
    pub refitted: usize,
    /// Prediction errors of the postures left out.
    pub errors: PoseErrors,
}

/// Where a result comes from, so that a report finds its data again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SourceEntry {
    /// The problem file, as it was named.
    pub problem_file: String,
    /// Part of the samples that was held out besides the problem's own hold-out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub holdout: Option<f64>,
    /// Seed of the choice of held-out samples.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
}

/// How much the estimate leans on the tolerances, which decides its covariance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum EstimateEntry {
    /// Not at all.
    LeastSquares,
    /// Fully up to this signal-to-noise ratio, not at all from ten times it.
    Split(f64),
    /// The same, limb by limb.
    Decoupled(f64),
    /// With this weight on every direction.
    Ridge(f64),
    /// In a way that linear theory does not describe: bounds, robust losses.
    Other,
}
