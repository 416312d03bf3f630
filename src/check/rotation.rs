//! The rotation nearest to a matrix.

use nalgebra::Matrix3;

/// Iterations of a decomposition of 3 x 3.
const ITERATIONS: usize = 100;

/// The rotation `R` that maximises `tr(R' sum)`; where two singular values vanish, one of those that do. `None` where
/// `sum` is not finite.
pub(super) fn nearest_rotation(sum: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    if !sum.iter().all(|v| v.is_finite()) {
        return None;
    }
    let svd = sum.try_svd(true, true, f64::EPSILON, ITERATIONS)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    let mut flip = Matrix3::identity();
    let smallest = svd.singular_values.argmin().0;
    flip[(smallest, smallest)] = (u * v_t).determinant().signum();
    Some(u * flip * v_t)
}

/// Ratio of the second singular value to the first: 0 where one axis, or none, determines a rotation.
pub(super) fn sharpness(sum: &Matrix3<f64>) -> f64 {
    let sizes = sum.try_svd(false, false, f64::EPSILON, ITERATIONS).map(|svd| svd.singular_values);
    let mut sizes: [f64; 3] = sizes.map_or([0.0; 3], Into::into);
    sizes.sort_by(|a, b| b.total_cmp(a));
    if sizes[0] > 0.0 { sizes[1] / sizes[0] } else { 0.0 }
}
