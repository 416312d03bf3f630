//! Combinations of few components that a Jacobian does not see, or sees faintly (docs/theory.md (5.2)).
//!
//! A singular vector mixes everything with everything. What a person can read is a vector of few components in the same
//! subspace: single links first, then neighbours, then as few components as reweighted least squares finds.

use crate::linalg;
use faer::linalg::solvers::Solve;
use faer::{Mat, MatRef};

/// Rounds of reweighting.
const ROUNDS: usize = 20;
/// Components, relative to the largest, that are tried to be left out, boldest first.
const LEFT_OUT: [f64; 9] = [0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.05, 0.02, 0.005];
/// Components up to which a support is searched without reweighting.
const FEW: usize = 12;

/// Components among which a combination is sought, and unit vectors over them that are tried first.
#[derive(Clone, Debug, Default)]
pub struct Support {
    /// Indices of components.
    pub members: Vec<usize>,
    /// Preferred combinations, over `members`.
    pub preferred: Vec<Vec<f64>>,
}

/// A search for unit vectors `u` with `|J u| <= most` that are `faint`.
pub struct Search<'a> {
    /// k x n.
    pub jac: MatRef<'a, f64>,
    /// Orthonormal, n x q: directions accounted for before.
    pub seen: Mat<f64>,
    /// Orthonormal, n x t: what the vectors must span, together with `seen`.
    pub target: Mat<f64>,
    /// Largest change.
    pub most: f64,
    /// What else must hold of a vector.
    pub faint: &'a (dyn Fn(&[f64]) -> bool + Sync),
    /// Part of a unit vector that must lie in the target, beside those found before.
    pub independent: f64,
}

