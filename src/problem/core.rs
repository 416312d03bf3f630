//! What every identifier sees: residuals, their Jacobian, and parameters with names.
//!
//! A [`Problem`] is `min |r(x)|^2 / 2`. It knows no robot, no file and no terminal; a machine becomes a
//! problem in [`crate::calibration`], a regression in `examples/nist.rs`.

use crate::linalg;
use faer::Mat;
use std::ops::Range;

/// The coordinates and weights in which an identifier wants its problem.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Form {
    /// Whitened residuals; an orthonormal basis, in tolerance units, of the directions that are not
    /// redundant by structure (docs/theory.md section 6).
    #[default]
    Minimal,
    /// Whitened residuals; every component of every link deviation, in tolerance units.
    Complete,
    /// The paper's own form: unweighted spatial twists in rad and m, every component in rad and m.
    Plain,
}

/// One coordinate of `x`: what it is called, and what one unit of it means.
#[derive(Clone, Debug)]
pub struct Param {
    /// Name for people, such as `limb3.ball.1 translation y`.
    pub name: String,
    /// Unit of `scale`: `rad`, `m`, or empty for a mixed or dimensionless coordinate.
    pub unit: &'static str,
    /// Size of one unit of `x` in `unit` (the tolerance, where there is one).
    pub scale: f64,
    /// Hard limits on `x` itself, infinite where there are none.
    pub bounds: (f64, f64),
}

/// Coordinates that belong together (the deviation of one link), for group penalties and cones.
#[derive(Clone, Debug)]
pub struct Group {
    /// Name for people, such as `limb3.ball.1`.
    pub name: String,
    /// Indices into `x`.
    pub members: Vec<usize>,
}

impl Group {
    /// Euclidean length of the group's part of `x`.
    pub fn length(&self, x: &[f64]) -> f64 {
        self.members.iter().map(|&i| x[i] * x[i]).sum::<f64>().sqrt()
    }
}

/// Residual and Jacobian at one point, computed in one pass.
#[derive(Clone, Debug)]
pub struct Linearized {
    /// Residual, m.
    pub r: Vec<f64>,
    /// `dr/dx`, m x n.
    pub jac: Mat<f64>,
}

/// Square root of the Gauss-Newton model: `|jac dx + r|^2 + 2 cost - |r|^2 = |J dx + r_full|^2` for all `dx`.
#[derive(Clone, Debug)]
pub struct Compressed {
    /// `Q'r`, k <= n entries.
    pub r: Vec<f64>,
    /// `Q'J`, k x n with k <= n; not necessarily triangular.
    pub jac: Mat<f64>,
    /// `|r_full|^2 / 2`, the part that no step can reach included.
    pub cost: f64,
}

/// One description for all those that no residual tells apart: coordinates `z` of what is not redundant.
#[derive(Clone, Debug)]
pub struct Representative {
    /// Coordinates, k <= n, in an orthonormal basis of the complement of the redundancy at 0.
    pub z: Vec<f64>,
    /// `dz/dx`, k x n; zero along what is redundant at `x`.
    pub jac: Mat<f64>,
}

/// A problem on some of the coordinates alone.
pub struct Part<'a> {
    /// The problem.
    pub problem: Box<dyn Problem + 'a>,
    /// Which of the whole problem's coordinates are its own.
    pub members: Vec<usize>,
}

/// The point cannot be evaluated: which part of the problem failed, and why.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{0}")]
pub struct EvalError(pub String);

/// A nonlinear least-squares problem `min |r(x)|^2 / 2`.
///
/// Evaluation is pure: the same `x` gives the same bytes, whatever was asked before and on how many threads.
pub trait Problem: Sync {
    /// The coordinates, n.
    fn params(&self) -> &[Param];

    /// Coordinates that belong together; empty where the problem has no such structure.
    fn groups(&self) -> &[Group] {
        &[]
    }

    /// Whether `x` is measured in one-sigma tolerances about 0, so that `|x|^2` is a log prior.
    fn has_prior(&self) -> bool {
        false
    }

    /// Residual at `x` (n), m entries.
    fn residual(&self, x: &[f64]) -> Result<Vec<f64>, EvalError>;

    /// Residual and Jacobian at `x`, row by row.
    fn linearize(&self, x: &[f64]) -> Result<Linearized, EvalError>;

    /// Residual and Jacobian at `x`, compressed by orthogonal transformations to at most n rows.
    fn compress(&self, x: &[f64]) -> Result<Compressed, EvalError> {
        let lin = self.linearize(x)?;
        Ok(linalg::compress(&lin.jac, &lin.r))
    }

    /// Cost `|r|^2 / 2` and its gradient `J'r` at `x`.
    fn gradient(&self, x: &[f64]) -> Result<(f64, Vec<f64>), EvalError> {
        let lin = self.linearize(x)?;
        Ok((cost(&lin.r), linalg::mul_transpose(lin.jac.as_ref(), &lin.r)))
    }

    /// Rows that were measured together and share what is wrong with them: those of one sample, in order, one range
    /// each. Empty where every row stands for itself.
    fn blocks(&self) -> Vec<Range<usize>> {
        Vec::new()
    }

    /// How many of the last rows are a prior's instead of the data's.
    fn prior_rows(&self) -> usize {
        0
    }

    /// Problems on disjoint coordinates whose solutions together solve this one to first order, where it falls apart
    /// into such.
    fn parts(&self) -> Option<Vec<Part<'_>>> {
        None
    }

    /// The equivalent description of `x` that has nothing along the redundancy at 0; `None` where nothing is redundant.
    fn representative(&self, _x: &[f64]) -> Option<Representative> {
        None
    }

    /// Orthonormal basis (n x k) of the directions at `x` that no residual can see by structure; k may be 0.
    fn redundant(&self, x: &[f64]) -> Mat<f64> {
        Mat::zeros(x.len(), 0)
    }
}

/// Cost `|r|^2 / 2` of a residual.
pub fn cost(r: &[f64]) -> f64 {
    0.5 * r.iter().map(|v| v * v).sum::<f64>()
}
