//! From a drawing to the mechanism that it means.

use super::drawing::{JointDrawing, LimbDrawing, MechanismDrawing};
use super::error::{FileError, Location, quoted};
use super::fault::Fault;
use super::name;
use super::place::Place;
use super::tolerance::{BoundsDrawing, ToleranceDrawing};
use super::units::Units;
use crate::lie::Se3;
use crate::model::{Ends, Limb, Link, Mechanism, Tolerance};
use std::collections::HashSet;

/// Name of the last link of a limb.
pub const TOOL_LINK: &str = "tool";

/// A mechanism, and the first link of it for which no tolerance is stated (it is held until there is one).
#[derive(Clone, Debug)]
pub struct Drawn {
    /// The mechanism, rad and m.
    pub mechanism: Mechanism,
    /// Where the first tolerance is missing.
    pub without_tolerance: Option<Location>,
}

/// What is stated of links at a level of the drawing: the nearest statement counts.
#[derive(Clone, Copy, Debug, Default)]
struct Stated {
    tolerance: Option<Tolerance>,
    bounds: Option<(f64, f64)>,
}

impl Stated {
    fn read(
        tolerance: Option<&ToleranceDrawing>,
        bounds: Option<&BoundsDrawing>,
        prefix: &str,
        units: Units,
        at: &Place<'_>,
    ) -> Result<Self, FileError> {
        let (tolerance_key, bounds_key) = (format!("{prefix}tolerance"), format!("{prefix}bounds"));
        Ok(Self {
            tolerance: tolerance.map(|t| t.read(units, &at.key(&tolerance_key))).transpose()?,
            bounds: bounds.map(|b| b.read(units, &at.key(&bounds_key))).transpose()?,
        })
    }

    /// Refuses bounds stated at `at` for links that are held there or, where nothing is stated, by `general`.
    fn check_held(self, general: Self, prefix: &str, at: &Place<'_>) -> Result<Self, FileError> {
        if self.bounds.is_some() && self.tolerance.or(general.tolerance) == Some(Tolerance::HELD) {
            return Err(at.key(&format!("{prefix}bounds")).error(Fault::BoundsOnHeld));
        }
        Ok(self)
    }

    fn or(self, general: Self) -> Self {
        Self { tolerance: self.tolerance.or(general.tolerance), bounds: self.bounds.or(general.bounds) }
    }
}

/// What the mechanism states for all of its limbs.
struct General {
    tool: Option<Se3>,
    links: Stated,
    last: Stated,
}

impl MechanismDrawing {
    /// The mechanism that is drawn here, in rad and m.
    pub fn read(&self, units: Units, at: &Place<'_>) -> Result<Drawn, FileError> {
        if self.limbs.is_empty() {
            return Err(at.key("limbs").error(Fault::NoLimb));
        }
        let general = General {
            tool: self.tool.as_ref().map(|tool| tool.complete(units, &at.key("tool"))).transpose()?,
            links: Stated::read(self.tolerance.as_ref(), self.bounds.as_ref(), "", units, at)?,
            last: Stated::read(self.tool_tolerance.as_ref(), self.tool_bounds.as_ref(), "tool_", units, at)?,
        };
        let list = at.key("limbs");
        let mut names = HashSet::new();
        let mut without_tolerance = None;
        let mut limbs = Vec::with_capacity(self.limbs.len());
        for (i, drawing) in self.limbs.iter().enumerate() {
            let name = named(drawing.name.as_deref(), || format!("limb{}", i + 1));
            let entry = list.index(i);
            let here = entry.named(&name);
            check_name(&name, &mut names, &here)?;
            limbs.push(drawing.read(&name, &general, units, &mut without_tolerance, &here)?);
        }
        let end = |end: &Option<ToleranceDrawing>, key: &str| {
            end.map(|tolerance| tolerance.read(units, &at.key(key))).transpose()
        };
        let ends = Ends {
            placement: end(&self.placement, "placement")?,
            tool_mounting: end(&self.tool_mounting, "tool_mounting")?,
        };
        let mechanism = Mechanism { limbs, instrument: Vec::new(), ends };
        if mechanism.actuator_count() == 0 {
            return Err(at.error(Fault::NoActuator));
        }
        let mut actuators = HashSet::new();
        if let Some(twice) =
            mechanism.actuator_names().into_iter().find(|name| !actuators.insert(name.clone()))
        {
            return Err(at.error(Fault::DuplicateName(quoted(&twice))));
        }
        Ok(Drawn { mechanism, without_tolerance })
    }
}

