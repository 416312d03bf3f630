//! A pose in the form in which chains of them are multiplied fastest.

use super::Se3;
use nalgebra::{Matrix3, Vector3};

/// A pose by columns, the three of its rotation and its position (m), each padded to the four places that vector
/// instructions take at once; the fourth means nothing.
#[derive(Clone, Copy, Debug)]
pub struct Columns(pub [[f64; 4]; 4]);

impl From<&Se3> for Columns {
    #[inline(always)]
    fn from(g: &Se3) -> Self {
        let (r, p) = (&g.r, &g.p);
        Self([
            [r.m11, r.m21, r.m31, 0.0],
            [r.m12, r.m22, r.m32, 0.0],
            [r.m13, r.m23, r.m33, 0.0],
            [p.x, p.y, p.z, 0.0],
        ])
    }
}

impl From<Columns> for Se3 {
    #[inline(always)]
    fn from(Columns([x, y, z, p]): Columns) -> Self {
        let r = Matrix3::new(x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]);
        Self { r, p: Vector3::new(p[0], p[1], p[2]) }
    }
}

impl Columns {
    /// The identity.
    pub fn identity() -> Self {
        Self::from(&Se3::identity())
    }

    /// Direction of the z axis.
    #[inline(always)]
    pub fn z(&self) -> Vector3<f64> {
        let [x, y, z, _] = self.0[2];
        Vector3::new(x, y, z)
    }

    /// Position, m.
    #[inline(always)]
    pub fn p(&self) -> Vector3<f64> {
        let [x, y, z, _] = self.0[3];
        Vector3::new(x, y, z)
    }

    /// `a x + b y`
    #[inline(always)]
    pub fn combined(x: &[f64; 4], a: f64, y: &[f64; 4], b: f64) -> [f64; 4] {
        std::array::from_fn(|i| x[i] * a + y[i] * b)
    }

    /// The pose behind `next`.
    #[inline(always)]
    pub fn times(&self, next: &Se3) -> Self {
        let [x, y, z, p] = &self.0;
        let turned =
            |a: f64, b: f64, c: f64| -> [f64; 4] { std::array::from_fn(|i| x[i] * a + y[i] * b + z[i] * c) };
        let (r, t) = (&next.r, turned(next.p.x, next.p.y, next.p.z));
        Self([
            turned(r.m11, r.m21, r.m31),
            turned(r.m12, r.m22, r.m32),
            turned(r.m13, r.m23, r.m33),
            std::array::from_fn(|i| t[i] + p[i]),
        ])
    }
}
