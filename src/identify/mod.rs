//! From measurements to a calibrated machine: registration, identification, scores and counts.

pub mod counts;
pub mod covariance;
pub mod cross_validation;
pub mod noise;
pub mod registration;
pub mod residual;
pub mod run;
pub mod score;
pub mod uncertainty;

pub use counts::{Counts, Visibility};
pub use covariance::{Covariance, Variance};
pub use cross_validation::{CrossValidation, Folds, cross_validate};
pub use noise::{NoiseEstimate, identify_without_noise};
pub use residual::{ChiSquareTest, Verdict};
pub use run::{Identification, IdentifyError, identify};
pub use score::Fit;
pub use uncertainty::{LinkRoot, PoseCovariance, pose_covariances};
