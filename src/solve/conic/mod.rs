//! Identification as a sequence of conic programs (docs/theory.md section 9): a loss, penalties and limits, each in
//! a file of its own, composed into one step and solved by clarabel.

pub mod arrival;
pub mod bounds;
pub mod chebyshev;
pub mod cones;
pub mod curvature;
pub mod descent;
pub mod faces;
pub mod group_lasso;
pub mod here;
pub mod huber;
pub mod identifier;
pub mod kinks;
pub mod kkt;
pub mod lasso;
pub mod least_squares;
pub mod limits;
pub mod loss;
pub mod options;
pub mod penalty;
pub mod polish;
pub mod program;
pub mod restore;
pub mod ridge;
pub mod step;
pub mod tips;
pub mod trust;
pub mod weight;

pub use identifier::Conic;
