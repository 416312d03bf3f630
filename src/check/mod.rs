//! Whether data mean what they should: how far the drawing is from them, which usual mistake would explain it, and
//! what repeated measurements say of the noise.

pub mod comparison;
pub mod correction;
pub mod misfit;
pub mod offsets;
pub mod repeats;
pub mod search;

pub use comparison::{Compared, compared};
pub use correction::Correction;
pub use misfit::{Expected, Reading, expected, has_free_links, misfits};
pub use repeats::{Repeats, repeats};
pub use search::{Finding, corrected, search};
