//! A calibrated machine written into the URDF that it came from: origins change, everything else stays.

use super::tree::{ChainJoint, chain};
use super::{escaped, origin_element};
use crate::formats::error::{FormatError, quoted};
use crate::formats::xml::{Xml, child, shortest_turn};
use crate::formats::{Axis, Chain, Wrong};
use crate::lie::Se3;
use crate::model::Mechanism;
use crate::model::mechanism::pose_difference;
use nalgebra::{Matrix3, Vector3};
use std::ops::Range;

/// Origins that agree to this (rad and m) keep their text.
const SAME: f64 = 1e-14;
/// Most iterations of a decomposition of 3 x 3.
const ITERATIONS: usize = 1000;

/// `text`, the URDF in `file`, with the origins of the chain from `base` to `tool` such that it moves as the machine.
///
/// The frame of a moving joint is brought onto the calibrated axis by the shortest way, so that shapes and inertias
/// fit as well as they can. The last fixed joint takes what is left at the tool; where the chain ends in a moving
/// joint, a fixed one is put behind it.
pub fn rewrite(
    file: &str,
    text: &str,
    base: &str,
    tool: &str,
    mechanism: &Mechanism,
) -> Result<String, FormatError> {
    let xml = Xml::parse(file, text, "robot")?;
    // A byte order mark is not part of what is parsed.
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let machine = Chain::of(mechanism, "URDF").map_err(|wrong| xml.whole(wrong))?;
    let joints = chain(&xml, base, tool)?;
    if let Some(joint) = joints.iter().find(|joint| joint.upwards) {
        let (base, joint) = (quoted(base), quoted(joint.name));
        return Err(xml.whole(Wrong::Upwards { base, joint }));
    }
    check_names(&joints, &machine).map_err(|wrong| xml.whole(wrong))?;
    let moved = registration(&joints, &machine);
    let mut edits = Vec::new();
    let (mut drawn, mut at) = (moved, Se3::identity());
    let mut axes = machine.axes.iter();
    let last_moving = joints.iter().rposition(|joint| joint.motion.is_some());
    for (index, joint) in joints.iter().enumerate() {
        drawn = drawn * joint.origin;
        let mut origin = joint.origin;
        if let Some(axis) = joint.motion.and_then(|_| axes.next()) {
            origin = at.inverse() * on_axis(&drawn, &joint.axis, axis);
        }
        let is_last = index + 1 == joints.len();
        if is_last && Some(index) != last_moving {
            origin = at.inverse() * machine.tool;
        }
        if apart(&origin, &joint.origin) > SAME {
            edits.push(origin_edit(joint, &origin));
        } else {
            origin = joint.origin;
        }
        at = at * origin;
    }
    if let Some(joint) = joints.last() {
        let left = at.inverse() * machine.tool;
        if apart(&left, &Se3::identity()) > SAME * joints.len() as f64 {
            edits.extend(mount(&xml, joint, &left)?);
        }
    }
    Ok(edited(text, edits))
}

fn check_names(joints: &[ChainJoint<'_, '_>], machine: &Chain) -> Result<(), Wrong> {
    let found: Vec<&str> = joints.iter().filter(|j| j.motion.is_some()).map(|j| j.name).collect();
    let wanted: Vec<&str> = machine.axes.iter().map(|axis| axis.name.as_str()).collect();
    let kinds = joints.iter().filter_map(|j| j.motion).eq(machine.axes.iter().map(|axis| axis.motion));
    if found == wanted && kinds {
        return Ok(());
    }
    Err(Wrong::OtherJoints { found: found.join(", "), wanted: wanted.join(", ") })
}

