//! Double-double numbers (about 32 digits) and matrix power series: the reference for the Lie group tests.
//!
//! Nothing here knows a closed form of the exponential or its Jacobian; both are sums of powers of a matrix. At
//! four turns the largest term is near 1e10, so the sums still hold more than 20 digits.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// The unevaluated sum of two floats, the second below half a unit in the last place of the first.
#[derive(Clone, Copy, Debug)]
pub struct Dd(f64, f64);

pub const ZERO: Dd = Dd(0.0, 0.0);
pub const ONE: Dd = Dd(1.0, 0.0);
pub const PI: Dd = Dd(std::f64::consts::PI, 1.224_646_799_147_353_2e-16);

impl From<f64> for Dd {
    fn from(a: f64) -> Self {
        Dd(a, 0.0)
    }
}

impl Add for Dd {
    type Output = Dd;
    fn add(self, b: Dd) -> Dd {
        let (high, high_rest) = two_sum(self.0, b.0);
        let (low, low_rest) = two_sum(self.1, b.1);
        let (high, rest) = quick_two_sum(high, high_rest + low);
        let (high, rest) = quick_two_sum(high, rest + low_rest);
        Dd(high, rest)
    }
}

impl Neg for Dd {
    type Output = Dd;
    fn neg(self) -> Dd {
        Dd(-self.0, -self.1)
    }
}

impl Sub for Dd {
    type Output = Dd;
    fn sub(self, b: Dd) -> Dd {
        self + -b
    }
}

impl Mul for Dd {
    type Output = Dd;
    fn mul(self, b: Dd) -> Dd {
        let high = self.0 * b.0;
        let rest = self.0.mul_add(b.0, -high) + (self.0 * b.1 + self.1 * b.0);
        let (high, rest) = quick_two_sum(high, rest);
        Dd(high, rest)
    }
}

impl Div for Dd {
    type Output = Dd;
    fn div(self, b: Dd) -> Dd {
        let q1 = Dd::from(self.0 / b.0);
        let r1 = self - q1 * b;
        let q2 = Dd::from(r1.0 / b.0);
        let r2 = r1 - q2 * b;
        q1 + q2 + Dd::from(r2.0 / b.0)
    }
}

impl Dd {
    pub fn to_f64(self) -> f64 {
        self.0 + self.1
    }

    /// Of a positive number, by one Newton step, which doubles the digits of the hardware's root.
    pub fn sqrt(self) -> Dd {
        let root = Dd::from(self.0.sqrt());
        root + (self - root * root) / (root + root)
    }

    /// `(sin, cos)` by their power series, for arguments of a few turns.
    pub fn sin_cos(self) -> (Dd, Dd) {
        let rotation = Mat([[ZERO, -self], [self, ZERO]]).exp(self.0.abs());
        (rotation.0[1][0], rotation.0[0][0])
    }
}

fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let b_seen = sum - a;
    (sum, (a - (sum - b_seen)) + (b - b_seen))
}

/// As [`two_sum`], for |a| >= |b|.
fn quick_two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    (sum, b - (sum - a))
}

/// A square matrix.
#[derive(Clone, Copy, Debug)]
pub struct Mat<const N: usize>(pub [[Dd; N]; N]);

impl<const N: usize> Mat<N> {
    pub fn from_fn(f: impl Fn(usize, usize) -> Dd) -> Self {
        Mat(std::array::from_fn(|i| std::array::from_fn(|j| f(i, j))))
    }

    pub fn identity() -> Self {
        Self::from_fn(|i, j| if i == j { ONE } else { ZERO })
    }

    pub fn scale(&self, factor: Dd) -> Self {
        Self::from_fn(|i, j| self.0[i][j] * factor)
    }

    pub fn apply(&self, x: [Dd; N]) -> [Dd; N] {
        std::array::from_fn(|i| (0..N).fold(ZERO, |sum, k| sum + self.0[i][k] * x[k]))
    }

    /// `sum Z^k / k!` of a matrix whose eigenvalues are at most `angle` in size.
    pub fn exp(&self, angle: f64) -> Self {
        // Terms no larger than 1, so that a rotation by nearly a full turn keeps its digits too.
        let mut halvings = 0;
        while angle * 0.5_f64.powi(halvings) > 1.0 {
            halvings += 1;
        }
        let part = self.scale(Dd::from(0.5_f64.powi(halvings))).series(0, 1.0);
        (0..halvings).fold(part, |power, _| power * power)
    }