impl LimbDrawing {
    fn read(
        &self,
        name: &str,
        general: &General,
        units: Units,
        without_tolerance: &mut Option<Location>,
        at: &Place<'_>,
    ) -> Result<Limb, FileError> {
        if self.joints.is_empty() {
            return Err(at.key("joints").error(Fault::NoJoint));
        }
        let own_tool = self.tool.as_ref().map(|tool| tool.complete(units, &at.key("tool"))).transpose()?;
        let tool = own_tool.or(general.tool).ok_or_else(|| at.error(Fault::NoTool))?;
        let links =
            Stated::read(self.tolerance.as_ref(), self.bounds.as_ref(), "", units, at)?.or(general.links);
        let last = Stated::read(self.tool_tolerance.as_ref(), self.tool_bounds.as_ref(), "tool_", units, at)?
            .check_held(general.last.or(links), "tool_", at)?
            .or(general.last)
            .or(links);
        let list = at.key("joints");
        let (mut drawn, mut names) = (HashSet::new(), HashSet::new());
        let mut chain = Chain {
            limb: Limb { name: name.to_owned(), joints: Vec::new(), links: Vec::new() },
            at: Se3::identity(),
            without_tolerance,
        };
        for (j, drawing) in self.joints.iter().enumerate() {
            let own = named(drawing.name.as_deref(), || format!("j{}", j + 1));
            let full = format!("{name}.{own}");
            let entry = list.index(j);
            let here = entry.named(&full);
            check_name(&own, &mut drawn, &here)?;
            let (first, inner) = drawing.stated(links, units, &here)?;
            for (k, joint) in drawing.equivalents(&own, units, &here)?.into_iter().enumerate() {
                check_name(&joint.name, &mut names, &here)?;
                let stated = if k == 0 { first } else { inner };
                chain.link(joint.name.clone(), &joint.frame, stated.or(links), &here);
                chain.limb.joints.push(joint);
            }
        }
        chain.link(TOOL_LINK.to_owned(), &tool, last, at);
        Ok(chain.limb)
    }
}

impl JointDrawing {
    /// What is stated of the link before the joint, and of those between its axes.
    fn stated(&self, general: Stated, units: Units, at: &Place<'_>) -> Result<(Stated, Stated), FileError> {
        let first = Stated::read(self.tolerance.as_ref(), self.bounds.as_ref(), "", units, at)?;
        let inner =
            Stated::read(self.inner_tolerance.as_ref(), self.inner_bounds.as_ref(), "inner_", units, at)?;
        Ok((first.check_held(general, "", at)?, inner.check_held(general, "inner_", at)?))
    }
}

/// A limb as it grows from the base.
struct Chain<'a> {
    limb: Limb,
    /// Frame at home behind the last joint.
    at: Se3,
    without_tolerance: &'a mut Option<Location>,
}

impl Chain<'_> {
    /// Adds the link that ends in the frame `to` (at home in {S}).
    fn link(&mut self, name: String, to: &Se3, stated: Stated, at: &Place<'_>) {
        if stated.tolerance.is_none() && self.without_tolerance.is_none() {
            *self.without_tolerance = Some(at.location());
        }
        self.limb.links.push(Link {
            name,
            nominal: self.at.inverse() * *to,
            tolerance: stated.tolerance.unwrap_or(Tolerance::HELD),
            bounds: stated.bounds,
        });
        self.at = *to;
    }
}

/// The name that is stated, without blanks around it, which cells of tables do not keep; or the usual one.
fn named(stated: Option<&str>, usual: impl FnOnce() -> String) -> String {
    stated.map_or_else(usual, |name| name.trim().to_owned())
}

/// Refuses a name that is none, and one that is taken.
fn check_name(name: &str, taken: &mut HashSet<String>, at: &Place<'_>) -> Result<(), FileError> {
    name::check(name, &at.key("name"))?;
    if !taken.insert(name.to_owned()) {
        return Err(at.key("name").error(Fault::DuplicateName(quoted(name))));
    }
    Ok(())
}
