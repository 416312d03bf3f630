//! XML as URDF and MJCF use it: attributes that hold numbers, and where an element stands.

use super::error::{FormatError, Wrong, quoted};
use crate::files::units::LARGEST;
use crate::lie::{Se3, so3};
use nalgebra::{Matrix3, Vector3};
use roxmltree::{Document, Node};

/// A document and the name of its file.
pub struct Xml<'a> {
    pub file: &'a str,
    pub document: Document<'a>,
}

impl<'a> Xml<'a> {
    /// Parses `text`, whose outermost element must be called `root`.
    pub fn parse(file: &'a str, text: &'a str, root: &'static str) -> Result<Self, FormatError> {
        let whole = |wrong| FormatError { at: file.to_owned(), wrong };
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        if text.trim_start().starts_with("<?xml") && !text.starts_with("<?xml") {
            let why = "blanks or an empty line stand before <?xml ...?>, which must come first; remove them";
            return Err(whole(Wrong::NotXml(why.into())));
        }
        let document = Document::parse(text).map_err(|why| whole(Wrong::NotXml(why.to_string())))?;
        let found = document.root_element().tag_name().name();
        if found != root {
            return Err(whole(Wrong::Root { found: quoted(found), wanted: root }));
        }
        Ok(Self { file, document })
    }

    /// An error at an element.
    pub fn error(&self, node: Node<'_, '_>, wrong: Wrong) -> FormatError {
        let line = self.document.text_pos_at(node.range().start).row;
        let tag = node.tag_name().name();
        let named = match node.attribute("name") {
            Some(name) => format!("<{tag}> {}", quoted(name)),
            None => format!("<{tag}>"),
        };
        FormatError { at: format!("{} line {line} ({named})", self.file), wrong }
    }

    /// An error of the file as a whole.
    pub fn whole(&self, wrong: Wrong) -> FormatError {
        FormatError { at: self.file.to_owned(), wrong }
    }

    /// An attribute that must be there.
    pub fn text(&self, node: Node<'a, '_>, attribute: &'static str) -> Result<&'a str, FormatError> {
        node.attribute(attribute).ok_or_else(|| self.error(node, Wrong::NoAttribute(attribute)))
    }

    /// Any count of finite numbers of an attribute; `None` where it is left out.
    pub fn list(&self, node: Node<'_, '_>, attribute: &str) -> Result<Option<Vec<f64>>, FormatError> {
        let Some(text) = node.attribute(attribute) else { return Ok(None) };
        let number = |word: &str| word.parse::<f64>().ok().filter(|v| v.abs() <= LARGEST);
        let numbers: Option<Vec<f64>> = text.split_whitespace().map(number).collect();
        numbers.map(Some).ok_or_else(|| self.wrong_numbers(node, attribute, text, "finite numbers".into()))
    }

    /// Exactly `N` finite numbers of an attribute; `None` where it is left out.
    pub fn numbers<const N: usize>(
        &self,
        node: Node<'_, '_>,
        attribute: &str,
    ) -> Result<Option<[f64; N]>, FormatError> {
        let Some(list) = self.list(node, attribute)? else { return Ok(None) };
        let text = node.attribute(attribute).unwrap_or_default();
        let wanted = if N == 1 { "a number".to_owned() } else { format!("{N} numbers") };
        match list.try_into() {
            Ok(numbers) => Ok(Some(numbers)),
            Err(_) => Err(self.wrong_numbers(node, attribute, text, wanted)),
        }
    }

    /// One finite number.
    pub fn number(&self, node: Node<'_, '_>, attribute: &str) -> Result<Option<f64>, FormatError> {
        Ok(self.numbers::<1>(node, attribute)?.map(|[value]| value))
    }

    /// A direction of unit length.
    pub fn direction(
        &self,
        node: Node<'_, '_>,
        attribute: &'static str,
    ) -> Result<Option<Vector3<f64>>, FormatError> {
        let Some(numbers) = self.numbers::<3>(node, attribute)? else { return Ok(None) };
        let direction = Vector3::from(numbers);
        if direction.amax() < 1e-9 {
            return Err(self.error(node, Wrong::ZeroAxis(attribute)));
        }
        Ok(Some(direction.normalize()))
    }

    fn wrong_numbers(&self, node: Node<'_, '_>, attribute: &str, text: &str, wanted: String) -> FormatError {
        let (attribute, found) = (attribute.to_owned(), quoted(text));
        self.error(node, Wrong::Numbers { attribute, found, wanted })
    }
}

/// Child elements of this name.
pub fn children<'a, 'i>(node: Node<'a, 'i>, tag: &str) -> impl Iterator<Item = Node<'a, 'i>> {
    node.children().filter(move |child| child.is_element() && child.tag_name().name() == tag)
}

/// The first child element of this name.
pub fn child<'a, 'i>(node: Node<'a, 'i>, tag: &str) -> Option<Node<'a, 'i>> {
    children(node, tag).next()
}

/// Rotation by an angle (rad) about axis 0, 1 or 2.
pub fn turn(axis: usize, angle: f64) -> Matrix3<f64> {
    let mut w = Vector3::zeros();
    w[axis] = angle;
    so3::exp(&w)
}

/// The rotation that turns one unit vector into another the shortest way; half a turn where they are opposite.
pub fn shortest_turn(from: &Vector3<f64>, to: &Vector3<f64>) -> Matrix3<f64> {
    let (cross, cosine) = (so3::hat(&from.cross(to)), from.dot(to));
    if cosine < -1.0 + 1e-12 {
        let mut seed = Vector3::zeros();
        seed[from.iamin()] = 1.0;
        let axis = from.cross(&seed).normalize();
        return axis * axis.transpose() * 2.0 - Matrix3::identity();
    }
    Matrix3::identity() + cross + cross * cross / (1.0 + cosine)
}

/// A motion by its rotation and position.
pub fn motion(r: Matrix3<f64>, p: [f64; 3]) -> Se3 {
    Se3 { r, p: Vector3::from(p) }
}

/// Names, quoted and joined, not too many of them.
pub fn listed<'n>(names: impl Iterator<Item = &'n str>) -> String {
    const MOST: usize = 12;
    let mut names: Vec<String> = names.map(quoted).collect();
    let more = names.len().saturating_sub(MOST);
    names.truncate(MOST);
    let mut text = names.join(", ");
    if more > 0 {
        text.push_str(&format!(" and {more} more"));
    }
    if text.is_empty() { "none".into() } else { text }
}
