//! Equality constraints that close loops, and the joints that actuators drive.

use super::model::Model;
use super::orientation::quaternion;
use crate::formats::error::{FormatError, Wrong, quoted};
use crate::formats::xml::{Xml, children, listed};
use crate::lie::Se3;
use nalgebra::Vector3;
use roxmltree::Node;

/// Two bodies held together.
#[derive(Clone, Debug)]
pub struct Tie<'a> {
    pub name: Option<&'a str>,
    pub bodies: (usize, usize),
    /// The second body in the frame of the first, in the initial configuration as the constraint wants it.
    pub relative: Se3,
    /// The point of a `connect` in the frame of the first body; `None` for a `weld`.
    pub point: Option<Vector3<f64>>,
}

/// Ties, joints that take part in a coupling, and driven joints.
#[derive(Debug, Default)]
pub struct Ties<'a> {
    pub ties: Vec<Tie<'a>>,
    pub coupled: Vec<&'a str>,
    pub driven: Vec<&'a str>,
    /// What was left aside, in words.
    pub notes: Vec<String>,
}

impl<'a> Ties<'a> {
    pub fn read(xml: &'a Xml<'_>, model: &Model<'a>) -> Result<Self, FormatError> {
        let root = xml.document.root_element();
        let mut found = Ties::default();
        for node in children(root, "equality").flat_map(|section| section.children()).filter(Node::is_element)
        {
            if node.attribute("active") == Some("false") {
                continue;
            }
            match node.tag_name().name() {
                "connect" | "weld" => found.ties.push(tie(xml, model, node)?),
                "joint" => {
                    found.coupled.extend(["joint1", "joint2"].iter().filter_map(|key| node.attribute(*key)));
                }
                other => found.notes.push(format!("equality <{other}> is left aside")),
            }
        }
        for node in children(root, "actuator").flat_map(|section| section.children()).filter(Node::is_element)
        {
            match node.attribute("joint").or_else(|| node.attribute("jointinparent")) {
                Some(joint) if found.driven.contains(&joint) => {}
                Some(joint) => found.driven.push(joint),
                None => {
                    let name = quoted(node.attribute("name").unwrap_or_else(|| node.tag_name().name()));
                    found.notes.push(format!("actuator {name} drives no joint and is left aside"));
                }
            }
        }
        Ok(found)
    }
}

fn tie<'a>(xml: &'a Xml<'_>, model: &Model<'a>, node: Node<'a, '_>) -> Result<Tie<'a>, FormatError> {
    let connect = node.tag_name().name() == "connect";
    let name = node.attribute("name");
    let world = |number: usize| model.bodies.get(number).map_or(Se3::identity(), |body| body.world);
    if let Some(first) = node.attribute("site1") {
        let site = |name: &str| {
            model.sites.get(name).copied().ok_or_else(|| {
                let known = listed(model.sites.keys().copied());
                xml.error(node, Wrong::Missing { what: "site", found: quoted(name), known })
            })
        };
        let ((a, in_a), (b, in_b)) = (site(first)?, site(xml.text(node, "site2")?)?);
        let mut turn = in_a.r * in_b.r.transpose();
        if connect {
            turn = world(a).r.transpose() * world(b).r;
        }
        let relative = Se3 { r: turn, p: in_a.p - turn * in_b.p };
        return Ok(Tie { name, bodies: (a, b), relative, point: connect.then_some(in_a.p) });
    }
    let body = |attribute: &'static str| match node.attribute(attribute) {
        None if attribute == "body2" => Ok(0),
        None => Err(xml.error(node, Wrong::NoAttribute(attribute))),
        Some(name) => model.body(name).ok_or_else(|| {
            let known = listed(model.bodies.iter().map(|body| body.name.as_str()));
            xml.error(node, Wrong::Missing { what: "body", found: quoted(name), known })
        }),
    };
    let (a, b) = (body("body1")?, body("body2")?);
    let mut relative = world(a).inverse() * world(b);
    if connect {
        let point =
            xml.numbers::<3>(node, "anchor")?.ok_or_else(|| xml.error(node, Wrong::NoAttribute("anchor")))?;
        return Ok(Tie { name, bodies: (a, b), relative, point: Some(Vector3::from(point)) });
    }
    if let Some([x, y, z, q @ ..]) = xml.numbers::<7>(node, "relpose")?
        && let Some(r) = quaternion(q)
    {
        relative = Se3 { r, p: Vector3::new(x, y, z) };
    }
    Ok(Tie { name, bodies: (a, b), relative, point: None })
}
