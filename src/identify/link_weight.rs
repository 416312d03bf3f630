//! Weights of what links deviate beside a common motion: `S^-2` of docs/theory.md (10.16).

use crate::lie::se3::Twist;
use crate::linalg;
use crate::model::{Prior, Tolerance};
use faer::Mat;
use nalgebra::Matrix6;

/// Tolerance of what is held, rad and machine sizes: rounding.
const HELD: f64 = 1e-9;

/// Variances of a motion with this tolerance, rad^2 and m^2, of what is free of it `loose` (rad and machine sizes); `None`
/// where all of it is free.
pub(super) fn variances(tolerance: Tolerance, loose: f64, length: f64) -> Option<Twist> {
    let size = |prior: Prior, unit: f64| match prior {
        Prior::Sigma(sigma) => sigma.max(HELD * unit),
        Prior::Held => HELD * unit,
        Prior::Free => loose * unit,
    };
    let (angle, length) = (size(tolerance.angle, 1.0), size(tolerance.length, length));
    let free = tolerance.angle == Prior::Free && tolerance.length == Prior::Free;
    (!free).then(|| Twist::from_fn(|i, _| f64::powi(if i < 3 { angle } else { length }, 2)))
}

/// `(diag(floor) + sum_j e_j e_j')^-1`; zero, which counts for nothing, where an error is not finite.
pub(super) fn by_errors(floor: &Twist, errors: &[Twist]) -> Matrix6<f64> {
    let root = floor.map(|v| v.sqrt().recip());
    // What the errors leave open exceeds the floor by more than the sum of both resolves.
    let scaled = Mat::from_fn(errors.len(), 6, |i, j| errors[i][j] * root[j]);
    let Some(svd) = linalg::svd(scaled.as_ref()) else { return Matrix6::zeros() };
    let size = |k: usize| svd.s.get(k).map_or(1.0, |s| 1.0_f64.hypot(*s));
    let left = Matrix6::from_fn(|i, k| root[i] * svd.v[(i, k)] / size(k));
    left * left.transpose()
}

/// The weight where any multiple of `idle` counts for nothing: `W - W k k'W / k'W k`, the limit of `(W^-1 + t k k')^-1` for
/// growing `t`.
pub(super) fn without_idle(weight: &Matrix6<f64>, idle: &Twist) -> Matrix6<f64> {
    let along = weight * idle;
    let square = idle.dot(&along);
    if square > 0.0 { weight - along * along.transpose() / square } else { *weight }
}

#[cfg(test)]
mod tests {
    use super::{by_errors, variances, without_idle};
    use crate::lie::se3::Twist;
    use crate::model::{Prior, Tolerance};
    use nalgebra::{Matrix6, SMatrix, Vector6};

    const IDLE: [f64; 6] = [0.2, -0.5, 0.8, 0.1, 0.03, -0.2];

    /// The weight of what is left of a deviation once `k` is eliminated: `B (B'S^2 B)^-1 B'` with the columns of `B` normal
    /// to `k`.
    fn eliminated(covariance: &Matrix6<f64>, k: &Twist) -> Matrix6<f64> {
        let pivot = k.iamax();
        let mut normal = SMatrix::<f64, 6, 5>::zeros();
        for (column, i) in (0..6).filter(|i| *i != pivot).enumerate() {
            normal[(i, column)] = 1.0;
            normal[(pivot, column)] = -k[i] / k[pivot];
        }
        let own = (normal.transpose() * covariance * normal).lu().try_inverse().unwrap();
        normal * own * normal.transpose()
    }

    fn assert_near(a: &Matrix6<f64>, b: &Matrix6<f64>, relative: f64) {
        assert!((a - b).norm() < relative * b.norm(), "{a} {b}");
    }

    #[test]
    fn a_held_link_with_a_passive_joint_weighs_what_is_left_once_that_is_eliminated() {
        let idle = Vector6::from(IDLE);
        let own = |angle, length| variances(Tolerance { angle, length }, 1.0, 0.7).unwrap();
        let sigma = Prior::Sigma;
        for own in [
            own(Prior::Held, Prior::Held),
            own(sigma(1e-5), sigma(1e-4)),
            own(sigma(1e-3), Prior::Free),
            own(sigma(0.0), sigma(0.0)),
        ] {
            let weight = without_idle(&Matrix6::from_diagonal(&own.map(f64::recip)), &idle);
            assert_near(&weight, &eliminated(&Matrix6::from_diagonal(&own), &idle), 1e-12);
            assert!((weight * idle).norm() < 1e-13 * weight.norm());
        }
    }

    #[test]
    fn errors_far_above_their_floor_leave_the_floor_beside_them() {
        let floor = Twist::repeat(1e-10);
        let small = [Vector6::from([1e-4, 2e-4, 0.0, 0.0, 1e-5, 0.0]), Vector6::from(IDLE) * 1e-4];
        let covariance =
            Matrix6::from_diagonal(&floor) + small.iter().map(|e| e * e.transpose()).sum::<Matrix6<f64>>();
        assert_near(&by_errors(&floor, &small), &covariance.try_inverse().unwrap(), 1e-9);
        // Beyond rounding, by the limit: what is normal to the error has the floor alone.
        let far = Vector6::from(IDLE) * 1e4;
        let beside = Matrix6::identity() - far * far.transpose() / far.norm_squared();
        assert_near(&by_errors(&floor, &[far]), &(beside * 1e10), 1e-12);
    }
}
