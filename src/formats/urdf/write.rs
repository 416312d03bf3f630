//! A URDF of a machine, from nothing: links without shapes, a joint frame on every axis.

use super::{escaped, origin_element};
use crate::formats::{Chain, Wrong};
use crate::lie::Se3;
use crate::model::{Mechanism, Motion};

/// Half of the range that a prismatic joint without one is given, m: URDF wants limits.
const WIDE: f64 = 10.0;

/// The URDF of a serial machine: link `base_link` is {S}, link `tool` is {T}, joints read what the actuators read.
pub fn write(name: &str, mechanism: &Mechanism) -> Result<String, Wrong> {
    let chain = Chain::of(mechanism, "URDF")?;
    let mut text = format!("<?xml version=\"1.0\"?>\n<robot name=\"{}\">\n", escaped(name));
    text.push_str("  <link name=\"base_link\"/>\n");
    let (mut at, mut parent) = (Se3::identity(), "base_link".to_owned());
    for (index, axis) in chain.axes.iter().enumerate() {
        let link = format!("link_{}", index + 1);
        let (kind, limits) = match (axis.motion, axis.range) {
            (Motion::Prismatic, range) => ("prismatic", Some(range.unwrap_or((-WIDE, WIDE)))),
            (_, Some(range)) => ("revolute", Some(range)),
            (_, None) => ("continuous", None),
        };
        let mut own = "    <axis xyz=\"0 0 1\"/>\n".to_owned();
        if let Some((low, high)) = limits {
            own.push_str(&format!(
                "    <limit lower=\"{low:?}\" upper=\"{high:?}\" effort=\"0\" velocity=\"0\"/>\n"
            ));
        }
        text.push_str(&joint(&axis.name, kind, (&parent, &link), &(at.inverse() * axis.frame), &own));
        (at, parent) = (axis.frame, link);
    }
    text.push_str(&joint("tool_mount", "fixed", (&parent, "tool"), &(at.inverse() * chain.tool), ""));
    text.push_str("</robot>\n");
    Ok(text)
}

fn joint(name: &str, kind: &str, (parent, link): (&str, &str), origin: &Se3, own: &str) -> String {
    format!(
        "  <link name=\"{link}\"/>\n  <joint name=\"{}\" type=\"{kind}\">\n    {}\n    <parent link=\"{parent}\"/>\n    \
         <child link=\"{link}\"/>\n{own}  </joint>\n",
        escaped(name),
        origin_element(origin)
    )
}
