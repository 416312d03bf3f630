//! A mechanism as files draw it: lines in {S} at home, in units of the file.

use super::pose::PoseDrawing;
use super::tolerance::{BoundsDrawing, ToleranceDrawing};
use super::values::{OneOrEach, RangeDrawing};
use serde::{Deserialize, Serialize};

/// A mechanism.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MechanismDrawing {
    /// Pose of {T} in {S} with all joints at home.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tool: Option<PoseDrawing>,
    /// Of every link that nothing nearer governs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tolerance: Option<ToleranceDrawing>,
    /// Of the last link of each limb.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tool_tolerance: Option<ToleranceDrawing>,
    /// Of every link that nothing nearer governs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bounds: Option<BoundsDrawing>,
    /// Of the last link of each limb.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tool_bounds: Option<BoundsDrawing>,
    /// Of one rigid motion in front of every first link: where the whole machine stands in {S}.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub placement: Option<ToleranceDrawing>,
    /// Of one rigid motion behind every last link: how the tool is mounted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tool_mounting: Option<ToleranceDrawing>,
    /// The limbs.
    pub limbs: Vec<LimbDrawing>,
}

/// A limb.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LimbDrawing {
    /// `limb1`, `limb2`... where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Where this limb puts {T} at home; the mechanism's where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tool: Option<PoseDrawing>,
    /// Of the limb's links.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tolerance: Option<ToleranceDrawing>,
    /// Of its last link.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tool_tolerance: Option<ToleranceDrawing>,
    /// Of the limb's links.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bounds: Option<BoundsDrawing>,
    /// Of its last link.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tool_bounds: Option<BoundsDrawing>,
    /// From base to platform.
    pub joints: Vec<JointDrawing>,
}

/// A joint of one or more degrees of freedom.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointDrawing {
    /// `j1`, `j2`... where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// One of [`crate::model::joint::KINDS`].
    #[serde(rename = "type")]
    pub kind: String,
    /// A point of every axis, length of the file.
    pub point: [f64; 3],
    /// Direction, any length but zero.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axis: Option<[f64; 3]>,
    /// Directions in chain order, any length but zero.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axes: Option<Vec<[f64; 3]>>,
    /// Advance per revolution of a helical joint, length of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pitch: Option<f64>,
    /// Commanded or sensed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub actuated: Option<OneOrEach<bool>>,
    /// Reading at home, angle or length of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub home: Option<OneOrEach<f64>>,
    /// Readings between which the joint is used, angle or length of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub range: Option<RangeDrawing>,
    /// Of the link before the first axis.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tolerance: Option<ToleranceDrawing>,
    /// Of the links between the axes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inner_tolerance: Option<ToleranceDrawing>,
    /// Of the link before the first axis.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bounds: Option<BoundsDrawing>,
    /// Of the links between the axes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inner_bounds: Option<BoundsDrawing>,
}
