//! From measurements to a calibrated machine: registration, identification, scores and counts.

pub mod counts;
pub mod noise;
mod references;
pub mod registration;
pub mod residuals;
pub mod run;
pub mod score;
mod targets;
pub mod uncertainty;

pub use counts::{Counts, Visibility};
pub use noise::{NoiseEstimate, identify_without_noise};
pub use run::{Identification, IdentifyError, identify, identify_from};
pub use score::Fit;
