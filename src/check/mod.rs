//! Whether data mean what they should: how far the drawing is from them, which usual mistake would explain it, and
//! what repeated measurements say of the noise.

pub mod correction;
pub mod misfit;
pub mod offsets;
pub mod repeats;
pub mod search;

pub use correction::Correction;
pub use misfit::{Reading, expected, misfits};
pub use repeats::{Repeats, repeats};
pub use search::{Finding, search};
