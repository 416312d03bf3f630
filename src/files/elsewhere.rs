//! What a result says of postures that its machine closes elsewhere than along the path from home.

use serde::{Deserialize, Serialize};

/// How many there are.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ElsewhereEntry {
    /// Samples that the path from home does not lead to.
    pub samples: usize,
    /// Samples that took part.
    pub of: usize,
}