impl Search<'_> {
    /// As many unit vectors as the target has dimensions: supports in their order, then the rest.
    pub fn run(self, supports: &[Support]) -> Vec<Vec<f64>> {
        let wanted = self.target.ncols();
        let mut found: Vec<Vec<f64>> = Vec::with_capacity(wanted);
        let mut outside: Vec<Vec<f64>> = Vec::with_capacity(wanted);
        for support in supports {
            for preferred in &support.preferred {
                if found.len() < wanted {
                    let mut u = vec![0.0; self.jac.ncols()];
                    support.members.iter().zip(preferred).for_each(|(&i, v)| u[i] = *v);
                    self.accept(u, &mut found, &mut outside);
                }
            }
            while found.len() < wanted {
                let Some(u) = self.best_on(&support.members, &outside) else { break };
                let u = match support.members.len() {
                    0..=FEW => u,
                    _ => self.sparsest(&self.in_target(&u), &outside),
                };
                if !self.accept(u, &mut found, &mut outside) {
                    break;
                }
            }
        }
        let rest = self.rest(&outside);
        for w in rest.into_iter().take(wanted - found.len()) {
            found.push(self.sparsest(&w, &outside));
        }
        found
    }

    /// Takes `u` (unit) where it is faint and new.
    fn accept(&self, u: Vec<f64>, found: &mut Vec<Vec<f64>>, outside: &mut Vec<Vec<f64>>) -> bool {
        let Some(new) = self.news(&u, outside) else { return false };
        if !self.is_faint(&u) {
            return false;
        }
        outside.push(new);
        found.push(u);
        true
    }

    fn is_faint(&self, u: &[f64]) -> bool {
        linalg::norm(&linalg::mul(self.jac, u)) <= self.most && (self.faint)(u)
    }

    /// What `u` adds to `outside` in the target, normalised; `None` where that is too little.
    fn news(&self, u: &[f64], outside: &[Vec<f64>]) -> Option<Vec<f64>> {
        let mut new = self.in_target(u);
        for _ in 0..2 {
            for known in outside {
                let along = linalg::dot(known, &new);
                new.iter_mut().zip(known).for_each(|(v, k)| *v -= along * k);
            }
        }
        let size = linalg::norm(&new);
        (size >= self.independent).then(|| new.iter().map(|v| v / size).collect())
    }

    /// The part of `u` in the target.
    fn in_target(&self, u: &[f64]) -> Vec<f64> {
        linalg::mul(self.target.as_ref(), &linalg::mul_transpose(self.target.as_ref(), u))
    }

    /// The faint unit vector on these components that has most that is new.
    fn best_on(&self, members: &[usize], outside: &[Vec<f64>]) -> Option<Vec<f64>> {
        let n = self.jac.ncols();
        let columns = Mat::from_fn(self.jac.nrows(), members.len(), |i, j| self.jac[(i, members[j])]);
        let svd = linalg::svd(columns.as_ref())?;
        let first = svd.s.iter().filter(|s| **s > self.most).count();
        let faint: Vec<Vec<f64>> = (first..members.len())
            .map(|k| {
                let mut u = vec![0.0; n];
                members.iter().zip(svd.v.col(k).iter()).for_each(|(&i, v)| u[i] = *v);
                u
            })
            .collect();
        if faint.is_empty() {
            return None;
        }
        let mut new = Mat::zeros(n, faint.len());
        for (j, u) in faint.iter().enumerate() {
            let mut part = self.in_target(u);
            for known in outside {
                let along = linalg::dot(known, &part);
                part.iter_mut().zip(known).for_each(|(v, k)| *v -= along * k);
            }
            part.iter().enumerate().for_each(|(i, v)| new[(i, j)] = *v);
        }
        let best = linalg::svd(new.as_ref())?;
        if best.s.first().is_none_or(|s| *s < self.independent) {
            return None;
        }
        let mut u = vec![0.0; n];
        for (faint, c) in faint.iter().zip(best.v.col(0).iter()) {
            u.iter_mut().zip(faint).for_each(|(u, v)| *u += c * v);
        }
        Some(u)
    }

    /// Orthonormal vectors of the target that `outside` leaves.
    fn rest(&self, outside: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let t = self.target.ncols();
        let known = Mat::from_fn(t, outside.len(), |i, j| {
            linalg::dot(&self.target.col(i).iter().copied().collect::<Vec<f64>>(), &outside[j])
        });
        let left = match outside.is_empty() {
            true => Some(Mat::identity(t, t)),
            false => {
                linalg::svd(known.transpose()).map(|svd| svd.v.get(.., outside.len().min(t)..).to_owned())
            }
        };
        let Some(left) = left else { return Vec::new() };
        let rest = &self.target * left;
        (0..rest.ncols()).map(|j| rest.col(j).iter().copied().collect()).collect()
    }

    /// A vector of few components that is `w` but for what is seen already: least `sum |u_i|`, by reweighting.
    fn sparsest(&self, w: &[f64], outside: &[Vec<f64>]) -> Vec<f64> {
        let (n, q) = (w.len(), self.seen.ncols());
        // u = w + seen c
        let mut u = w.to_vec();
        let mut blur = 0.1;
        for _ in 0..ROUNDS {
            let weight: Vec<f64> = u.iter().map(|v| 1.0 / (v.abs() + blur)).collect();
            let scaled = Mat::from_fn(n, q, |i, j| self.seen[(i, j)] * weight[i].sqrt());
            let rhs =
                Mat::from_fn(q, 1, |j, _| -(0..n).map(|i| self.seen[(i, j)] * weight[i] * w[i]).sum::<f64>());
            let normal = scaled.transpose() * &scaled;
            let c = normal.partial_piv_lu().solve(&rhs);
            let c: Vec<f64> = c.col(0).iter().copied().collect();
            let next: Vec<f64> =
                linalg::mul(self.seen.as_ref(), &c).iter().zip(w).map(|(s, w)| s + w).collect();
            if !next.iter().all(|v| v.is_finite()) {
                break;
            }
            u = next;
            blur = f64::max(0.5 * blur, 1e-6);
        }
        let largest = u.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        for part in LEFT_OUT.into_iter().chain([0.0]) {
            let few: Vec<f64> = u.iter().map(|v| if v.abs() > part * largest { *v } else { 0.0 }).collect();
            let size = linalg::norm(&few);
            let few: Vec<f64> = few.iter().map(|v| v / size).collect();
            if part == 0.0 || self.news(&few, outside).is_some() && self.is_faint(&few) {
                return few;
            }
        }
        u
    }
}
