//! Splitting of the six tool directions of a limb into those its passive joints move and the wrenches that
//! they cannot (docs/theory.md (10)).

/// Orthogonal factors of one limb's passive Jacobian (6 x m, lengths in units of the machine's size).
#[derive(Clone, Debug)]
pub struct PassiveSplit {
    /// Rows of `Q'`: the first m span the passive twists, the last 6 - m are the reciprocal wrenches.
    q: [[f64; 6]; 6],
    /// Upper triangle of R, by columns.
    r: [[f64; 6]; 6],
    m: usize,
}

impl PassiveSplit {
    /// An empty split: no passive joint, every wrench is transmitted.
    pub fn rigid() -> Self {
        let mut q = [[0.0; 6]; 6];
        for (i, row) in q.iter_mut().enumerate() {
            row[i] = 1.0;
        }
        Self { q, r: [[0.0; 6]; 6], m: 0 }
    }

    /// Householder factorisation of the m <= 6 columns.
    ///
    /// The wrenches are oriented so that `det [J W']` is positive: they vary continuously as long as the
    /// passive twists stay independent, so that the sign of `det Jr` tells assembly modes apart.
    pub fn factor(&mut self, columns: &[[f64; 6]]) {
        let m = columns.len();
        self.m = m;
        self.r[..m].copy_from_slice(columns);
        // Columns of Q', so that a reflection works on contiguous vectors of fixed length.
        let mut q = Self::rigid().q;
        let mut positive = true;
        for k in 0..m {
            let norm = self.r[k][k..].iter().map(|v| v * v).sum::<f64>().sqrt();
            if norm == 0.0 {
                continue;
            }
            let pivot = self.r[k][k];
            let alpha = if pivot > 0.0 { -norm } else { norm };
            let mut v = self.r[k];
            v[..k].fill(0.0);
            v[k] -= alpha;
            // |v|^2 / 2
            let scale = 1.0 / (alpha * (alpha - pivot));
            for column in self.r[k..m].iter_mut().chain(&mut q) {
                reflect(&v, scale, column);
            }
            // A reflection has determinant -1, and so does each negative pivot.
            positive ^= alpha > 0.0;
        }
        for (l, row) in self.q.iter_mut().enumerate() {
            for (entry, column) in row.iter_mut().zip(&q) {
                *entry = column[l];
            }
        }
        if !positive && m < 6 {
            for value in &mut self.q[m] {
                *value = -*value;
            }
        }
    }

    /// Reciprocal wrenches, 6 - m rows, orthonormal.
    pub fn wrenches(&self) -> &[[f64; 6]] {
        &self.q[self.m..]
    }

    /// Passive motions (m) that come closest to the twist.
    pub fn motions(&self, twist: &[f64; 6]) -> [f64; 6] {
        let mut out = [0.0; 6];
        for k in (0..self.m).rev() {
            let along: f64 = self.q[k].iter().zip(twist).map(|(q, t)| q * t).sum();
            let rest: f64 = (k + 1..self.m).map(|l| self.r[l][k] * out[l]).sum();
            out[k] = if self.r[k][k] == 0.0 { 0.0 } else { (along - rest) / self.r[k][k] };
        }
        out
    }

    /// Smallest pivot, which is zero where the passive twists depend on each other; 1 without passive joints.
    pub fn smallest_pivot(&self) -> f64 {
        (0..self.m).map(|k| self.r[k][k].abs()).fold(1.0, f64::min)
    }
}

#[inline(always)]
fn reflect(v: &[f64; 6], scale: f64, column: &mut [f64; 6]) {
    // Summed as a tree: a chain of six additions would be waited for.
    let p: [f64; 6] = std::array::from_fn(|l| v[l] * column[l]);
    let s = scale * ((p[0] + p[1]) + (p[2] + p[3]) + (p[4] + p[5]));
    for l in 0..6 {
        column[l] -= s * v[l];
    }
}
