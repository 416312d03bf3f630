//! The accuracy to expect of a plan before anything is measured (docs/theory.md (11.9)).

use super::information::{Information, ROWS, inverse};
use crate::identify::score::Spread;
use faer::Mat;

/// Standard errors of predicted poses over a workspace.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// Root of the expected squared displacement of the tool point, m.
    pub position: Spread,
    /// Root of the expected squared angle, rad.
    pub rotation: Spread,
}

/// Standard errors over the workspace with this information matrix; `None` where there is no workspace.
pub fn expected(info: &Information, information: &Mat<f64>) -> Option<Expected> {
    let covariance = inverse(information)?;
    let by = &info.twists * &covariance;
    let variance = |row: usize| {
        info.unseen[row] + (0..by.ncols()).map(|j| by[(row, j)] * info.twists[(row, j)]).sum::<f64>()
    };
    let part = |first: usize| {
        Spread::of((0..by.nrows() / ROWS).map(|posture| {
            let rows = ROWS * posture + first..ROWS * posture + first + 3;
            (1.0, rows.map(variance).sum::<f64>().max(0.0).sqrt())
        }))
    };
    Some(Expected { rotation: part(0)?, position: part(3)? })
}