    /// `sum Z^k / (k + 1)!` of a matrix whose eigenvalues are at most `angle` in size.
    pub fn left_jacobian(&self, angle: f64) -> Self {
        self.series(1, angle)
    }

    fn series(&self, shift: u32, angle: f64) -> Self {
        assert!(angle < 40.0, "digits would be lost");
        // The first term left out is below 1e-45 for every angle allowed.
        let terms = 40 + 5 * angle.ceil() as u32;
        let mut term = Self::identity();
        let mut sum = term;
        for k in 1..terms {
            term = (term * *self).scale(ONE / Dd::from(f64::from(k + shift)));
            sum = sum + term;
        }
        sum
    }

    /// By Gauss-Jordan elimination with row pivots.
    pub fn inverse(&self) -> Self {
        let (mut a, mut inverse) = (self.0, Self::identity().0);
        for k in 0..N {
            let pivot = (k..N).max_by(|&i, &j| a[i][k].0.abs().total_cmp(&a[j][k].0.abs())).unwrap();
            a.swap(k, pivot);
            inverse.swap(k, pivot);
            let factor = ONE / a[k][k];
            a[k] = a[k].map(|x| x * factor);
            inverse[k] = inverse[k].map(|x| x * factor);
            let (row, inverse_row) = (a[k], inverse[k]);
            for i in (0..N).filter(|&i| i != k) {
                let factor = a[i][k];
                for j in 0..N {
                    a[i][j] = a[i][j] - factor * row[j];
                    inverse[i][j] = inverse[i][j] - factor * inverse_row[j];
                }
            }
        }
        Mat(inverse)
    }
}

impl<const N: usize> Add for Mat<N> {
    type Output = Self;
    fn add(self, b: Self) -> Self {
        Self::from_fn(|i, j| self.0[i][j] + b.0[i][j])
    }
}

impl<const N: usize> Mul for Mat<N> {
    type Output = Self;
    fn mul(self, b: Self) -> Self {
        Self::from_fn(|i, j| (0..N).fold(ZERO, |sum, k| sum + self.0[i][k] * b.0[k][j]))
    }
}

/// Cross-product matrix.
pub fn hat(w: [Dd; 3]) -> Mat<3> {
    Mat([[ZERO, -w[2], w[1]], [w[2], ZERO, -w[0]], [-w[1], w[0], ZERO]])
}

/// `[[w^, v], [0, 0]]`.
pub fn twist_matrix(xi: [Dd; 6]) -> Mat<4> {
    let w = hat([xi[0], xi[1], xi[2]]);
    Mat::from_fn(|i, j| match (i, j) {
        (3, _) => ZERO,
        (_, 3) => xi[3 + i],
        _ => w.0[i][j],
    })
}

/// `[[w^, 0], [v^, w^]]`.
pub fn ad(xi: [Dd; 6]) -> Mat<6> {
    let (w, v) = (hat([xi[0], xi[1], xi[2]]), hat([xi[3], xi[4], xi[5]]));
    Mat::from_fn(|i, j| match (i / 3, j / 3) {
        (0, 1) => ZERO,
        (1, 0) => v.0[i - 3][j],
        _ => w.0[i % 3][j % 3],
    })
}

/// Length, scaled so that the squares of a tiny vector do not underflow.
pub fn norm(w: [Dd; 3]) -> Dd {
    let scale = largest(w);
    if scale == 0.0 {
        return ZERO;
    }
    let u = w.map(|x| x / Dd::from(scale));
    (u[0] * u[0] + u[1] * u[1] + u[2] * u[2]).sqrt() * Dd::from(scale)
}

/// Largest size of an entry, NaN if any is NaN.
pub fn largest(entries: impl IntoIterator<Item = Dd>) -> f64 {
    entries.into_iter().map(|x| x.to_f64().abs()).fold(0.0, |m, x| if x <= m || m.is_nan() { m } else { x })
}

/// The part that decides the digits of a small rotation: `(m - m') / 2` as a vector.
pub fn antisymmetric<const N: usize>(m: &Mat<N>) -> [Dd; 3] {
    let half = Dd::from(0.5);
    [(2, 1), (0, 2), (1, 0)].map(|(i, j)| (m.0[i][j] - m.0[j][i]) * half)
}
