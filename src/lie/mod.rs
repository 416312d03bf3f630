//! The groups SO(3) and SE(3) with formulas that hold at zero, near pi and beyond.

mod columns;
pub mod se3;
pub mod so3;

pub use columns::Columns;
pub use se3::Se3;
