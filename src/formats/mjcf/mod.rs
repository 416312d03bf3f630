//! MJCF, MuJoCo's model format (<https://mujoco.readthedocs.io/en/stable/XMLreference.html>): nested bodies with joints,
//! loops closed by `equality` constraints, read where they reduce to limbs between base and platform.

mod classes;
mod drawing;
mod graph;
mod limbs;
mod model;
mod orientation;
mod ties;

pub use drawing::{Request, read};
