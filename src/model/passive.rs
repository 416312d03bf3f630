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
        *self = Self::rigid();
        self.m = m;
        self.r[..m].copy_from_slice(columns);
        let mut positive = true;
        for k in 0..m {
            let norm = self.r[k][k..].iter().map(|v| v * v).sum::<f64>().sqrt();
            if norm == 0.0 {
                continue;
            }
            let alpha = if self.r[k][k] > 0.0 { -norm } else { norm };
            let mut v = [0.0; 6];
            v[k..].copy_from_slice(&self.r[k][k..]);
            v[k] -= alpha;
            let beta = 2.0 / v[k..].iter().map(|a| a * a).sum::<f64>();
            for column in self.r[k..m].iter_mut() {
                reflect(&v, beta, k, column);
            }
            for i in 0..6 {
                let s = beta * (k..6).map(|l| v[l] * self.q[l][i]).sum::<f64>();
                for l in k..6 {
                    self.q[l][i] -= s * v[l];
                }
            }
            // A reflection has determinant -1, and so does each negative pivot.
            positive ^= alpha > 0.0;
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

fn reflect(v: &[f64; 6], beta: f64, from: usize, column: &mut [f64; 6]) {
    let s = beta * (from..6).map(|l| v[l] * column[l]).sum::<f64>();
    for l in from..6 {
        column[l] -= s * v[l];
    }
}
