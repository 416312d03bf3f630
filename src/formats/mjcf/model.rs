//! Bodies, joints and sites of a model, with defaults and units resolved.

use super::classes::{Classes, Compiler};
use super::orientation;
use crate::formats::error::{FormatError, Wrong, quoted};
use crate::formats::xml::Xml;
use crate::lie::Se3;
use nalgebra::Vector3;
use roxmltree::Node;
use std::collections::HashMap;

/// Bodies that may be nested in each other.
const DEEPEST: usize = 500;

/// What a joint lets move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    Hinge,
    Slide,
    Ball,
    Free,
}

/// A joint between a body and its parent: in the frame of the body, as part of a limb in {S}.
#[derive(Clone, Debug)]
pub struct Joint<'a> {
    pub name: Option<&'a str>,
    pub kind: JointKind,
    /// m.
    pub point: Vector3<f64>,
    /// A unit vector.
    pub axis: Vector3<f64>,
    /// rad or m.
    pub range: Option<(f64, f64)>,
    /// Reading in the model's initial configuration, rad or m.
    pub reference: f64,
}

/// A body; number 0 is the world.
#[derive(Clone, Debug)]
pub struct Body<'a> {
    pub name: String,
    pub parent: usize,
    /// In the parent's frame, in the initial configuration.
    pub pose: Se3,
    /// In the world's frame, likewise.
    pub world: Se3,
    pub joints: Vec<Joint<'a>>,
}

/// All of a model that has to do with kinematics, equalities apart.
pub struct Model<'a> {
    pub bodies: Vec<Body<'a>>,
    /// Body and pose in it.
    pub sites: HashMap<&'a str, (usize, Se3)>,
}

struct Reader<'a, 'i> {
    xml: &'a Xml<'i>,
    compiler: Compiler<'a>,
    classes: Classes<'a, 'i>,
    model: Model<'a>,
}

/// Where children of an element go.
#[derive(Clone, Copy)]
struct Scope<'a> {
    body: usize,
    /// Pose of the surrounding frames in the body.
    frame: Se3,
    class: Option<&'a str>,
    depth: usize,
}

impl<'a> Model<'a> {
    pub fn read<'i>(xml: &'a Xml<'i>) -> Result<Self, FormatError> {
        let root = xml.document.root_element();
        if let Some(include) = root.descendants().find(|node| node.tag_name().name() == "include") {
            let why = "an included file; save the model as one file (mj_saveLastXML)".to_owned();
            return Err(xml.error(include, Wrong::Unsupported(why)));
        }
        let world = Body {
            name: "world".into(),
            parent: 0,
            pose: Se3::identity(),
            world: Se3::identity(),
            joints: Vec::new(),
        };
        let model = Model { bodies: vec![world], sites: HashMap::new() };
        let compiler = Compiler::read(xml, root)?;
        let mut reader = Reader { xml, compiler, classes: Classes::read(root), model };
        let scope = Scope { body: 0, frame: Se3::identity(), class: None, depth: 0 };
        for section in crate::formats::xml::children(root, "worldbody") {
            reader.children(section, scope)?;
        }
        Ok(reader.model)
    }

    /// Number of the body of this name.
    pub fn body(&self, name: &str) -> Option<usize> {
        self.bodies.iter().position(|body| body.name == name)
    }
}

