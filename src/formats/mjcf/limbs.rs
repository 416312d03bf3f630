//! Limbs: paths of joints from the base to the platform that share nothing else.

use super::graph::{Edge, Graph};
use super::model::{Body, Joint, JointKind, Model};
use super::ties::Ties;
use crate::formats::Wrong;
use crate::formats::error::quoted;
use crate::lie::Se3;
use nalgebra::Vector3;

/// A limb.
#[derive(Clone, Debug)]
pub struct LimbPath<'a> {
    /// Of its first body, where that has joints and a name.
    pub name: Option<String>,
    /// In {S} at home, axes in the sense in which the joints read.
    pub joints: Vec<Joint<'a>>,
    /// Pose of the platform's group in {S} at home.
    pub platform: Se3,
}

/// The limbs between the groups of `base` and `platform`; {S} is the frame of body `base`.
pub fn limbs<'a>(
    model: &Model<'a>,
    ties: &Ties<'a>,
    graph: &Graph,
    base: usize,
    platform: usize,
) -> Result<Vec<LimbPath<'a>>, Wrong> {
    let (start, end) = (graph.group[base], graph.group[platform]);
    let mut used = vec![false; graph.edges.len()];
    let mut limbs = Vec::new();
    for first in 0..graph.edges.len() {
        let (_, a, b) = graph.edges[first];
        if used[first] || (a != start && b != start) {
            continue;
        }
        let mut limb = LimbPath { name: None, joints: Vec::new(), platform: graph.inside[base].inverse() };
        let (mut here, mut next) = (start, first);
        loop {
            used[next] = true;
            let (edge, a, _) = graph.edges[next];
            limb.pass(model, ties, graph, edge, a == here);
            here = if a == here { graph.edges[next].2 } else { a };
            if here == end || here == start {
                break;
            }
            let open: Vec<usize> = (0..graph.edges.len())
                .filter(|&i| !used[i] && (graph.edges[i].1 == here || graph.edges[i].2 == here))
                .collect();
            next = match open.as_slice() {
                [only] => *only,
                _ => return Err(branching(model, graph, here, open.len() + 1)),
            };
        }
        if here == start {
            let why = format!(
                "a loop leaves the base and returns to it without the platform, through {}",
                limb.words()
            );
            return Err(Wrong::NotLimbs(why));
        }
        limbs.push(limb);
    }
    if let Some(at) = used.iter().position(|used| !used) {
        let (_, a, b) = graph.edges[at];
        let why = format!(
            "{} and {} belong to a loop that does not pass through the base",
            group_name(model, graph, a),
            group_name(model, graph, b)
        );
        return Err(Wrong::NotLimbs(why));
    }
    Ok(limbs)
}

fn group_name(model: &Model<'_>, graph: &Graph, group: usize) -> String {
    let first = graph.group.iter().position(|g| *g == group);
    quoted(first.and_then(|i| model.bodies.get(i)).map_or("", |body| body.name.as_str()))
}

fn branching(model: &Model<'_>, graph: &Graph, group: usize, chains: usize) -> Wrong {
    Wrong::NotLimbs(format!(
        "{chains} chains meet at body {}, which is neither base nor platform; a limb is one chain from base to \
         platform (name another --tool, or redraw a parallelogram as one rod)",
        group_name(model, graph, group)
    ))
}

impl<'a> LimbPath<'a> {
    /// Walks along an edge, from its first group to its second if `forward`.
    fn pass(&mut self, model: &Model<'a>, ties: &Ties<'a>, graph: &Graph, edge: Edge, forward: bool) {
        match edge {
            Edge::Joints(number) => {
                let Some(body) = model.bodies.get(number) else { return };
                if self.joints.is_empty() && forward {
                    self.name = Some(body.name.clone());
                }
                self.pass_joints(body, &graph.inside[body.parent], &graph.inside[number], forward);
            }
            Edge::Connect(number) => {
                let Some(tie) = ties.ties.get(number) else { return };
                let ((a, b), Some(point)) = (tie.bodies, tie.point) else { return };
                let (from, to) = (graph.inside[a], graph.inside[b]);
                let first = match forward {
                    true => self.platform * from,
                    false => self.platform * to * tie.relative.inverse(),
                };
                let point = first.r * point + first.p;
                let (kind, axis) = (JointKind::Ball, Vector3::z());
                self.joints.push(Joint { name: tie.name, kind, point, axis, range: None, reference: 0.0 });
                self.platform = match forward {
                    true => first * tie.relative * to.inverse(),
                    false => first * from.inverse(),
                };
            }
        }
    }

    fn pass_joints(&mut self, body: &Body<'a>, parent: &Se3, child: &Se3, forward: bool) {
        let frame = match forward {
            true => self.platform * *parent * body.pose,
            false => self.platform * *child,
        };
        let seen = |joint: &Joint<'a>| Joint {
            point: frame.r * joint.point + frame.p,
            // From the child the parent is seen to move the other way.
            axis: frame.r * joint.axis * if forward { 1.0 } else { -1.0 },
            ..joint.clone()
        };
        match forward {
            true => self.joints.extend(body.joints.iter().map(seen)),
            false => self.joints.extend(body.joints.iter().rev().map(seen)),
        }
        self.platform = match forward {
            true => frame * child.inverse(),
            false => frame * body.pose.inverse() * parent.inverse(),
        };
    }

    fn words(&self) -> String {
        crate::formats::xml::listed(
            self.joints.iter().map(|joint| joint.name.unwrap_or("a joint without a name")),
        )
    }
}
