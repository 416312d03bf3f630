//! Kinematic calibration of parallel and serial manipulators.

pub mod calibration;
pub mod cli;
pub mod files;
pub mod identify;
pub mod lie;
pub mod linalg;
pub mod measure;
pub mod model;
pub mod problem;
pub mod simulate;
pub mod solve;