/// The motion of the template as a whole that brings its axes nearest to the machine's: {S} of a machine whose base
/// was free is that of the instrument.
fn registration(joints: &[ChainJoint<'_, '_>], machine: &Chain) -> Se3 {
    let (mut at, mut from, mut to) = (Se3::identity(), Vec::new(), Vec::new());
    let mut axes = machine.axes.iter();
    for joint in joints {
        at = at * joint.origin;
        if let Some(axis) = joint.motion.and_then(|_| axes.next()) {
            from.extend([at.p, at.p + at.r * joint.axis]);
            to.extend([axis.frame.p, axis.frame.p + axis.direction()]);
        }
    }
    let mean = |points: &[Vector3<f64>]| points.iter().sum::<Vector3<f64>>() / points.len().max(1) as f64;
    let (centre, target) = (mean(&from), mean(&to));
    let sum: Matrix3<f64> = from.iter().zip(&to).map(|(a, b)| (b - target) * (a - centre).transpose()).sum();
    let Some(svd) = sum.try_svd(true, true, 5.0 * f64::EPSILON, ITERATIONS) else { return Se3::identity() };
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Se3::identity() };
    // One axis alone leaves a turn about it open: the template then stays as it is.
    if svd.singular_values.iter().filter(|s| **s > 1e-9 * svd.singular_values.max()).count() < 2 {
        return Se3::identity();
    }
    let mut flip = Matrix3::identity();
    let smallest = svd.singular_values.argmin().0;
    flip[(smallest, smallest)] = (u * v_t).determinant().signum();
    let r = u * flip * v_t;
    Se3 { r, p: target - r * centre }
}

/// The joint's frame, turned and moved the shortest way so that its axis is the machine's.
fn on_axis(drawn: &Se3, local: &Vector3<f64>, axis: &Axis) -> Se3 {
    let (from, to) = (drawn.r * local, axis.direction());
    let turn = shortest_turn(&from, &to);
    let along = to.dot(&(drawn.p - axis.frame.p));
    let p = if axis.motion.is_angular() { axis.frame.p + to * along } else { drawn.p };
    let near = Se3 { r: turn * drawn.r, p };
    if apart(&near, drawn) > SAME { near } else { *drawn }
}

fn apart(a: &Se3, b: &Se3) -> f64 {
    let (w, v) = pose_difference(a, b);
    w.norm().max(v.norm())
}

type Edit = (Range<usize>, String);

fn origin_edit(joint: &ChainJoint<'_, '_>, origin: &Se3) -> Edit {
    let element = origin_element(origin);
    match child(joint.node, "origin") {
        Some(old) => (old.range(), element),
        None => {
            let start = joint.node.first_element_child().map_or(joint.node.range().end, |n| n.range().start);
            (start..start, element)
        }
    }
}

/// Puts a fixed joint with this origin between the last moving joint and its child link.
fn mount(xml: &Xml<'_>, joint: &ChainJoint<'_, '_>, origin: &Se3) -> Result<Vec<Edit>, FormatError> {
    let below =
        child(joint.node, "child").ok_or_else(|| xml.error(joint.node, Wrong::NoAttribute("child")))?;
    let link = escaped(xml.text(below, "link")?);
    let between = format!("{link}_axis");
    let added = format!(
        "\n  <link name=\"{between}\"/>\n  <joint name=\"{between}_mount\" type=\"fixed\">\n    {}\n    \
         <parent link=\"{between}\"/>\n    <child link=\"{link}\"/>\n  </joint>",
        origin_element(origin)
    );
    let end = joint.node.range().end;
    Ok(vec![(below.range(), format!("<child link=\"{between}\"/>")), (end..end, added)])
}

fn edited(text: &str, mut edits: Vec<Edit>) -> String {
    edits.sort_by_key(|(range, _)| range.start);
    let (mut out, mut done) = (String::with_capacity(text.len()), 0);
    for (range, replacement) in edits {
        out.push_str(text.get(done..range.start).unwrap_or_default());
        out.push_str(&replacement);
        done = range.end;
    }
    out.push_str(text.get(done..).unwrap_or_default());
    out
}
