//! How an estimate leans on the tolerances, as the identifiers say it and as result files do.

use crate::files::summary::EstimateEntry;
use crate::solve::Estimate;

impl From<Estimate> for EstimateEntry {
    fn from(estimate: Estimate) -> Self {
        match estimate {
            Estimate::LeastSquares => Self::LeastSquares,
            Estimate::Split { threshold } => Self::Split(threshold),
            Estimate::Decoupled { threshold } => Self::Decoupled(threshold),
            Estimate::Ridge { weight } => Self::Ridge(weight),
            Estimate::Other => Self::Other,
        }
    }
}

impl From<EstimateEntry> for Estimate {
    fn from(entry: EstimateEntry) -> Self {
        match entry {
            EstimateEntry::LeastSquares => Self::LeastSquares,
            EstimateEntry::Split(threshold) => Self::Split { threshold },
            EstimateEntry::Decoupled(threshold) => Self::Decoupled { threshold },
            EstimateEntry::Ridge(weight) => Self::Ridge { weight },
            EstimateEntry::Other => Self::Other,
        }
    }
}
