//! The chain of joints that leads from one link of a URDF to another.

use super::from_rpy;
use crate::formats::error::{FormatError, Wrong, quoted};
use crate::formats::xml::{Xml, child, children, listed, motion};
use crate::lie::Se3;
use crate::model::Motion;
use nalgebra::Vector3;
use roxmltree::Node;
use std::collections::HashMap;

/// A joint of the chain.
pub struct ChainJoint<'a, 'i> {
    pub node: Node<'a, 'i>,
    pub name: &'a str,
    /// `None` for a fixed joint.
    pub motion: Option<Motion>,
    /// Of the joint's frame in the parent link.
    pub origin: Se3,
    /// Whether the chain leads from the child link to the parent link.
    pub upwards: bool,
    /// Unit vector in the joint's frame.
    pub axis: Vector3<f64>,
    pub range: Option<(f64, f64)>,
}

impl ChainJoint<'_, '_> {
    /// From the link where the chain comes from to the joint's frame.
    pub fn before(&self) -> Se3 {
        if self.upwards { Se3::identity() } else { self.origin }
    }

    /// From the joint's frame, moved, to the link where the chain goes on.
    pub fn behind(&self) -> Se3 {
        if self.upwards { self.origin.inverse() } else { Se3::identity() }
    }

    /// The axis about or along which what follows moves with the joint's reading.
    pub fn leading_axis(&self) -> Vector3<f64> {
        if self.upwards { -self.axis } else { self.axis }
    }
}

/// The joints from link `base` to link `tool`: up to the link that is above both, and down from there.
pub fn chain<'a, 'i>(
    xml: &'a Xml<'i>,
    base: &'a str,
    tool: &'a str,
) -> Result<Vec<ChainJoint<'a, 'i>>, FormatError> {
    let robot = xml.document.root_element();
    if let Some(source) =
        robot.children().find(|n| n.tag_name().namespace().is_some_and(|ns| ns.contains("xacro")))
    {
        return Err(xml.error(source, Wrong::Xacro));
    }
    let mut links: Vec<&str> = Vec::new();
    for node in children(robot, "link") {
        let name = xml.text(node, "name")?;
        if links.contains(&name) {
            return Err(xml.error(node, Wrong::Twice(quoted(name))));
        }
        links.push(name);
    }
    for wanted in [base, tool] {
        if !links.contains(&wanted) {
            let (found, known) = (quoted(wanted), listed(links.iter().copied()));
            return Err(xml.whole(Wrong::Missing { what: "link", found, known }));
        }
    }
    let mut above: HashMap<&str, (Node<'a, 'i>, &str)> = HashMap::new();
    let mut names: Vec<&str> = Vec::new();
    for node in children(robot, "joint") {
        let name = xml.text(node, "name")?;
        if names.contains(&name) {
            return Err(xml.error(node, Wrong::Twice(quoted(name))));
        }
        names.push(name);
        let end = |tag: &'static str| {
            let end = child(node, tag).ok_or_else(|| {
                xml.error(node, Wrong::Unsupported(format!("no <{tag} link=\"...\"/>; name the {tag} link")))
            })?;
            let link = xml.text(end, "link")?;
            if links.contains(&link) {
                Ok(link)
            } else {
                let (found, known) = (quoted(link), listed(links.iter().copied()));
                Err(xml.error(end, Wrong::Missing { what: "link", found, known }))
            }
        };
        let (parent, below) = (end("parent")?, end("child")?);
        if let Some((first, _)) = above.insert(below, (node, parent)) {
            let first = quoted(first.attribute("name").unwrap_or_default());
            let (link, second) = (quoted(below), quoted(name));
            return Err(xml.error(node, Wrong::TwoParents { link, first, second }));
        }
    }
    // The links from one up to the root, each with the joint above it.
    let way = |from: &'a str| {
        let mut way: Vec<(&str, Option<Node<'a, 'i>>)> = Vec::new();
        let mut at = from;
        // Joints may lead round.
        while let Some((joint, parent)) = above.get(at).filter(|_| way.iter().all(|(link, _)| *link != at)) {
            way.push((at, Some(*joint)));
            at = parent;
        }
        if !way.iter().any(|(link, _)| *link == at) {
            way.push((at, None));
        }
        way
    };
    let (up, down) = (way(base), way(tool));
    let met = up
        .iter()
        .enumerate()
        .find_map(|(i, (link, _))| down.iter().position(|(other, _)| other == link).map(|j| (i, j)));
    let Some((i, j)) = met else {
        let above = |way: &[(&str, Option<Node<'a, 'i>>)]| listed(way.iter().skip(1).map(|(link, _)| *link));
        let (base, tool) = (quoted(base), quoted(tool));
        return Err(xml.whole(Wrong::NoChain {
            base,
            tool,
            above_base: above(&up),
            above_tool: above(&down),
        }));
    };
    let climbed = up[..i].iter().filter_map(|(_, joint)| joint.map(|joint| (joint, true)));
    let descended = down[..j].iter().rev().filter_map(|(_, joint)| joint.map(|joint| (joint, false)));
    climbed.chain(descended).map(|(node, upwards)| read_joint(xml, node, upwards)).collect()
}

fn read_joint<'a, 'i>(
    xml: &Xml<'i>,
    node: Node<'a, 'i>,
    upwards: bool,
) -> Result<ChainJoint<'a, 'i>, FormatError> {
    let name = node.attribute("name").unwrap_or_default();
    let kind = node.attribute("type").ok_or_else(|| xml.error(node, Wrong::NoAttribute("type")))?;
    let motion = match kind {
        "revolute" | "continuous" => Some(Motion::Revolute),
        "prismatic" => Some(Motion::Prismatic),
        "fixed" => None,
        _ => return Err(xml.error(node, Wrong::JointKind { joint: quoted(name), kind: quoted(kind) })),
    };
    if let (Some(mimic), Some(_)) = (child(node, "mimic"), motion) {
        let leader = quoted(mimic.attribute("joint").unwrap_or_default());
        return Err(xml.error(node, Wrong::Mimic { joint: quoted(name), leader }));
    }
    let origin = match child(node, "origin") {
        None => Se3::identity(),
        Some(origin) => place(xml, origin)?,
    };
    // The axis of a fixed joint means nothing.
    let axis = match child(node, "axis").filter(|_| motion.is_some()) {
        Some(axis) => xml.direction(axis, "xyz")?.unwrap_or(Vector3::x()),
        None => Vector3::x(),
    };
    let range = match child(node, "limit") {
        Some(limit) if kind == "revolute" || kind == "prismatic" => {
            match (xml.number(limit, "lower")?, xml.number(limit, "upper")?) {
                (None, None) => None,
                (lower, upper) => Some((lower.unwrap_or(0.0), upper.unwrap_or(0.0))),
            }
        }
        _ => None,
    };
    if let Some((low, high)) = range.filter(|(low, high)| low > high) {
        return Err(xml.error(node, Wrong::RangeOrder(low, high)));
    }
    Ok(ChainJoint { node, name, motion, origin, upwards, axis, range })
}

fn place(xml: &Xml<'_>, origin: Node<'_, '_>) -> Result<Se3, FormatError> {
    let rpy = xml.numbers::<3>(origin, "rpy")?.unwrap_or_default();
    Ok(motion(from_rpy(rpy), xml.numbers::<3>(origin, "xyz")?.unwrap_or_default()))
}
