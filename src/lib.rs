//! Kinematic calibration of parallel and serial manipulators.

pub mod linalg;
pub mod problem;
pub mod solve;
