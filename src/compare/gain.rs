//! By how much what is minimised may still fall, where it has no derivative.

use crate::problem::Group;
use crate::solve::conic::program::{Owner, Program};
use crate::solve::{Objective, conic::loss::Loss};
use faer::Mat;

/// Distances in tolerances within which it is looked for: far, where the residual is nearly linear, and near.
const REACHES: [f64; 3] = [1.0, 0.1, 0.01];

/// A point at which an objective with the largest residual as its loss is held.
pub(super) struct Corner<'a> {
    /// Coordinates, tolerances.
    pub x: &'a [f64],
    /// Residual, standard deviations.
    pub r: &'a [f64],
    /// Its derivative, m x n.
    pub jac: &'a Mat<f64>,
    /// Limits of the coordinates, where there are any.
    pub limits: &'a [(f64, f64)],
    /// What belongs together.
    pub groups: &'a [Group],
}

impl Corner<'_> {
    /// Part of `F(x)` by which the best of some steps lowers it: those that are best by the linear model of the residual,
    /// of at most a tolerance, a tenth and a hundredth of one, within the limits (docs/theory.md (13.7)). `None` where there
    /// are sparse penalties, or no program can be solved.
    ///
    /// The steps are the solver's, the values are not: they are those of the residual that `residual` gives there.
    pub fn gain(
        &self,
        objective: &Objective,
        loss: &dyn Loss,
        residual: impl Fn(&[f64]) -> Option<Vec<f64>>,
    ) -> Option<f64> {
        let value = value(objective, loss, self.x, self.r);
        if objective.lasso > 0.0 || objective.group > 0.0 || !value.is_finite() {
            return None;
        }
        if value == 0.0 {
            return Some(0.0);
        }
        let gains = REACHES.into_iter().filter_map(|reach| {
            let step = self.step(objective, value, reach)?;
            let there: Vec<f64> = self.x.iter().zip(&step).map(|(x, d)| x + d).collect();
            // What cannot be evaluated is no gain.
            let least = residual(&there).map_or(value, |r| self::value(objective, loss, &there, &r));
            Some((value - least).max(0.0) / value)
        });
        gains.reduce(f64::max)
    }

    /// The step of at most `reach` that is best by the linear model.
    fn step(&self, objective: &Objective, value: f64, reach: f64) -> Option<Vec<f64>> {
        let n = self.x.len();
        let mut program = Program::new(n);
        for (j, x) in self.x.iter().enumerate() {
            program.quadratic[(j, j)] = objective.ridge / value;
            program.linear[j] = objective.ridge * x / value;
        }
        let largest = program.variable(0.0, 1.0);
        for (row, r) in self.r.iter().enumerate() {
            for sign in [1.0, -1.0] {
                let step = (0..n).map(|j| (j, sign * self.jac[(row, j)] / value)).chain([(largest, -1.0)]);
                program.at_most(step, -sign * r / value, Owner::Nobody);
            }
        }
        for (j, ((low, high), x)) in self.limits.iter().zip(self.x).enumerate() {
            if high.is_finite() {
                program.at_most([(j, 1.0)], (high - x).max(0.0), Owner::Param(j));
            }
            if low.is_finite() {
                program.at_most([(j, -1.0)], (x - low).max(0.0), Owner::Param(j));
            }
        }
        if objective.cone.is_finite() {
            for (k, group) in self.groups.iter().enumerate() {
                let length = objective.cone.max(group.length(self.x));
                let members = group.members.iter().map(|&i| (i, 1.0, self.x[i]));
                program.within((None, length), members, Owner::Group(k));
            }
        }
        program.within((None, reach), (0..n).map(|j| (j, 1.0, 0.0)), Owner::Nobody);
        let step = program.solve().ok()?.x;
        let step = step.get(..n).filter(|step| step.iter().all(|v| v.is_finite()))?;
        Some(step.to_vec())
    }
}

fn value(objective: &Objective, loss: &dyn Loss, x: &[f64], r: &[f64]) -> f64 {
    loss.merit(r) + 0.5 * objective.ridge * x.iter().map(|x| x * x).sum::<f64>()
}
