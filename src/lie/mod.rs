//! The groups SO(3) and SE(3) with formulas that hold at zero, near pi and beyond.

pub mod se3;
pub mod so3;

pub use se3::Se3;
