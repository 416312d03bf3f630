//! Splitting of the six tool directions of a limb into those its passive joints move and the wrenches that
//! they cannot (docs/theory.md (10)).

use crate::wide::Lanes;

/// Orthogonal factors of one limb's passive Jacobian (6 x m, lengths in units of the machine's size).
///
/// `Q` is kept as its m reflections: only the wrenches are ever needed as vectors. With lanes, those of several postures
/// of the limb side by side.
#[derive(Clone, Debug)]
pub struct PassiveSplit<T = f64> {
    /// Directions of the reflections `1 - v v' / scale`, zero above the pivot.
    v: [[T; 6]; 6],
    /// One over `|v|^2 / 2` of each, 0 where a column was zero.
    inverse_scale: [T; 6],
    /// Columns of R.
    r: [[T; 6]; 6],
    /// The last 6 - m are the reciprocal wrenches.
    wrenches: [[T; 6]; 6],
    m: usize,
}

impl<T: Lanes> PassiveSplit<T> {
    /// An empty split: no passive joint, every wrench is transmitted.
    pub fn rigid() -> Self {
        let zero = [[T::splat(0.0); 6]; 6];
        let one = |i: usize| std::array::from_fn(|j| T::splat(if i == j { 1.0 } else { 0.0 }));
        Self { v: zero, inverse_scale: zero[0], r: zero, wrenches: std::array::from_fn(one), m: 0 }
    }

    /// Householder factorisation of the m <= 6 columns.
    ///
    /// The wrenches are oriented so that `det [J W']` is positive: they vary continuously as long as the
    /// passive twists stay independent, so that the sign of `det Jr` tells assembly modes apart.
    #[inline(always)]
    pub fn factor(&mut self, columns: &[[T; 6]]) {
        let m = columns.len();
        self.m = m;
        self.r[..m].copy_from_slice(columns);
        // Loops of fixed length are unrolled.
        match m {
            0 => self.reduce::<0>(),
            1 => self.reduce::<1>(),
            2 => self.reduce::<2>(),
            3 => self.reduce::<3>(),
            4 => self.reduce::<4>(),
            5 => self.reduce::<5>(),
            _ => self.reduce::<6>(),
        }
    }

    #[inline(always)]
    fn reduce<const M: usize>(&mut self) {
        let mut sign = T::splat(1.0);
        for k in 0..M {
            let mut v = self.r[k];
            v[..k].fill(T::splat(0.0));
            let norm = dot(&v, &v).map(f64::sqrt);
            let pivot = v[k];
            let alpha = norm.with(pivot, |norm, pivot| if pivot > 0.0 { -norm } else { norm });
            v[k] = pivot - alpha;
            self.inverse_scale[k] = T::splat(1.0).with(alpha * (alpha - pivot), over);
            self.v[k] = v;
            self.r[k][k] = alpha;
            for column in &mut self.r[k + 1..M] {
                reflect(&v, self.inverse_scale[k], column);
            }
            // A reflection has determinant -1, and so does each negative pivot.
            sign = sign.with(alpha, |sign, alpha| if alpha > 0.0 { -sign } else { sign });
        }
        for (row, wrench) in self.wrenches.iter_mut().enumerate().skip(M) {
            *wrench = [T::splat(0.0); 6];
            wrench[row] = if row > M { T::splat(1.0) } else { sign };
            for k in (0..M).rev() {
                reflect(&self.v[k], self.inverse_scale[k], wrench);
            }
        }
    }

    /// Reciprocal wrenches, 6 - m rows, orthonormal.
    pub fn wrenches(&self) -> &[[T; 6]] {
        &self.wrenches[self.m..]
    }

    /// Passive motions (the first m entries, the others zero) that come closest to the twist.
    #[inline(always)]
    pub fn motions(&self, twist: &[T; 6]) -> [T; 6] {
        let mut out = *twist;
        for k in 0..self.m {
            reflect(&self.v[k], self.inverse_scale[k], &mut out);
        }
        out[self.m..].fill(T::splat(0.0));
        for k in (0..self.m).rev() {
            out[k] = out[k].with(self.r[k][k], over);
            for l in 0..k {
                out[l] = out[l] - self.r[k][l] * out[k];
            }
        }
        out
    }
}

impl PassiveSplit {
    /// The covector that gives passive motion `k` of a twist, `e_k' R^-1 Q1'` (3.2); zero where the passive twists depend
    /// on each other.
    pub fn motion_covector(&self, k: usize) -> [f64; 6] {
        let mut out = [0.0; 6];
        for i in 0..self.m {
            let above: f64 = (0..i).map(|l| self.r[i][l] * out[l]).sum();
            let pivot = self.r[i][i];
            out[i] = if pivot == 0.0 { 0.0 } else { (f64::from(u8::from(i == k)) - above) / pivot };
        }
        for i in (0..self.m).rev() {
            reflect(&self.v[i], self.inverse_scale[i], &mut out);
        }
        out
    }

    /// Sign of the determinant of six passive twists, which changes only where they depend on each other; 1 where there
    /// are fewer, whose wrenches tell.
    pub fn orientation(&self) -> f64 {
        match self.m {
            6 => (0..6).map(|k| -self.r[k][k].signum()).product(),
            _ => 1.0,
        }
    }

    /// Smallest pivot, which is zero where the passive twists depend on each other; 1 without passive joints.
    pub fn smallest_pivot(&self) -> f64 {
        (0..self.m).map(|k| self.r[k][k].abs()).fold(1.0, f64::min)
    }
}

/// `a / b`, 0 where `b` is.
#[inline(always)]
fn over(a: f64, b: f64) -> f64 {
    if b == 0.0 { 0.0 } else { a / b }
}

/// Summed in two chains, as vector instructions do it.
#[inline(always)]
fn dot<T: Lanes>(a: &[T; 6], b: &[T; 6]) -> T {
    (a[0] * b[0] + a[2] * b[2] + a[4] * b[4]) + (a[1] * b[1] + a[3] * b[3] + a[5] * b[5])
}

#[inline(always)]
fn reflect<T: Lanes>(v: &[T; 6], inverse_scale: T, column: &mut [T; 6]) {
    let s = inverse_scale * dot(v, column);
    for (c, v) in column.iter_mut().zip(v) {
        *c = *c - s * *v;
    }
}
