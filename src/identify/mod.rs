//! From measurements to a calibrated machine: registration, identification, scores and counts.

pub mod analysis;
pub mod common_axis;
pub mod counts;
pub mod covariance;
pub mod cross_validation;
pub mod directions;
mod ends;
pub mod noise;
pub mod outliers;
mod references;
pub mod registration;
pub mod residuals;
mod rounds;
pub mod run;
pub mod score;
pub mod singularities;
pub mod sparse;
pub mod spread;
mod targets;
pub mod twists;
pub mod uncertainty;
pub mod untold;
pub mod verdict;

pub use analysis::{Analysis, PostureInformation, analyze};
pub use counts::{Counts, Visibility};
pub use covariance::{Covariance, Variance};
pub use cross_validation::{CrossValidation, Folds, cross_validate};
pub use directions::{Direction, Likeness};
pub use noise::{NoiseEstimate, identify_without_noise};
pub use registration::Registration;
pub use run::{Identification, IdentifyError, identify, identify_from};
pub use score::Fit;
pub use uncertainty::{LinkRoot, PoseCovariance, pose_covariances};
pub use verdict::{ChiSquareTest, Judged, Judgement, judge};
