//! Identifiers side by side: campaigns of runs on problems, scored by the problem.

pub mod bound;
pub mod campaign;
pub mod dependencies;
pub mod draw;
pub mod execute;
pub mod figures;
mod gain;
pub mod line;
pub mod machine;
pub mod objective;
pub mod offset;
pub mod profile;
pub mod publish;
pub mod run;
pub mod score;
pub mod store;
pub mod study;
pub mod tables;
pub mod tolerance;
pub mod watch;
