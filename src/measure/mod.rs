//! What instruments report of a posture.

pub mod measurement;
pub mod pose;

pub use measurement::{Measurement, Row};
pub use pose::Pose;
