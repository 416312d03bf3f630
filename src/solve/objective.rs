//! What an identifier minimises, stated so that others can check its result.

/// `sum loss(r_i) + ridge |x|^2 / 2 + lasso sum |x_i| + group sum |x_group|`, or with the prior below a signal-to-noise
/// ratio in place of the penalties, within limits; `x` in tolerances, `r` in standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Objective {
    /// Name of the loss ([`super::conic::loss::LOSSES`]).
    pub loss: &'static str,
    /// Threshold of Huber's loss, in standard deviations.
    pub delta: f64,
    /// Factor on `|x|^2 / 2`.
    pub ridge: f64,
    /// Factor on `sum |x_i|`.
    pub lasso: f64,
    /// Factor on the sum of the lengths of all groups.
    pub group: f64,
    /// Signal-to-noise ratio up to which directions have the full weight of the prior, whose rows count like those of
    /// the data; `None` where a penalty takes the prior's place.
    pub threshold: Option<f64>,
    /// Limit on every `|x_i|`, besides the problem's own bounds; infinite for none.
    pub bounds: f64,
    /// Limit on the length of every group; infinite for none.
    pub cone: f64,
}
