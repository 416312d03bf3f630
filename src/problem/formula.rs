//! A problem written down as a formula, its Jacobian by forward-mode differentiation.
//!
//! ```
//! use gough::problem::Formula;
//! use gough::solve::{Identifier, Stop, argmin_lm::ArgminLm};
//!
//! // Rosenbrock's valley, whose floor is at (1, 1).
//! let valley = Formula::new(2, |x| Ok(vec![10.0 * (x[1] - x[0].square()), 1.0 - x[0]]));
//! let report = ArgminLm::default().identify(&valley, &[-1.2, 1.0], &Stop::default());
//! assert!(report.outcome.converged());
//! assert!((report.x[0] - 1.0).abs() < 1e-8 && (report.x[1] - 1.0).abs() < 1e-8);
//! ```

use super::core::{EvalError, Group, Linearized, Param, Problem};
use super::dual::Dual;
use faer::Mat;

/// Residuals of n numbers. Its cost is n + 1 evaluations a Jacobian: for tests and regressions, not for machines.
pub struct Formula<F> {
    params: Vec<Param>,
    groups: Vec<Group>,
    prior: bool,
    residual: F,
}

impl<F: Fn(&[Dual]) -> Result<Vec<Dual>, EvalError> + Sync> Formula<F> {
    /// A problem of `n` unbounded dimensionless parameters `b1`, `b2`, ...
    pub fn new(n: usize, residual: F) -> Self {
        let free = |i: usize| Param {
            name: format!("b{i}"),
            unit: "",
            scale: 1.0,
            bounds: (f64::NEG_INFINITY, f64::INFINITY),
        };
        Self { params: (1..=n).map(free).collect(), groups: Vec::new(), prior: false, residual }
    }

    /// The same with hard limits, one pair a parameter; further pairs are ignored.
    pub fn bounded(mut self, bounds: &[(f64, f64)]) -> Self {
        for (param, bounds) in self.params.iter_mut().zip(bounds) {
            param.bounds = *bounds;
        }
        self
    }

    /// The same with consecutive parameters grouped in lots of `size`, named `g1`, `g2`, ...
    pub fn grouped(mut self, size: usize) -> Self {
        let all: Vec<usize> = (0..self.params.len()).collect();
        self.groups = all
            .chunks(size.max(1))
            .enumerate()
            .map(|(g, members)| Group { name: format!("g{}", g + 1), members: members.to_vec() })
            .collect();
        self
    }

    /// The same with `|x|^2` as a log prior.
    pub fn with_prior(mut self) -> Self {
        self.prior = true;
        self
    }
}

impl<F: Fn(&[Dual]) -> Result<Vec<Dual>, EvalError> + Sync> Problem for Formula<F> {
    fn params(&self) -> &[Param] {
        &self.params
    }

    fn groups(&self) -> &[Group] {
        &self.groups
    }

    fn has_prior(&self) -> bool {
        self.prior
    }

    fn residual(&self, x: &[f64]) -> Result<Vec<f64>, EvalError> {
        let point: Vec<Dual> = x.iter().map(|&v| Dual::constant(v)).collect();
        Ok((self.residual)(&point)?.iter().map(|r| r.v).collect())
    }

    fn linearize(&self, x: &[f64]) -> Result<Linearized, EvalError> {
        let r = self.residual(x)?;
        let mut jac = Mat::zeros(r.len(), x.len());
        let mut point: Vec<Dual> = x.iter().map(|&v| Dual::constant(v)).collect();
        for j in 0..x.len() {
            point[j].d = 1.0;
            for (i, row) in (self.residual)(&point)?.iter().enumerate().take(r.len()) {
                jac[(i, j)] = row.d;
            }
            point[j].d = 0.0;
        }
        Ok(Linearized { r, jac })
    }
}
