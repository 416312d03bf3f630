//! What instruments report of a posture.

pub mod measurement;
pub mod pose;

pub use measurement::{Measurement, PoseError, Row, Weights};
pub use pose::{Pose, Weighting};
