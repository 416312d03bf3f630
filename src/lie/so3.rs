//! Rotations: exponential, logarithm and left Jacobian (docs/theory.md (1.1)-(1.4)).
//!
//! Each coefficient has a power series where its closed form cancels; the switch lies where both are good to
//! a few units in the last place.

use nalgebra::{Matrix3, Vector3};

/// Cross-product matrix: `hat(a) b = a x b`.
pub fn hat(a: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -a.z, a.y, a.z, 0.0, -a.x, -a.y, a.x, 0.0)
}

/// `sin t / t` and `(1 - cos t) / t^2`, for t >= 0.
fn exp_coefficients(t: f64) -> (f64, f64) {
    if t < 1e-4 {
        let t2 = t * t;
        return (1.0 - t2 / 6.0, 0.5 - t2 / 24.0);
    }
    let half = (0.5 * t).sin() / (0.5 * t);
    (t.sin() / t, 0.5 * half * half)
}

/// `(t - sin t) / t^3`, for t >= 0.
pub(crate) fn a3(t: f64) -> f64 {
    if t > 2.0 {
        return (t - t.sin()) / (t * t * t);
    }
    alternating(t * t, 3, |_| 1.0)
}

/// `sum_k (-1)^k weight(k) t2^k / (2k + first)!`, to rounding for t2 <= 6.25.
pub(crate) fn alternating(t2: f64, first: u32, weight: fn(f64) -> f64) -> f64 {
    let mut factor = 1.0 / (1..=first).map(f64::from).product::<f64>();
    let mut sum = 0.0;
    for k in 0..16_u32 {
        sum += factor * weight(f64::from(k));
        factor *= -t2 / (f64::from(2 * k + first + 1) * f64::from(2 * k + first + 2));
    }
    sum
}

/// Rotation matrix of the rotation vector `w`, rad.
pub fn exp(w: &Vector3<f64>) -> Matrix3<f64> {
    let (a1, a2) = exp_coefficients(w.norm());
    let wx = hat(w);
    Matrix3::identity() + wx * a1 + wx * wx * a2
}

/// Iterations of a decomposition of 3 x 3.
const DECOMPOSED: usize = 100;

/// A rotation, and how well the matrix to which it is nearest determines it.
#[derive(Clone, Copy, Debug)]
pub struct Nearest {
    /// The rotation `R` that maximises `tr(R' sum)`; where two singular values vanish, one of those that do.
    pub rotation: Matrix3<f64>,
    /// Ratio of the second singular value of `sum` to the first: 0 where one axis, or none, determines the rotation.
    pub sharpness: f64,
}

/// The rotation nearest to `sum` (Kabsch, Acta Crystallographica A 32, 1976); `None` where `sum` is not finite.
pub fn nearest(sum: &Matrix3<f64>) -> Option<Nearest> {
    if !sum.iter().all(|v| v.is_finite()) {
        return None;
    }
    let svd = sum.try_svd(true, true, f64::EPSILON, DECOMPOSED)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    let mut s: [f64; 3] = svd.singular_values.into();
    s.sort_by(|a, b| b.total_cmp(a));
    let mut flip = Matrix3::identity();
    let smallest = svd.singular_values.argmin().0;
    flip[(smallest, smallest)] = (u * v_t).determinant().signum();
    let sharpness = if s[0] > 0.0 { s[1] / s[0] } else { 0.0 };
    Some(Nearest { rotation: u * flip * v_t, sharpness })
}

/// Rotation vector of `r`, rad, of length at most pi.
///
/// Goes through the quaternion by its largest component, so that neither 0 nor pi is special. NaN if `r`
/// is not finite.
pub fn log(r: &Matrix3<f64>) -> Vector3<f64> {
    if !r.sum().is_finite() {
        // An infinite scalar part would pass for the identity below.
        return Vector3::repeat(f64::NAN);
    }
    let trace = r.trace();
    let off = Vector3::new(r[(2, 1)] - r[(1, 2)], r[(0, 2)] - r[(2, 0)], r[(1, 0)] - r[(0, 1)]);
    // Four times the quaternion's largest component times (scalar, vector).
    let (mut scalar, mut vector) = if trace >= 0.0 {
        (1.0 + trace, off)
    } else {
        let i = r.diagonal().imax();
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        let mut vector = Vector3::zeros();
        vector[i] = 1.0 + r[(i, i)] - r[(j, j)] - r[(k, k)];
        vector[j] = r[(j, i)] + r[(i, j)];
        vector[k] = r[(k, i)] + r[(i, k)];
        (off[i], vector)
    };
    if scalar < 0.0 {
        scalar = -scalar;
        vector = -vector;
    }
    let n = vector.norm();
    if n < 0.02 * scalar {
        // atan(q) / q, to rounding.
        let q2 = (n / scalar) * (n / scalar);
        let (low, high) = (1.0 - q2 / 3.0, 1.0 / 5.0 - q2 / 7.0);
        return vector * (2.0 / scalar * (low + q2 * q2 * (high + q2 * q2 * (1.0 / 9.0 - q2 / 11.0))));
    }
    vector * (2.0 * n.atan2(scalar) / n)
}

/// Left Jacobian `Jl` with `d exp(w) exp(-w) = hat(Jl dw)`.
pub fn left_jacobian(w: &Vector3<f64>) -> Matrix3<f64> {
    let t = w.norm();
    let wx = hat(w);
    Matrix3::identity() + wx * exp_coefficients(t).1 + wx * wx * a3(t)
}

/// Inverse of [`left_jacobian`]; singular at |w| = 2 pi.
pub fn left_jacobian_inverse(w: &Vector3<f64>) -> Matrix3<f64> {
    // hat(w)^2 = w w' - |w|^2
    let c = cot_coefficient(w.norm_squared());
    let (x, y, z) = (0.5 * w.x, 0.5 * w.y, 0.5 * w.z);
    let (xx, yy, zz) = (c * w.x * w.x, c * w.y * w.y, c * w.z * w.z);
    let (xy, xz, yz) = (c * w.x * w.y, c * w.x * w.z, c * w.y * w.z);
    Matrix3::new(
        1.0 - (yy + zz),
        xy + z,
        xz - y,
        xy - z,
        1.0 - (xx + zz),
        yz + x,
        xz + y,
        yz - x,
        1.0 - (xx + yy),
    )
}

/// `(1 - (t/2) cot(t/2)) / t^2` of `t2 = t^2`, whose series has the Bernoulli numbers `|B_2k| / (2k)!`.
fn cot_coefficient(t2: f64) -> f64 {
    if t2 > 0.49 {
        let t = t2.sqrt();
        return (1.0 - 0.5 * t / (0.5 * t).tan()) / t2;
    }
    const SERIES: [f64; 9] = [
        1.0 / 12.0,
        1.0 / 720.0,
        1.0 / 30_240.0,
        1.0 / 1_209_600.0,
        1.0 / 47_900_160.0,
        691.0 / 1_307_674_368_000.0,
        1.0 / 74_724_249_600.0,
        3617.0 / 10_670_622_842_880_000.0,
        43867.0 / 5_109_094_217_170_944_000.0,
    ];
    let terms = if t2 < 0.002 { 4 } else { SERIES.len() };
    SERIES[..terms].iter().rev().fold(0.0, |sum, c| sum * t2 + c)
}
