//! What a deviation costs: the sum of the penalties that are switched on.

use super::loss::Frame;
use super::program::Program;
use super::{group_lasso, lasso, ridge};
use crate::problem::Group;

/// Weights of the penalties; 0 switches one off.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Penalty {
    /// Factor on `|x|^2 / 2`.
    pub ridge: f64,
    /// Factor on `sum |x_i|`.
    pub lasso: f64,
    /// Factor on `sum |x_group|`.
    pub group: f64,
}

impl Penalty {
    /// Cost of the point.
    pub fn merit(&self, x: &[f64], groups: &[Group]) -> f64 {
        let mut merit = self.ridge * ridge::merit(x);
        if self.lasso > 0.0 {
            merit += self.lasso * lasso::merit(x);
        }
        if self.group > 0.0 {
            merit += self.group * group_lasso::merit(x, groups);
        }
        merit
    }

    /// Writes the penalties into the program.
    pub fn pose(&self, program: &mut Program, frame: &Frame, groups: &[Group]) {
        if self.ridge > 0.0 {
            ridge::pose(program, frame, self.ridge);
        }
        if self.lasso > 0.0 {
            lasso::pose(program, frame, self.lasso);
        }
        if self.group > 0.0 {
            group_lasso::pose(program, frame, self.group, groups);
        }
    }
}
