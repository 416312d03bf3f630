//! Which directions of the coordinates are left to the data, and the steps that follow.

use crate::linalg::{self, inverse_norm, upper_factor};
use crate::problem::Compressed;
use faer::Mat;

/// Singular value, relative to the threshold, above which the prior has no weight left.
pub(super) const FADED: f64 = 10.0;

/// A number of rows that factorises fastest, `rows` or a few more.
fn in_fours(rows: usize) -> usize {
    rows.next_multiple_of(4)
}

/// Directions on which the prior stands, and its weight on each; everything orthogonal to them is the data's.
///
/// The weight is 1 up to the threshold and fades to 0 at ten times it. A hard edge would leave directions of a
/// signal-to-noise ratio of barely 1 to the data alone; there the cost is as good as flat, its curvature beyond
/// first order decides, and the iteration drifts for hundreds of steps that mean nothing.
#[derive(Clone, Debug)]
pub struct Split {
    /// Orthonormal columns times the square root of the weight, n x m.
    anchors: Mat<f64>,
    kept: Option<usize>,
    /// Whether the prior holds `x` near 0 there; else the step just leaves these directions alone.
    prior: bool,
}

impl Split {
    /// The prior with this weight on all of `n` coordinates.
    pub fn ridge(n: usize, weight: f64) -> Self {
        let anchors = Mat::from_fn(n, n, |i, j| if i == j { weight.sqrt() } else { 0.0 });
        Self { anchors, kept: None, prior: true }
    }

    /// Splits the coordinates at the singular value `threshold` of the Jacobian, of which `factor` is a square factor in
    /// its first n columns; `None` where it is not finite.
    ///
    /// The singular value decomposition is skipped where the inverse of the triangular factor already proves that
    /// every singular value is above the threshold (`s_min >= 1 / |R^-1|_F`).
    fn at(here: &Compressed, factor: &Mat<f64>, threshold: f64, prior: bool) -> Option<Self> {
        let n = here.jac.ncols();
        if !here.jac.is_all_finite() {
            return None;
        }
        if inverse_norm(factor, n) * threshold * FADED < 1.0 {
            return Some(Self { anchors: Mat::zeros(n, 0), kept: Some(n), prior });
        }
        let svd = linalg::svd(here.jac.as_ref())?;
        let strong = svd.s.iter().filter(|s| **s >= threshold * FADED).count();
        let mut anchors = svd.v.get(.., strong..).to_owned();
        for (column, s) in svd.s[strong..].iter().enumerate() {
            let root = prior_weight(s / threshold).sqrt();
            anchors.as_mut().col_mut(column).iter_mut().for_each(|v| *v *= root);
        }
        Some(Self { anchors, kept: Some(svd.s.iter().filter(|s| **s > threshold).count()), prior })
    }

    /// Number of directions whose singular value is above the threshold; `None` of a ridge.
    pub fn kept(&self) -> Option<usize> {
        self.kept
    }

    /// `|P x|^2 / 2` with the prior's weights, 0 without a prior.
    pub fn penalty(&self, x: &[f64]) -> f64 {
        if !self.prior {
            return 0.0;
        }
        0.5 * linalg::mul_transpose(self.anchors.as_ref(), x).iter().map(|a| a * a).sum::<f64>()
    }

    /// Triangular factor of the first n rows of `factor` (n + 1 columns) and those of the prior at `x`; it, too, may have
    /// rows behind these.
    fn stacked(&self, factor: Mat<f64>, x: &[f64]) -> Mat<f64> {
        let (n, m) = (x.len(), self.anchors.ncols());
        if m == 0 {
            return factor;
        }
        let mut rows = Mat::<f64>::zeros(in_fours(n + m), n + 1);
        rows.as_mut().submatrix_mut(0, 0, n, n + 1).copy_from(factor.get(..n, ..));
        rows.as_mut().submatrix_mut(n, 0, m, n).copy_from(self.anchors.transpose());
        if self.prior {
            for (i, along) in linalg::mul_transpose(self.anchors.as_ref(), x).iter().enumerate() {
                rows[(n + i, n)] = -along;
            }
        }
        upper_factor(rows.as_mut())
    }

    /// Gradient of [`penalty`](Self::penalty).
    pub(super) fn pull(&self, x: &[f64]) -> Vec<f64> {
        if !self.prior {
            return vec![0.0; x.len()];
        }
        linalg::mul(self.anchors.as_ref(), &linalg::mul_transpose(self.anchors.as_ref(), x))
    }
}

/// Triangular factor of the Gauss-Newton model `|J dx + r|^2 + |P (x + dx)|^2`, kept while steps are small.
pub struct Model {
    /// The split under which it was made.
    pub split: Split,
    /// `[R, Q'(-r)]` of the stacked rows: n rows, or some more that mean nothing, n + 1 columns.
    factor: Mat<f64>,
    /// Column norms of the Jacobian, in which damping is measured without a prior.
    scale: Vec<f64>,
    /// Whether the weak directions have the curvature of the merit itself.
    bent: bool,
}

