//! What a set of postures is judged by (docs/theory.md (11.3)-(11.6)).

use super::information::{Information, ROWS, inverse, log_det};
use faer::{Mat, Side};

/// Exponent of the mean that stands in for the largest value, where a smooth function is needed.
const STEEP: f64 = 24.0;

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
/// It is `log det M`, or `-tr(L C)` with `C = M^-1` and a matrix `L` that the worst case chooses; either way concave.
#[derive(Clone, Debug)]
pub struct View {
    /// A smooth value, to be as large as possible.
    pub value: f64,
    /// `C = M^-1`.
    pub covariance: Mat<f64>,
    /// `dvalue/dM`: `C`, or `C L C`.
    pub slope: Mat<f64>,
    /// Sum of the weights in `L`, so that `-value / mass` is a mixture of variances; 1 for D.
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
            return Some(View { value, slope: covariance.clone(), covariance, mass: 1.0, bend: 0.5 });
        }
        let (value, chosen, mass) = self.worst_case(info, &covariance)?;
        let slope = &covariance * chosen * &covariance;
        Some(View { value: -value, covariance, slope, mass, bend: 1.0 })
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

    /// `C L C` at the covariance `C`, with the present worst case `L`; `C` itself for D.
    pub fn slope_at(self, info: &Information, covariance: &Mat<f64>) -> Option<Mat<f64>> {
        if self == Criterion::D {
            return Some(covariance.clone());
        }
        let (_, chosen, _) = self.worst_case(info, covariance)?;
        Some(covariance * chosen * covariance)
    }

    /// A smooth upper bound of the worst variance, the matrix `L` with its derivative `dvalue = tr(L dC)`, and the sum
    /// of weights in it.
    fn worst_case(self, info: &Information, covariance: &Mat<f64>) -> Option<(f64, Mat<f64>, f64)> {
        let k = info.scale.len();
        match self {
            Criterion::D | Criterion::A => {
                let mut chosen = Mat::zeros(k, k);
                for i in kept(info) {
                    chosen[(i, i)] = info.scale[i] * info.scale[i];
                }
                let value = kept(info).iter().map(|&i| variance(info, covariance, i)).sum();
                Some((value, chosen, 1.0))
            }
            Criterion::E => {
                let index = kept(info);
                let eigen = kept_block(info, covariance).self_adjoint_eigen(Side::Lower).ok()?;
                let values: Vec<f64> = eigen.S().column_vector().iter().copied().collect();
                let (value, weights) = steep_mean(&values);
                let vectors =
                    Mat::from_fn(k, values.len(), |i, j| match index.iter().position(|&at| at == i) {
                        Some(row) => info.scale[i] * eigen.U()[(row, j)] * weights[j].sqrt(),
                        None => 0.0,
                    });
                Some((value, &vectors * vectors.transpose(), weights.iter().sum()))
            }
            Criterion::G => {
                let (value, weights) = steep_mean(&workspace_variances(info, covariance));
                let rows = Mat::from_fn(info.workspace.nrows(), k, |i, j| {
                    weights[i / ROWS].sqrt() * info.workspace[(i, j)]
                });
                Some((value, rows.transpose() * &rows, weights.iter().sum()))
            }
        }
    }
}

/// The p-mean `(sum v^p)^(1/p)`, at least the largest value, with its derivatives.
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
    let some: Vec<usize> = all.clone().filter(|&i| info.scale[i] * info.scale[i] < 0.5).collect();
    if some.is_empty() { all.collect() } else { some }
}

/// Variance of a direction, tolerances squared.
fn variance(info: &Information, covariance: &Mat<f64>, i: usize) -> f64 {
    covariance[(i, i)] * info.scale[i] * info.scale[i]
}

fn kept_block(info: &Information, covariance: &Mat<f64>) -> Mat<f64> {
    let index = kept(info);
    Mat::from_fn(index.len(), index.len(), |i, j| {
        covariance[(index[i], index[j])] * info.scale[index[i]] * info.scale[index[j]]
    })
}

/// Sum of the variances of a predicted pose in units of the noise, for each posture of the workspace.
fn workspace_variances(info: &Information, covariance: &Mat<f64>) -> Vec<f64> {
    block_products(&info.workspace, &(&info.workspace * covariance))
}

/// For each posture, the scalar product of its rows in both matrices.
pub fn block_products(a: &Mat<f64>, b: &Mat<f64>) -> Vec<f64> {
    let mut sums = vec![0.0; a.nrows() / ROWS];
    for j in 0..a.ncols() {
        for (i, (a, b)) in a.col(j).iter().zip(b.col(j).iter()).enumerate() {
            sums[i / ROWS] += a * b;
        }
    }
    sums
}
