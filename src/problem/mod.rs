//! Nonlinear least-squares problems: the side of the Jacobian core that identifiers see.

pub mod check;
pub mod core;
pub mod dual;
pub mod formula;

pub use core::{Compressed, EvalError, Form, Group, Linearized, Param, Part, Problem, Representative, cost};
pub use dual::Dual;
pub use formula::Formula;
