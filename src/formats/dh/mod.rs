//! Denavit-Hartenberg tables: CSV with a row a joint.
//!
//! A row is two screws: `theta` about and `d` along z, `a` along and `alpha` about x. The standard convention (Denavit
//! & Hartenberg, J. Applied Mechanics 22, 1955; Paul 1981) takes z first, the modified one (Craig, Introduction to
//! Robotics, 1986) x first. A revolute joint (R) adds its reading to `theta`, a prismatic one (P) to `d`, a fixed row
//! (F) has none: two fixed rows, at base and tool, let a table describe any serial chain.

mod read;
mod row;
mod write;

pub use read::read;
pub use row::{Convention, Row, RowKind};
pub use write::{Table, table};
