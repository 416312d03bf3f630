//! Kinematic calibration of parallel and serial manipulators.

pub mod lie;
pub mod linalg;
pub mod problem;
pub mod solve;
