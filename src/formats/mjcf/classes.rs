//! Default classes, and the compiler's settings.

use crate::formats::error::{FormatError, Wrong, quoted};
use crate::formats::xml::{Xml, child, children};
use roxmltree::Node;
use std::collections::HashMap;

/// What `<compiler>` says of angles.
#[derive(Clone, Copy, Debug)]
pub struct Compiler<'a> {
    /// rad of one unit of the file's angles.
    pub angle: f64,
    /// Axes of Euler angles, capital letters for fixed ones.
    pub sequence: &'a str,
    /// Whether a stated range is a limit.
    pub autolimits: bool,
}

impl<'a> Compiler<'a> {
    pub fn read(xml: &Xml<'_>, model: Node<'a, '_>) -> Result<Self, FormatError> {
        let mut compiler = Self { angle: 1f64.to_radians(), sequence: "xyz", autolimits: true };
        for node in children(model, "compiler") {
            match node.attribute("angle") {
                None => {}
                Some("radian") => compiler.angle = 1.0,
                Some("degree") => compiler.angle = 1f64.to_radians(),
                Some(other) => {
                    let (name, known) = ("angle", "radian, degree");
                    return Err(xml.error(node, Wrong::Unknown { name, found: quoted(other), known }));
                }
            }
            if node.attribute("coordinate") == Some("global") {
                let why = "global coordinates; save the model with local ones".to_owned();
                return Err(xml.error(node, Wrong::Unsupported(why)));
            }
            compiler.autolimits =
                node.attribute("autolimits").map_or(compiler.autolimits, |text| text != "false");
            if let Some(sequence) = node.attribute("eulerseq") {
                if sequence.len() != 3 || !sequence.chars().all(|c| "xyzXYZ".contains(c)) {
                    let (name, known) = ("eulerseq", "three letters of xyz or XYZ");
                    return Err(xml.error(node, Wrong::Unknown { name, found: quoted(sequence), known }));
                }
                compiler.sequence = sequence;
            }
        }
        Ok(compiler)
    }
}

/// A class: the element that states its defaults, and the class around it.
struct Class<'a, 'i> {
    node: Node<'a, 'i>,
    parent: Option<&'a str>,
}

/// All default classes by name.
pub struct Classes<'a, 'i>(HashMap<&'a str, Class<'a, 'i>>);

/// Name of the outermost class.
const MAIN: &str = "main";

impl<'a, 'i> Classes<'a, 'i> {
    pub fn read(model: Node<'a, 'i>) -> Self {
        let mut classes = HashMap::new();
        let mut open: Vec<(Node<'a, 'i>, Option<&'a str>)> =
            children(model, "default").map(|node| (node, None)).collect();
        while let Some((node, parent)) = open.pop() {
            let name = node.attribute("class").unwrap_or(MAIN);
            open.extend(children(node, "default").map(|inner| (inner, Some(name))));
            classes.insert(name, Class { node, parent });
        }
        Self(classes)
    }

    /// The element that states `attribute` for `node`: the node itself, or the nearest default of its class.
    pub fn stating(
        &self,
        node: Node<'a, 'i>,
        inherited: Option<&'a str>,
        attribute: &str,
    ) -> Option<Node<'a, 'i>> {
        if node.has_attribute(attribute) {
            return Some(node);
        }
        let mut name = node.attribute("class").or(inherited).unwrap_or(MAIN);
        // As many steps as there are classes: a class within itself cannot be nested.
        for _ in 0..=self.0.len() {
            let class = self.0.get(name)?;
            if let Some(found) =
                child(class.node, node.tag_name().name()).filter(|d| d.has_attribute(attribute))
            {
                return Some(found);
            }
            name = class.parent?;
        }
        None
    }

    /// Refuses a class that is not there.
    pub fn check(
        &self,
        xml: &Xml<'_>,
        node: Node<'_, '_>,
        attribute: &'static str,
    ) -> Result<(), FormatError> {
        match node.attribute(attribute) {
            Some(name) if name != MAIN && !self.0.contains_key(name) => {
                let known = crate::formats::xml::listed(self.0.keys().copied());
                Err(xml.error(node, Wrong::Missing { what: "default class", found: quoted(name), known }))
            }
            _ => Ok(()),
        }
    }
}
