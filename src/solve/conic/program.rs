//! One conic program `min x'Px/2 + q'x, Ax + s = b, s in K`, and what clarabel makes of it.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverStatus, SupportedConeT};
use faer::Mat;
use std::collections::BTreeMap;

/// Whom a row of the program speaks for, so that a certificate can be put into names.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Owner {
    /// The limits of a parameter.
    Param(usize),
    /// The limit of a group.
    Group(usize),
    /// The program's own.
    Nobody,
}

/// Accuracy asked of clarabel, relative to data of order one.
const TOLERANCE: f64 = 1e-10;

/// A program under construction: the first n variables are the step, in its units; the others are auxiliary.
#[derive(Clone, Debug)]
pub struct Program {
    /// Quadratic form on the step, n x n; only the upper triangle is read.
    pub quadratic: Mat<f64>,
    /// Diagonal of the quadratic form on the auxiliary variables.
    auxiliary: Vec<f64>,
    /// Linear cost of all variables.
    pub linear: Vec<f64>,
    entries: (Vec<usize>, Vec<usize>, Vec<f64>),
    right: Vec<f64>,
    cones: Vec<SupportedConeT<f64>>,
    owners: Vec<Owner>,
    /// Most interior-point iterations.
    pub iterations: u32,
    /// Accuracy asked for, relative to data of order one.
    pub tolerance: f64,
}

/// What clarabel returned.
#[derive(Clone, Debug)]
pub struct Solution {
    /// How it ended.
    pub status: SolverStatus,
    /// All variables.
    pub x: Vec<f64>,
    /// Dual variable of every row, in units of the objective as posed; a certificate where infeasible.
    pub z: Vec<f64>,
}

impl Program {
    /// A program of n step variables with zero cost and no rows.
    pub fn new(n: usize) -> Self {
        Self {
            quadratic: Mat::zeros(n, n),
            auxiliary: Vec::new(),
            linear: vec![0.0; n],
            entries: Default::default(),
            right: Vec::new(),
            cones: Vec::new(),
            owners: Vec::new(),
            iterations: 200,
            tolerance: TOLERANCE,
        }
    }

    /// Number of step variables, n.
    pub fn steps(&self) -> usize {
        self.quadratic.ncols()
    }

    /// Number of rows so far: the index of the next one.
    pub fn rows(&self) -> usize {
        self.right.len()
    }

    /// Adds an auxiliary variable with cost `curvature v^2 / 2 + slope v`; returns its index.
    pub fn variable(&mut self, curvature: f64, slope: f64) -> usize {
        self.auxiliary.push(curvature);
        self.linear.push(slope);
        self.linear.len() - 1
    }

    fn row(&mut self, coefficients: impl IntoIterator<Item = (usize, f64)>, right: f64, owner: Owner) {
        let row = self.right.len();
        for (column, value) in coefficients {
            if value != 0.0 {
                self.entries.0.push(row);
                self.entries.1.push(column);
                self.entries.2.push(value);
            }
        }
        self.right.push(right);
        self.owners.push(owner);
    }

    /// Requires `coefficients . x = right`.
    pub fn equal(&mut self, coefficients: impl IntoIterator<Item = (usize, f64)>, right: f64, owner: Owner) {
        self.row(coefficients, right, owner);
        match self.cones.last_mut() {
            Some(SupportedConeT::ZeroConeT(count)) => *count += 1,
            _ => self.cones.push(SupportedConeT::ZeroConeT(1)),
        }
    }

    /// Requires `coefficients . x <= right`.
    pub fn at_most(
        &mut self,
        coefficients: impl IntoIterator<Item = (usize, f64)>,
        right: f64,
        owner: Owner,
    ) {
        self.row(coefficients, right, owner);
        match self.cones.last_mut() {
            Some(SupportedConeT::NonnegativeConeT(count)) => *count += 1,
            _ => self.cones.push(SupportedConeT::NonnegativeConeT(1)),
        }
    }

