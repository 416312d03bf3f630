//! A machine and its measurements as a least-squares problem.

mod approach;
mod closing;
mod components;
pub mod coordinates;
mod elsewhere;
pub mod evaluate;
pub mod limbwise;
pub mod postures;
pub mod problem;
mod redundancy;
pub mod representative;
pub mod rows;
pub mod sample;
mod shared;
mod starts;
mod structural;
mod transforms;

pub use coordinates::{Coordinates, LimbCoordinates};
pub use elsewhere::are_apart;
pub use evaluate::PostureRows;
pub use postures::ByPosture;
pub use problem::Calibration;
pub use sample::{Postures, Sample, SetAside, close_at};
pub use starts::OtherPosture;