impl Model {
    /// The model at `x`, under the split `settled` or, without one, under that of the Jacobian at `threshold`; `None`
    /// where the Jacobian is not finite.
    pub fn at(
        here: &Compressed,
        x: &[f64],
        threshold: f64,
        prior: bool,
        settled: Option<Split>,
    ) -> Option<Self> {
        let (k, n) = (here.jac.nrows(), x.len());
        // Rows of zeros make the factor square where there are fewer residuals than parameters.
        let mut rows = Mat::<f64>::zeros(in_fours(k.max(n)), n + 1);
        rows.as_mut().submatrix_mut(0, 0, k, n).copy_from(&here.jac);
        for i in 0..k {
            rows[(i, n)] = -here.r[i];
        }
        let factor = upper_factor(rows.as_mut());
        let split = match settled {
            Some(split) => split,
            None => Split::at(here, &factor, threshold, prior)?,
        };
        let some = |norm: f64| if norm > 0.0 { norm } else { 1.0 };
        let scale = match prior {
            true => vec![1.0; n],
            false => (0..n).map(|j| some(here.jac.col(j).norm_l2())).collect(),
        };
        Some(Self { factor: split.stacked(factor, x), split, scale, bent: false })
    }

    /// The same model where the directions `weak` (orthonormal columns) have the curvature `bend'bend` and what is
    /// orthogonal to them the rows `strong`.
    pub fn bent(self, strong: &Mat<f64>, weak: &Mat<f64>, bend: &Mat<f64>) -> Self {
        let n = self.scale.len();
        let of_prior = self.split.anchors.transpose();
        let of_prior = of_prior - (of_prior * weak) * weak.transpose();
        let bend = bend * weak.transpose();
        let (k, m) = (strong.nrows(), of_prior.nrows());
        let mut rows = Mat::<f64>::zeros(in_fours((k + m + bend.nrows()).max(n)), n + 1);
        rows.as_mut().submatrix_mut(0, 0, k, n).copy_from(strong);
        rows.as_mut().submatrix_mut(k, 0, m, n).copy_from(&of_prior);
        rows.as_mut().submatrix_mut(k + m, 0, bend.nrows(), n).copy_from(&bend);
        Self { factor: upper_factor(rows.as_mut()), bent: true, ..self }
    }

    /// Whether the weak directions have the curvature of the merit itself; such a model has no
    /// [`fresh_step`](Self::fresh_step).
    pub fn is_bent(&self) -> bool {
        self.bent
    }

    /// The step at the point where the model was made, damped by `damping |D dx|^2`.
    pub fn fresh_step(&self, damping: f64) -> Option<Vec<f64>> {
        let n = self.scale.len();
        if damping == 0.0 {
            return solved(&self.factor, n);
        }
        solved(&self.damped(damping), n)
    }

    /// The step at another point `x`, where the gradient of the cost is `gradient`: the exact gradient with the
    /// curvature of the point where the model was made (semi-normal equations).
    pub fn stale_step(&self, x: &[f64], gradient: &[f64], damping: f64) -> Option<Vec<f64>> {
        let mut z: Vec<f64> = gradient.iter().zip(self.split.pull(x)).map(|(g, pull)| -(g + pull)).collect();
        let damped = (damping > 0.0).then(|| self.damped(damping));
        let factor = damped.as_ref().unwrap_or(&self.factor);
        linalg::solve_upper_transpose(factor, &mut z)?;
        linalg::solve_upper(factor, &mut z)?;
        Some(z)
    }

    /// Reduction of the merit that the model promises of `dx`, given the merit's gradient at the point.
    pub fn promise(&self, x: &[f64], gradient: &[f64], dx: &[f64]) -> f64 {
        let n = dx.len();
        let pull = self.split.pull(x);
        let slope: f64 = gradient.iter().zip(&pull).zip(dx).map(|((g, p), d)| (g + p) * d).sum();
        let curved = linalg::mul(self.factor.get(..n, ..n), dx);
        -slope - 0.5 * curved.iter().map(|v| v * v).sum::<f64>()
    }

    fn damped(&self, damping: f64) -> Mat<f64> {
        let n = self.scale.len();
        let mut rows = Mat::<f64>::zeros(in_fours(2 * n), n + 1);
        rows.as_mut().submatrix_mut(0, 0, n, n + 1).copy_from(self.factor.get(..n, ..));
        for (j, scale) in self.scale.iter().enumerate() {
            rows[(n + j, j)] = damping.sqrt() * scale;
        }
        upper_factor(rows.as_mut())
    }
}

/// Weight of the prior on a direction whose singular value is `s` thresholds: `(1/s^2 - 1/100) / 0.99` between 1
/// and 10.
pub fn prior_weight(s: f64) -> f64 {
    let edge = FADED.powi(-2);
    ((s.max(1.0).powi(-2) - edge) / (1.0 - edge)).max(0.0)
}

/// Solution of the triangular system whose right-hand side is column n of `factor`.
fn solved(factor: &Mat<f64>, n: usize) -> Option<Vec<f64>> {
    let mut z: Vec<f64> = (0..n).map(|i| factor[(i, n)]).collect();
    linalg::solve_upper(factor, &mut z)?;
    Some(z)
}
