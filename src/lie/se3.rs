//! Rigid motions. Twists are `[w; v]`, rotation (rad) first, translation (m) second; see docs/conventions.md.

use super::Columns;
use super::so3::{self, hat};
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};
use std::ops::Mul;

/// Twist `[w; v]`, rad and m.
pub type Twist = Vector6<f64>;

/// A pose: rotation matrix and position, `x_out = r x_in + p`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Se3 {
    /// Rotation matrix.
    pub r: Matrix3<f64>,
    /// Position, m.
    pub p: Vector3<f64>,
}

impl Se3 {
    /// The identity.
    pub fn identity() -> Self {
        Self { r: Matrix3::identity(), p: Vector3::zeros() }
    }

    /// A translation, m.
    pub fn translation(x: f64, y: f64, z: f64) -> Self {
        Self { r: Matrix3::identity(), p: Vector3::new(x, y, z) }
    }

    /// Inverse motion.
    pub fn inverse(&self) -> Self {
        let r = self.r.transpose();
        Self { r, p: -(r * self.p) }
    }

    /// Pose with position `p` and rotation vector `w`, rad.
    pub fn from_rotation_vector(p: Vector3<f64>, w: &Vector3<f64>) -> Self {
        Self { r: so3::exp(w), p }
    }

    /// Whether all entries are finite, and their sum.
    pub fn is_finite(&self) -> bool {
        (self.r.sum() + self.p.sum()).is_finite()
    }
}

impl Mul for Se3 {
    type Output = Se3;
    #[inline(always)]
    fn mul(self, other: Se3) -> Se3 {
        Columns::from(&self).times(&other).into()
    }
}

/// Rotation and translation part of a twist.
pub fn split(xi: &Twist) -> (Vector3<f64>, Vector3<f64>) {
    (xi.fixed_rows::<3>(0).into_owned(), xi.fixed_rows::<3>(3).into_owned())
}

/// Twist from its rotation and translation part.
pub fn join(w: &Vector3<f64>, v: &Vector3<f64>) -> Twist {
    Twist::new(w.x, w.y, w.z, v.x, v.y, v.z)
}

fn blocks(upper_left: &Matrix3<f64>, lower_left: &Matrix3<f64>, lower_right: &Matrix3<f64>) -> Matrix6<f64> {
    let mut m = Matrix6::zeros();
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(upper_left);
    m.fixed_view_mut::<3, 3>(3, 0).copy_from(lower_left);
    m.fixed_view_mut::<3, 3>(3, 3).copy_from(lower_right);
    m
}

/// Exponential (docs/theory.md (34)).
pub fn exp(xi: &Twist) -> Se3 {
    let (w, v) = split(xi);
    Se3 { r: so3::exp(&w), p: so3::left_jacobian(&w) * v }
}

/// Logarithm with rotation angle at most pi.
pub fn log(g: &Se3) -> Twist {
    let w = so3::log(&g.r);
    join(&w, &(so3::left_jacobian_inverse(&w) * g.p))
}

/// `Ad(g) = [[R, 0], [hat(p) R, R]]`, so that `g exp(xi) g^-1 = exp(Ad(g) xi)`.
pub fn adjoint(g: &Se3) -> Matrix6<f64> {
    blocks(&g.r, &(hat(&g.p) * g.r), &g.r)
}

/// `ad(xi) = [[hat(w), 0], [hat(v), hat(w)]]`.
pub fn ad(xi: &Twist) -> Matrix6<f64> {
    let (w, v) = split(xi);
    let wx = hat(&w);
    blocks(&wx, &hat(&v), &wx)
}

/// Left Jacobian `A(xi) = sum ad(xi)^k / (k + 1)!` (38), with `d exp(xi) exp(-xi) = A(xi) dxi`.
///
/// By blocks, docs/theory.md (1.5), after Barfoot, State Estimation for Robotics, 2nd ed., (8.91).
pub fn left_jacobian(xi: &Twist) -> Matrix6<f64> {
    let (w, v) = split(xi);
    let diagonal = so3::left_jacobian(&w);
    blocks(&diagonal, &coupling(&w, &v), &diagonal)
}

/// Inverse of [`left_jacobian`]; singular where the rotation angle is 2 pi.
pub fn left_jacobian_inverse(xi: &Twist) -> Matrix6<f64> {
    let (w, v) = split(xi);
    let diagonal = so3::left_jacobian_inverse(&w);
    blocks(&diagonal, &(-diagonal * coupling(&w, &v) * diagonal), &diagonal)
}

/// Right Jacobian `A(-xi)`, with `exp(-xi) d exp(xi) = A(-xi) dxi`.
pub fn right_jacobian(xi: &Twist) -> Matrix6<f64> {
    left_jacobian(&-xi)
}

fn coupling(w: &Vector3<f64>, v: &Vector3<f64>) -> Matrix3<f64> {
    let t = w.norm();
    let t2 = t * t;
    let (m3, m4) = if t > 2.5 {
        let (sin, cos) = t.sin_cos();
        ((t2 + 2.0 * cos - 2.0) / (2.0 * t2 * t2), (2.0 * t - 3.0 * sin + t * cos) / (2.0 * t2 * t2 * t))
    } else {
        (so3::alternating(t2, 4, |_| 1.0), so3::alternating(t2, 5, |k| k + 1.0))
    };
    let (wx, vx) = (hat(w), hat(v));
    let (wv, vw) = (wx * vx, vx * wx);
    let wvw = wv * wx;
    vx * 0.5
        + (wv + vw + wvw) * so3::a3(t)
        + (wx * wv + vw * wx - wvw * 3.0) * m3
        + (wvw * wx + wx * wvw) * m4
}
