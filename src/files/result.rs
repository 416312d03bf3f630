//! Result files `gough-result/1`, in units of the problem.

use super::drawing::MechanismDrawing;
use super::elsewhere::ElsewhereEntry;
use super::error::{FileError, quoted};
use super::fault::Fault;
use super::json;
use super::noise::{NoiseDrawing, PostureNoiseEntry};
use super::place::Place;
use super::summary::{
    ActiveBoundEntry, BeforeAfter, ChiSquare, ConstantResult, Counts, CrossValidationEntry, EstimateEntry,
    LinkResult, MountResult, SetAsideEntry, SourceEntry, ToleranceFactor, TraceEntry, UnusedEntry,
    WeightEntry, numbers,
};
use super::uncertainty::UncertaintyDrawing;
use super::units::Units;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// Format of result files.
pub const RESULT_FORMAT: &str = "gough-result/1";

/// What an identification found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResultFile {
    /// [`RESULT_FORMAT`].
    pub format: String,
    /// Name of the problem.
    pub problem: String,
    /// Where its data are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<SourceEntry>,
    /// Name of the identifier.
    pub solver: String,
    /// Its settings in force.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub settings: BTreeMap<String, String>,
    /// Whether it ended at a solution.
    pub converged: bool,
    /// Why it stopped.
    pub reason: String,
    /// Accepted iterations.
    pub iterations: usize,
    /// Of every number.
    pub units: Units,
    /// Postures that took part: samples of equal actuator readings are one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub postures: Option<usize>,
    /// Samples that took part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples: Option<usize>,
    /// What can be seen.
    pub counts: Counts,
    /// Errors on the poses that were used.
    pub fit: Option<BeforeAfter>,
    /// Errors on poses that were not.
    pub holdout: Option<BeforeAfter>,
    /// Errors on the poses that were used, each predicted without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cross_validation: Option<CrossValidationEntry>,
    /// Residual against the stated noise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub chi_square: Option<ChiSquare>,
    /// Deviations against the stated tolerances.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tolerance_factor: Option<ToleranceFactor>,
    /// Noise estimated from the residual, where none is stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_estimate: Option<NoiseDrawing>,
    /// What the samples of a posture have in common, estimated from them, where it is not stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub posture_noise_estimate: Option<PostureNoiseEntry>,
    /// What deserves attention, in words.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// Samples to which the path from home does not lead, where there are any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured_elsewhere: Option<ElsewhereEntry>,
    /// Samples that took no part.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub set_aside: Vec<SetAsideEntry>,
    /// Samples of the hold-out that are not scored.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub holdout_set_aside: Vec<SetAsideEntry>,
    /// Samples of weight 0, and how the calibrated machine predicts them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub unused: Vec<UnusedEntry>,
    /// Limits that hold with equality.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub active_bounds: Vec<ActiveBoundEntry>,
    /// KKT residual of the nonlinear problem, for constrained identifiers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kkt: Option<f64>,
    /// How much the estimate leans on the tolerances.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub estimate: Option<EstimateEntry>,
    /// Curve from which a regularisation weight was chosen.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub weights: Vec<WeightEntry>,
    /// Of the whitened Jacobian in tolerance-scaled coordinates at the solution, descending.
    #[serde(deserialize_with = "numbers")]
    pub singular_values: Vec<f64>,
    /// The way there.
    pub trace: Vec<TraceEntry>,
    /// Constants of the instrument.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub instrument: Vec<ConstantResult>,
    /// Where the machine stands in {S}, one motion for all limbs, where its base is free.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub placement: Option<MountResult>,
    /// How the tool is mounted, in the frame of the tool as drawn, where it is free.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tool_mounting: Option<MountResult>,
    /// Deviations from nominal.
    pub links: Vec<LinkResult>,
    /// The calibrated machine, as a problem states one.
    pub mechanism: MechanismDrawing,
    /// How well that machine is known, where linear theory applies.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uncertainty: Option<UncertaintyDrawing>,
    /// Of the programs that made this.
    pub versions: BTreeMap<String, String>,
}

/// Reads a result file.
pub fn read_result(path: &Path) -> Result<ResultFile, FileError> {
    let file = path.display().to_string();
    let bytes = json::read(path)?;
    let head: Head = json::parse(&file, &bytes)?;
    if head.format.as_str() != Some(RESULT_FORMAT) {
        let found = match head.format {
            Value::Null => "not stated".into(),
            other => quoted(&other.to_string()),
        };
        let at = Place::file(&file);
        return Err(at
            .key("format")
            .error(Fault::Format { found, expected: "\"format\": \"gough-result/1\"" }));
    }
    json::parse(&file, &bytes)
}

#[derive(Deserialize)]
struct Head {
    #[serde(default)]
    format: Value,
}
