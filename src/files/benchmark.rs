//! Why a problem is in a benchmark set, and how its data are drawn there.

use super::error::FileError;
use super::fault::Fault;
use super::place::Place;
use serde::{Deserialize, Serialize};

/// What a benchmark problem says of itself. Comparisons draw their data by it; `identify` does not look at it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BenchmarkDrawing {
    /// Why it is there, in a sentence.
    pub purpose: String,
    /// What it stresses, in a few words each.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stresses: Vec<String>,
    /// Postures drawn for a run; as many as the problem's own, or 60, where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub poses: Option<usize>,
    /// Factor on the tolerances from which the truth is drawn; 1 where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distance: Option<f64>,
    /// Start in tolerances from nominal, where the command line does not say; 0 where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start: Option<f64>,
    /// Number of links that deviate in the truth; all where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub links_off: Option<usize>,
    /// Gross errors, of which the instrument does not know.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outliers: Option<OutliersDrawing>,
    /// What comes out on the problem's own data.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference: Option<ReferenceDrawing>,
}

/// Gross errors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutliersDrawing {
    /// Share of the poses, between 0 and 1; one pose at least.
    pub share: f64,
    /// Size, in standard deviations of the noise.
    pub factor: f64,
}

/// Outcome of an identification of the problem's own data, in units of the file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReferenceDrawing {
    /// The identifier.
    pub solver: String,
    /// Root mean square position error on the hold-out.
    pub position_rms: f64,
    /// Root mean square rotation error on the hold-out, where that has rotations.
    pub rotation_rms: Option<f64>,
    /// Practical count.
    pub practical: usize,
}

impl BenchmarkDrawing {
    pub(super) fn check(&self, at: &Place<'_>) -> Result<(), FileError> {
        let at_least = |key: &'static str, value: Option<f64>, least: f64| match value {
            Some(v) if !(v.is_finite() && v >= least) => {
                Err(at.key(key).error(Fault::BenchmarkNumber { found: v, least }))
            }
            _ => Ok(()),
        };
        at_least("distance", self.distance, 0.0)?;
        at_least("start", self.start, 0.0)?;
        at_least("poses", self.poses.map(|n| n as f64), 1.0)?;
        at_least("outliers.share", self.outliers.map(|o| o.share), 0.0)?;
        at_least("outliers.share", self.outliers.map(|o| 1.0 - o.share), 0.0)?;
        at_least("outliers.factor", self.outliers.map(|o| o.factor), 0.0)
    }
}
