//! Second-order cones: limits on the length of a link's deviation.

use super::loss::Frame;
use super::program::{Owner, Program};
use crate::problem::Group;

/// Adds `|u_group| <= limit` for every group.
pub fn pose(program: &mut Program, frame: &Frame, limit: f64, groups: &[Group]) {
    for (g, group) in groups.iter().enumerate() {
        let size = group.members.iter().fold(f64::MIN_POSITIVE, |a, &i| a.max(frame.unit[i]));
        let tail = group.members.iter().map(|&i| (i, frame.unit[i] / size, frame.here.x[i] / size));
        program.within((None, limit / size), tail, Owner::Group(g));
    }
}