impl<'a, 'i> Reader<'a, 'i> {
    fn children(&mut self, parent: Node<'a, 'i>, scope: Scope<'a>) -> Result<(), FormatError> {
        if scope.depth > DEEPEST {
            return Err(self.xml.error(parent, Wrong::Unsupported("bodies are nested too deeply".into())));
        }
        for node in parent.children().filter(Node::is_element) {
            match node.tag_name().name() {
                "body" => self.body(node, scope)?,
                "frame" => {
                    self.classes.check(self.xml, node, "childclass")?;
                    let frame = scope.frame * orientation::pose(self.xml, &self.compiler, node)?;
                    let class = node.attribute("childclass").or(scope.class);
                    self.children(node, Scope { frame, class, depth: scope.depth + 1, ..scope })?;
                }
                "joint" | "freejoint" => {
                    let joint = self.joint(node, scope)?;
                    if let Some(body) = self.model.bodies.get_mut(scope.body) {
                        body.joints.push(joint);
                    }
                }
                "site" => self.site(node, scope)?,
                tag @ ("replicate" | "attach" | "composite" | "flexcomp") => {
                    let why = format!("<{tag}> is a macro; save the compiled model (mj_saveLastXML)");
                    return Err(self.xml.error(node, Wrong::Unsupported(why)));
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn body(&mut self, node: Node<'a, 'i>, scope: Scope<'a>) -> Result<(), FormatError> {
        self.classes.check(self.xml, node, "childclass")?;
        let line = self.xml.document.text_pos_at(node.range().start).row;
        let name = node.attribute("name").map_or_else(|| format!("body at line {line}"), str::to_owned);
        if self.model.body(&name).is_some() {
            return Err(self.xml.error(node, Wrong::Twice(quoted(&name))));
        }
        if node.attribute("mocap") == Some("true") {
            let why = "a mocap body is moved from outside; fix it or give it joints".to_owned();
            return Err(self.xml.error(node, Wrong::Unsupported(why)));
        }
        let pose = scope.frame * orientation::pose(self.xml, &self.compiler, node)?;
        let above = self.model.bodies.get(scope.body).map_or(Se3::identity(), |body| body.world);
        let number = self.model.bodies.len();
        let (parent, world) = (scope.body, above * pose);
        self.model.bodies.push(Body { name, parent, pose, world, joints: Vec::new() });
        let class = node.attribute("childclass").or(scope.class);
        self.children(node, Scope { body: number, frame: Se3::identity(), class, depth: scope.depth + 1 })
    }

    fn joint(&self, node: Node<'a, 'i>, scope: Scope<'a>) -> Result<Joint<'a>, FormatError> {
        let xml = self.xml;
        self.classes.check(xml, node, "class")?;
        let name = node.attribute("name");
        let stating = |attribute| self.classes.stating(node, scope.class, attribute);
        let text = |attribute| stating(attribute).and_then(|node| node.attribute(attribute));
        let free = node.tag_name().name() == "freejoint";
        let kind = match text("type") {
            _ if free => JointKind::Free,
            None | Some("hinge") => JointKind::Hinge,
            Some("slide") => JointKind::Slide,
            Some("ball") => JointKind::Ball,
            Some("free") => JointKind::Free,
            Some(other) => {
                let (name, known) = ("type", "hinge, slide, ball, free");
                return Err(xml.error(node, Wrong::Unknown { name, found: quoted(other), known }));
            }
        };
        if scope.body == 0 {
            return Err(xml.error(node, Wrong::Unsupported("the world has no joints".into())));
        }
        let point = stating("pos").map(|node| xml.numbers::<3>(node, "pos")).transpose()?.flatten();
        let axis = stating("axis").map(|node| xml.direction(node, "axis")).transpose()?.flatten();
        let unit = if kind == JointKind::Hinge { self.compiler.angle } else { 1.0 };
        let range = stating("range").map(|node| xml.numbers::<2>(node, "range")).transpose()?.flatten();
        let limited = match text("limited") {
            Some("true") => true,
            Some("false") => false,
            _ => self.compiler.autolimits,
        };
        if let Some([low, high]) = range.filter(|[low, high]| low > high) {
            return Err(xml.error(node, Wrong::RangeOrder(low, high)));
        }
        let reference = stating("ref").map(|node| xml.number(node, "ref")).transpose()?.flatten();
        Ok(Joint {
            name,
            kind,
            point: scope.frame.r * Vector3::from(point.unwrap_or_default()) + scope.frame.p,
            axis: scope.frame.r * axis.unwrap_or(Vector3::z()),
            range: range.filter(|_| limited).map(|[low, high]| (low * unit, high * unit)),
            reference: reference.unwrap_or(0.0) * unit,
        })
    }

    fn site(&mut self, node: Node<'a, 'i>, scope: Scope<'a>) -> Result<(), FormatError> {
        let Some(name) = node.attribute("name") else { return Ok(()) };
        let pose = scope.frame * orientation::pose(self.xml, &self.compiler, node)?;
        self.model.sites.insert(name, (scope.body, pose));
        Ok(())
    }
}
