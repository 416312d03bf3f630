//! Nonlinear least-squares problems: the side of the Jacobian core that identifiers see.

pub mod check;
pub mod core;

pub use core::{Compressed, EvalError, Form, Group, Linearized, Param, Problem, cost};
