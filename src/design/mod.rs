//! Which postures to measure: observability, optimal designs, and what accuracy to expect of them.

pub mod accuracy;
pub mod candidates;
pub mod criterion;
pub mod exchange;
pub mod information;
pub mod observability;
pub mod order;
pub mod plan;
pub mod reach;
pub mod relaxation;

pub use accuracy::{Expected, expected};
pub use candidates::{Candidate, Candidates, DesignError, Unfit};
pub use criterion::Criterion;
pub use information::{Information, Instrument};
pub use observability::Observability;
pub use plan::{Plan, Settings, plan};
pub use reach::{Reached, ReachedPlan, RealMachines, Request, reached_plan};
