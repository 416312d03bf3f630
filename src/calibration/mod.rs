//! A machine and its measurements as a least-squares problem.

pub mod coordinates;
pub mod limbwise;
pub mod problem;
pub mod rows;
pub mod sample;

pub use coordinates::{Coordinates, LimbCoordinates};
pub use problem::Calibration;
pub use sample::{Sample, SetAside};
