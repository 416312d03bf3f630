//! Whether data mean what they should: how far the drawing is from them, which usual mistake would explain it, and
//! what repeated measurements say of the noise.

mod alignment;
mod candidates;
pub mod comparison;
pub mod correction;
pub mod euler;
pub mod fit;
mod homes;
mod judge;
pub mod misfit;
mod observed;
mod prediction;
mod ranking;
pub mod reading;
pub mod repeats;
pub mod search;
mod turns;
mod words;

pub use comparison::{Compared, compared};
pub use correction::Correction;
pub use euler::Euler;
pub use fit::Fit;
pub use misfit::{Expected, expected, has_free_links, misfits};
pub use reading::Reading;
pub use repeats::{Repeats, repeats};
pub use search::{Finding, Verdict, corrected, search};
