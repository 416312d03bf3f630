//! A serial chain of a URDF as a drawing.

use super::tree::chain;
use crate::files::Units;
use crate::formats::error::{FormatError, Wrong, quoted};
use crate::formats::xml::Xml;
use crate::formats::{Axis, Chain, Imported};
use crate::lie::Se3;

/// Name of the only limb.
const LIMB: &str = "arm";

/// Reads the chain from link `base`, whose frame is {S}, to link `tool`, whose frame is {T}; `file` names the text.
///
/// Home is the zero of all joints. Fixed joints are part of the links; branches off the chain are left aside.
pub fn read(file: &str, text: &str, base: &str, tool: &str) -> Result<Imported, FormatError> {
    let xml = Xml::parse(file, text, "robot")?;
    let mut at = Se3::identity();
    let mut axes = Vec::new();
    for joint in chain(&xml, base, tool)? {
        at = at * joint.before();
        if let Some(motion) = joint.motion {
            let mut axis = Axis::new(joint.name.to_owned(), motion, at.p, &(at.r * joint.leading_axis()));
            axis.range = joint.range;
            axes.push(axis);
        }
        at = at * joint.behind();
    }
    if axes.is_empty() {
        return Err(xml.whole(Wrong::NothingMoves { base: quoted(base), tool: quoted(tool) }));
    }
    let name = xml.document.root_element().attribute("name").map(str::to_owned);
    let (chain, notes) = Chain { axes, tool: at }.gathered(Units::SI);
    Ok(Imported {
        name,
        description: format!("Links {base} to {tool} of a URDF; home is the zero of all joints."),
        units: Units::SI,
        mechanism: chain.draw(LIMB, Units::SI),
        notes,
    })
}
