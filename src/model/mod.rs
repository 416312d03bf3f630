//! Mechanisms: limbs of joints between base and platform, and the postures in which their loops close.

pub mod closure;
pub mod command;
pub mod far;
pub mod instrument;
pub mod inverse;
pub mod joint;
pub mod limb;
pub mod mechanism;
pub mod mobility;
pub mod passive;
pub mod posture;

pub use closure::NotClosed;
pub use instrument::{Constant, Quantity};
pub use joint::{Joint, Motion};
pub use limb::{Limb, Link, Prior, Tolerance};
pub use mechanism::{Ends, Geometry, Mechanism};
pub use posture::{Posture, Turn};
