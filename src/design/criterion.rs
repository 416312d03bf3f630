//! What a set of postures is judged by (docs/theory.md (11.3)-(11.6)).

use super::information::{Information, ROWS, inverse, log_det};
use faer::{Mat, Side};

/// Exponent of the mean that stands in for the largest value, where a smooth function is needed.
const STEEP: f64 = 24.0;
/// Weight, relative to the largest, below which a case is left out of the mixture.
const NEGLIGIBLE: f64 = 1e-3;

/// Optimality of a set of postures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Criterion {
    /// Largest `log det(I + J'J)`: least volume of the ellipsoid of confidence.
    #[default]
    D,
    /// Least sum of the variances of the kept directions.
    A,
    /// Least variance of the worst combination of the kept directions.
    E,
    /// Least variance of a reading at the worst posture of the workspace.
    G,
}

/// A criterion at one information matrix `M`, and its derivative.
///
/// It is `log det M`, or `-tr(Q C)` with `C = M^-1` and a matrix `Q` that the worst case chooses; either way concave.
#[derive(Clone, Debug)]
pub struct View {
    /// A smooth value, to be as large as possible.
    pub value: f64,
    /// The value that `slope` belongs to: `log det M`, or `-tr(Q C)`. It differs from `value` where cases that hardly
    /// count are left out of `Q`.
    pub mixture: f64,
    /// `C = M^-1`.
    pub covariance: Mat<f64>,
    /// `dvalue/dM`: `C`, or `C Q C`.
    pub slope: Mat<f64>,
    /// Sum of the weights in `Q`, so that `-mixture / mass` is a mixture of variances; 1 for D.
    pub mass: f64,
    /// Half of the factor that the curvature `-tr(dM C dM slope)` has.
    pub bend: f64,
}

impl Criterion {
    /// All of them.
    pub const ALL: [Criterion; 4] = [Criterion::D, Criterion::A, Criterion::E, Criterion::G];

    /// Its letter.
    pub fn name(self) -> &'static str {
        match self {
            Criterion::D => "D",
            Criterion::A => "A",
            Criterion::E => "E",
            Criterion::G => "G",
        }
    }

    /// The criterion of this letter, large or small.
    pub fn find(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|criterion| criterion.name().eq_ignore_ascii_case(name))
    }

    /// Whether the gain of one more posture is known without looking for a new worst case.
    pub fn is_smooth(self) -> bool {
        matches!(self, Criterion::D | Criterion::A)
    }

    /// The criterion at `information`; `None` where that is not positive definite.
    pub fn view(self, info: &Information, information: &Mat<f64>) -> Option<View> {
        let covariance = inverse(information)?;
        if self == Criterion::D {
            let value = log_det(information)?;
            let slope = covariance.clone();
            return Some(View { value, mixture: value, slope, covariance, mass: 1.0, bend: 0.5 });
        }
        let worst = self.worst_case(info, &covariance)?;
        let slope = &covariance * &worst.root;
        let slope = &slope * slope.transpose();
        Some(View {
            value: -worst.value,
            mixture: -worst.mixture,
            covariance,
            slope,
            mass: worst.mass,
            bend: 1.0,
        })
    }

    /// The exact value, to be as large as possible: `log det`, or minus the worst variance.
    pub fn exact(self, info: &Information, information: &Mat<f64>) -> Option<f64> {
        match self {
            Criterion::D => log_det(information),
            _ => self.exact_at(info, &inverse(information)?),
        }
    }

    /// The exact value of A, E or G at this covariance.
    pub fn exact_at(self, info: &Information, covariance: &Mat<f64>) -> Option<f64> {
        let variances = match self {
            Criterion::D => return log_det(covariance).map(|value| -value),
            Criterion::A => {
                return Some(-kept(info).iter().map(|&i| variance(info, covariance, i)).sum::<f64>());
            }
            Criterion::E => kept_block(info, covariance).self_adjoint_eigenvalues(Side::Lower).ok()?,
            Criterion::G => workspace_variances(info, covariance),
        };
        variances.into_iter().reduce(f64::max).map(|worst| -worst)
    }

    /// The worst case at this covariance; all directions alike for D, which has none.
    pub fn worst_case(self, info: &Information, covariance: &Mat<f64>) -> Option<WorstCase> {
        let k = info.scale.len();
        match self {
            Criterion::D => {
                Some(WorstCase { value: 0.0, mixture: 0.0, root: Mat::identity(k, k), mass: 1.0 })
            }
            Criterion::A => {
                let index = kept(info);
                let root =
                    Mat::from_fn(k, index.len(), |i, j| if index[j] == i { info.scale[i] } else { 0.0 });
                let value = index.iter().map(|&i| variance(info, covariance, i)).sum();
                Some(WorstCase { value, mixture: value, root, mass: 1.0 })
            }
            Criterion::E => {
                let index = kept(info);
                let eigen = kept_block(info, covariance).self_adjoint_eigen(Side::Lower).ok()?;
                let values: Vec<f64> = eigen.S().column_vector().iter().copied().collect();
                let (value, weights) = steep_mean(&values);
                let some = counting(&weights);
                let mut root = Mat::zeros(k, some.len());
                for (column, &j) in some.iter().enumerate() {
                    for (row, &i) in index.iter().enumerate() {
                        root[(i, column)] = info.scale[i] * eigen.U()[(row, j)] * weights[j].sqrt();
                    }
                }
                Some(WorstCase::of(value, &values, &weights, &some, root))
            }
            Criterion::G => {
                let values = workspace_variances(info, covariance);
                let (value, weights) = steep_mean(&values);
                let some = counting(&weights);
                let mut root = Mat::zeros(k, ROWS * some.len());
                for (place, &posture) in some.iter().enumerate() {
                    let factor = weights[posture].sqrt();
                    for i in 0..k {
                        for row in 0..ROWS {
                            let seen = info.workspace[(ROWS * posture + row, i)];
                            root[(i, ROWS * place + row)] = factor * seen;
                        }
                    }
                }
                Some(WorstCase::of(value, &values, &weights, &some, root))
            }
        }
    }
}

