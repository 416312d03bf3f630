//! Splitting of the six tool directions of a limb into those its passive joints move and the wrenches that
//! they cannot (docs/theory.md (10)).

/// Orthogonal factors of one limb's passive Jacobian (6 x m, lengths in units of the machine's size).
///
/// `Q` is kept as its m reflections: only the wrenches are ever needed as vectors.
#[derive(Clone, Debug)]
pub struct PassiveSplit {
    /// Directions of the reflections `1 - v v' / scale`, zero above the pivot.
    v: [[f64; 6]; 6],
    /// One over `|v|^2 / 2` of each, 0 where a column was zero.
    inverse_scale: [f64; 6],
    /// Columns of R.
    r: [[f64; 6]; 6],
    /// The last 6 - m are the reciprocal wrenches.
    wrenches: [[f64; 6]; 6],
    m: usize,
}

impl PassiveSplit {
    /// An empty split: no passive joint, every wrench is transmitted.
    pub fn rigid() -> Self {
        let zero = [[0.0; 6]; 6];
        let wrenches = std::array::from_fn(|i| std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 }));
        Self { v: zero, inverse_scale: [0.0; 6], r: zero, wrenches, m: 0 }
    }

    /// Householder factorisation of the m <= 6 columns.
    ///
    /// The wrenches are oriented so that `det [J W']` is positive: they vary continuously as long as the
    /// passive twists stay independent, so that the sign of `det Jr` tells assembly modes apart.
    #[inline(always)]
    pub fn factor(&mut self, columns: &[[f64; 6]]) {
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
        let mut positive = true;
        for k in 0..M {
            let mut v = self.r[k];
            v[..k].fill(0.0);
            let norm = dot(&v, &v).sqrt();
            self.inverse_scale[k] = 0.0;
            if norm == 0.0 {
                continue;
            }
            let pivot = v[k];
            let alpha = if pivot > 0.0 { -norm } else { norm };
            v[k] -= alpha;
            self.inverse_scale[k] = 1.0 / (alpha * (alpha - pivot));
            self.v[k] = v;
            self.r[k][k] = alpha;
            for column in &mut self.r[k + 1..M] {
                reflect(&v, self.inverse_scale[k], column);
            }
            // A reflection has determinant -1, and so does each negative pivot.
            positive ^= alpha > 0.0;
        }
        for (row, wrench) in self.wrenches.iter_mut().enumerate().skip(M) {
            *wrench = [0.0; 6];
            wrench[row] = if positive || row > M { 1.0 } else { -1.0 };
            for k in (0..M).rev() {
                reflect(&self.v[k], self.inverse_scale[k], wrench);
            }
        }
    }

    /// Reciprocal wrenches, 6 - m rows, orthonormal.
    pub fn wrenches(&self) -> &[[f64; 6]] {
        &self.wrenches[self.m..]
    }

    /// Passive motions (the first m entries, the others zero) that come closest to the twist.
    pub fn motions(&self, twist: &[f64; 6]) -> [f64; 6] {
        let mut out = *twist;
        for k in 0..self.m {
            reflect(&self.v[k], self.inverse_scale[k], &mut out);
        }
        out[self.m..].fill(0.0);
        for k in (0..self.m).rev() {
            let pivot = self.r[k][k];
            out[k] = if pivot == 0.0 { 0.0 } else { out[k] / pivot };
            for l in 0..k {
                out[l] -= self.r[k][l] * out[k];
            }
        }
        out
    }

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

    /// Smallest pivot, which is zero where the passive twists depend on each other; 1 without passive joints.
    pub fn smallest_pivot(&self) -> f64 {
        (0..self.m).map(|k| self.r[k][k].abs()).fold(1.0, f64::min)
    }
}

/// Summed in two chains, as vector instructions do it.
#[inline(always)]
fn dot(a: &[f64; 6], b: &[f64; 6]) -> f64 {
    (a[0] * b[0] + a[2] * b[2] + a[4] * b[4]) + (a[1] * b[1] + a[3] * b[3] + a[5] * b[5])
}

#[inline(always)]
fn reflect(v: &[f64; 6], inverse_scale: f64, column: &mut [f64; 6]) {
    let s = inverse_scale * dot(v, column);
    for (c, v) in column.iter_mut().zip(v) {
        *c -= s * v;
    }
}