    /// Requires `|(a_i x + b_i)_i| <= h x + c`; `head` is `(h, c)` and each of `tail` one `(a_i, b_i)`.
    pub fn within(
        &mut self,
        head: (Option<(usize, f64)>, f64),
        tail: impl IntoIterator<Item = (usize, f64, f64)>,
        owner: Owner,
    ) {
        let first = self.rows();
        self.row(head.0.map(|(column, value)| (column, -value)), head.1, owner);
        for (column, value, offset) in tail {
            self.row([(column, -value)], offset, owner);
        }
        self.cones.push(SupportedConeT::SecondOrderConeT(self.rows() - first));
    }

    /// Owners of the rows that clash, from a certificate `z` of infeasibility: those with a share in `A'z` beyond
    /// rounding, the least share first.
    ///
    /// An interior certificate also presses on both sides of limits that take no part; in `A'z` that cancels.
    pub fn clash(&self, z: &[f64]) -> Vec<Owner> {
        let mut pulls: BTreeMap<Owner, BTreeMap<usize, f64>> = BTreeMap::new();
        let (rows, columns, values) = &self.entries;
        for ((&row, &column), value) in rows.iter().zip(columns).zip(values) {
            *pulls.entry(self.owners[row]).or_default().entry(column).or_default() += value * z[row];
        }
        let mut shares: Vec<(f64, Owner)> = pulls
            .into_iter()
            .filter(|(owner, _)| *owner != Owner::Nobody)
            .map(|(owner, pull)| (pull.values().map(|v| v * v).sum::<f64>().sqrt(), owner))
            .collect();
        let largest = shares.iter().fold(0.0f64, |a, (share, _)| a.max(*share));
        shares.retain(|(share, _)| *share > 1e-6 * largest);
        shares.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        shares.into_iter().map(|(_, owner)| owner).collect()
    }

    /// Solves it; an error where clarabel refuses the data.
    pub fn solve(&self) -> Result<Solution, String> {
        let total = self.linear.len();
        // Clarabel's tests are absolute below one: an objective of 1e-12 would pass them at any point.
        let scale = self
            .linear
            .iter()
            .chain(&self.auxiliary)
            .copied()
            .chain((0..self.steps()).map(|j| self.quadratic[(j, j)]))
            .fold(0.0f64, |a, v| a.max(v.abs()));
        let scale = if scale > 0.0 && scale.is_finite() { scale } else { 1.0 };
        let linear: Vec<f64> = self.linear.iter().map(|v| v / scale).collect();
        let (i, j, v) = self.entries.clone();
        let rows = CscMatrix::new_from_triplets(self.rows(), total, i, j, v);
        let settings = DefaultSettingsBuilder::default()
            .verbose(false)
            .max_iter(self.iterations)
            .tol_gap_abs(self.tolerance)
            .tol_gap_rel(self.tolerance)
            .tol_feas(self.tolerance)
            .max_threads(1)
            .build()
            .map_err(|why| why.to_string())?;
        let mut solver =
            DefaultSolver::new(&self.hessian(scale), &linear, &rows, &self.right, &self.cones, settings)
                .map_err(|why| why.to_string())?;
        crate::wide::narrow();
        solver.solve();
        let solution = solver.solution;
        Ok(Solution {
            status: solution.status,
            x: solution.x,
            z: solution.z.iter().map(|v| v * scale).collect(),
        })
    }

    /// Upper triangle of the quadratic form of all variables, divided by `scale`.
    fn hessian(&self, scale: f64) -> CscMatrix<f64> {
        let n = self.steps();
        let (mut starts, mut indices, mut values) = (vec![0], Vec::new(), Vec::new());
        for j in 0..self.linear.len() {
            if j < n {
                for i in 0..=j {
                    let value = self.quadratic[(i, j)];
                    if value != 0.0 {
                        indices.push(i);
                        values.push(value / scale);
                    }
                }
            } else if self.auxiliary[j - n] != 0.0 {
                indices.push(j);
                values.push(self.auxiliary[j - n] / scale);
            }
            starts.push(indices.len());
        }
        CscMatrix::new(self.linear.len(), self.linear.len(), starts, indices, values)
    }
}