/// A smooth upper bound of the worst variance, and which mixture of cases it is.
#[derive(Clone, Debug)]
pub struct WorstCase {
    /// The bound.
    pub value: f64,
    /// `tr(Q C)`: the bound without the cases that hardly count.
    pub mixture: f64,
    /// `Q = root root'`, the derivative of `mixture` by `C`.
    pub root: Mat<f64>,
    /// Sum of the weights in `Q`.
    pub mass: f64,
}

impl WorstCase {
    fn of(value: f64, values: &[f64], weights: &[f64], some: &[usize], root: Mat<f64>) -> Self {
        let sum = |of: &dyn Fn(usize) -> f64| some.iter().map(|&i| of(i)).sum::<f64>();
        Self { value, mixture: sum(&|i| weights[i] * values[i]), root, mass: sum(&|i| weights[i]) }
    }
}

/// Cases whose weight is not negligible beside the largest. Any mixture of cases proves a bound, so that leaving some out
/// is no error.
fn counting(weights: &[f64]) -> Vec<usize> {
    let largest = weights.iter().copied().fold(0.0, f64::max);
    (0..weights.len()).filter(|&i| weights[i] >= NEGLIGIBLE * largest).collect()
}

/// The p-norm `(sum v^p)^(1/p)`, at least the largest value, with its derivatives.
fn steep_mean(values: &[f64]) -> (f64, Vec<f64>) {
    let largest = values.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let share = |v: &f64| (v.max(0.0) / largest).powf(STEEP);
    let mean = largest * values.iter().map(share).sum::<f64>().powf(1.0 / STEEP);
    let weights = values.iter().map(|v| (v.max(0.0) / mean).powf(STEEP - 1.0)).collect();
    (mean, weights)
}

/// Coordinates that an average plan knows better than the tolerances; all of them where there are none such.
fn kept(info: &Information) -> Vec<usize> {
    let all = 0..info.scale.len();
    let some: Vec<usize> = all.clone().filter(|&i| info.is_kept(i)).collect();
    if some.is_empty() { all.collect() } else { some }
}

/// Variance of a direction, tolerances squared.
fn variance(info: &Information, covariance: &Mat<f64>, i: usize) -> f64 {
    covariance[(i, i)] * info.scale[i] * info.scale[i]
}

/// Covariance of the kept directions, tolerances squared.
pub fn kept_block(info: &Information, covariance: &Mat<f64>) -> Mat<f64> {
    let index = kept(info);
    Mat::from_fn(index.len(), index.len(), |i, j| {
        covariance[(index[i], index[j])] * info.scale[index[i]] * info.scale[index[j]]
    })
}

/// Sum of the variances of what is read, in units of the noise, for each posture of the workspace.
pub fn workspace_variances(info: &Information, covariance: &Mat<f64>) -> Vec<f64> {
    block_products(&info.workspace, &(&info.workspace * covariance))
}

/// For each posture, the scalar product of its rows in both matrices.
pub fn block_products(a: &Mat<f64>, b: &Mat<f64>) -> Vec<f64> {
    let mut sums = vec![0.0; a.nrows() / ROWS];
    for j in 0..a.ncols() {
        let blocks = a.col_as_slice(j).chunks_exact(ROWS).zip(b.col_as_slice(j).chunks_exact(ROWS));
        for (sum, (a, b)) in sums.iter_mut().zip(blocks) {
            *sum += a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        }
    }
    sums
}
