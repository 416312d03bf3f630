//! Group lasso: the sum of the lengths of link deviations, which leaves most links at exactly nominal.

use super::loss::Frame;
use super::program::{Owner, Program};
use crate::problem::Group;

/// `sum |x_group|`.
pub fn merit(x: &[f64], groups: &[Group]) -> f64 {
    groups.iter().map(|group| group.length(x)).sum()
}

/// Adds `weight sum |u_group|` through second-order cones `|u_group| <= |x_group| + t_group`.
///
/// The point itself satisfies them with `t = 0`, so that no certificate of infeasibility exists. Without `|x_group|` there
/// is nearly one where deviations are some 1e5 units of the step, and clarabel takes it for one.
pub fn pose(program: &mut Program, frame: &Frame, weight: f64, groups: &[Group]) {
    for group in groups {
        // One size for the whole cone: its rows may not be scaled apart.
        let size = group.members.iter().fold(f64::MIN_POSITIVE, |a, &i| a.max(frame.unit[i]));
        let bound = program.variable(0.0, weight * size);
        let tail = group.members.iter().map(|&i| (i, frame.unit[i] / size, frame.here.x[i] / size));
        let length = group.length(&frame.here.x) / size;
        program.within((Some((bound, 1.0)), length), tail, Owner::Nobody);
    }
}
