//! Rigid groups of bodies, and the joints and connections between them.

use super::model::{JointKind, Model};
use super::ties::{Tie, Ties};
use crate::formats::Wrong;
use crate::formats::error::quoted;
use crate::lie::Se3;

/// What joins two groups.
#[derive(Clone, Copy, Debug)]
pub enum Edge {
    /// The joints of this body, between its parent and itself.
    Joints(usize),
    /// The tie of this number, a ball joint.
    Connect(usize),
}

/// Groups of bodies that move as one.
pub struct Graph {
    /// Group of each body.
    pub group: Vec<usize>,
    /// Pose of each body in the frame of its group.
    pub inside: Vec<Se3>,
    /// Edges with the groups at their ends, in order of the file.
    pub edges: Vec<(Edge, usize, usize)>,
}

impl Graph {
    pub fn new(model: &Model<'_>, ties: &Ties<'_>) -> Result<Self, Wrong> {
        let count = model.bodies.len();
        let mut graph =
            Self { group: (0..count).collect(), inside: vec![Se3::identity(); count], edges: Vec::new() };
        for (number, body) in model.bodies.iter().enumerate().skip(1) {
            if body.joints.is_empty() {
                graph.join(body.parent, number, &body.pose);
            }
        }
        for tie in ties.ties.iter().filter(|tie| tie.point.is_none()) {
            let (a, b) = tie.bodies;
            if !graph.join(a, b, &tie.relative) {
                return Err(over_constrained(model, tie, "weld"));
            }
        }
        for (number, body) in model.bodies.iter().enumerate().skip(1) {
            // A free joint constrains nothing.
            if body.joints.is_empty() || body.joints.iter().any(|joint| joint.kind == JointKind::Free) {
                continue;
            }
            let (from, to) = (graph.group[body.parent], graph.group[number]);
            if from == to {
                let why = format!(
                    "over-constrained: body {} has joints against its parent and is welded to it at once",
                    quoted(&body.name)
                );
                return Err(Wrong::NotLimbs(why));
            }
            graph.edges.push((Edge::Joints(number), from, to));
        }
        for (number, tie) in ties.ties.iter().enumerate().filter(|(_, tie)| tie.point.is_some()) {
            let (from, to) = (graph.group[tie.bodies.0], graph.group[tie.bodies.1]);
            if from == to {
                return Err(over_constrained(model, tie, "connect"));
            }
            graph.edges.push((Edge::Connect(number), from, to));
        }
        Ok(graph)
    }

    /// Makes one group of those of `a` and `b`, `relative` being the pose of `b` in `a`; false where they are one.
    fn join(&mut self, a: usize, b: usize, relative: &Se3) -> bool {
        let (keep, give) = (self.group[a], self.group[b]);
        if keep == give {
            return false;
        }
        let shift = self.inside[a] * *relative * self.inside[b].inverse();
        for (group, inside) in self.group.iter_mut().zip(&mut self.inside) {
            if *group == give {
                *group = keep;
                *inside = shift * *inside;
            }
        }
        true
    }

    /// Removes branches that lead nowhere; returns the bodies whose joints went with them.
    pub fn prune(&mut self, base: usize, platform: usize) -> Vec<usize> {
        let mut removed = Vec::new();
        loop {
            let degree =
                |group: usize| self.edges.iter().filter(|(_, a, b)| *a == group || *b == group).count();
            let dead = |group: usize| group != base && group != platform && degree(group) < 2;
            let Some(at) = self.edges.iter().position(|(_, a, b)| dead(*a) || dead(*b)) else {
                return removed;
            };
            if let (Edge::Joints(body), _, _) = self.edges.remove(at) {
                removed.push(body);
            }
        }
    }
}

fn over_constrained(model: &Model<'_>, tie: &Tie<'_>, kind: &str) -> Wrong {
    let name = |number: usize| quoted(model.bodies.get(number).map_or("", |body| body.name.as_str()));
    let (a, b) = tie.bodies;
    Wrong::NotLimbs(format!(
        "over-constrained: {kind} {} joins {} and {}, which are rigidly joined already",
        quoted(tie.name.unwrap_or_default()),
        name(a),
        name(b)
    ))
}
