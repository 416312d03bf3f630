//! A model as a drawing.

use super::graph::Graph;
use super::limbs::{LimbPath, limbs};
use super::model::{Joint, JointKind, Model};
use super::ties::Ties;
use crate::files::values::{OneOrEach, RangeDrawing, RangeEntry};
use crate::files::{JointDrawing, LimbDrawing, MechanismDrawing, PoseDrawing, Units};
use crate::formats::Imported;
use crate::formats::error::{FormatError, Wrong, quoted};
use crate::formats::xml::{Xml, listed};
use crate::lie::Se3;

/// What of the model is the machine.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// Body whose frame is {S}; the world where it is left out.
    pub base: Option<&'a str>,
    /// Body or site whose frame is {T}.
    pub tool: &'a str,
    /// Driven joints, instead of those that the model's actuators drive.
    pub actuated: Option<&'a [String]>,
}

/// Reads the machine that `request` names; `file` names the text. Home is the model's initial configuration.
pub fn read(file: &str, text: &str, request: &Request<'_>) -> Result<Imported, FormatError> {
    let xml = Xml::parse(file, text, "mujoco")?;
    let model = Model::read(&xml)?;
    let mut ties = Ties::read(&xml, &model)?;
    let missing = |what, name: &str| {
        let known =
            listed(model.bodies.iter().map(|body| body.name.as_str()).chain(model.sites.keys().copied()));
        xml.whole(Wrong::Missing { what, found: quoted(name), known })
    };
    let base = match request.base {
        None => 0,
        Some(name) => model.body(name).ok_or_else(|| missing("body", name))?,
    };
    let (platform, tool) = match (model.body(request.tool), model.sites.get(request.tool)) {
        (Some(body), _) => (body, Se3::identity()),
        (None, Some((body, pose))) => (*body, *pose),
        (None, None) => return Err(missing("body or site", request.tool)),
    };
    let whole = |wrong| xml.whole(wrong);
    let mut graph = Graph::new(&model, &ties).map_err(whole)?;
    if graph.group[base] == graph.group[platform] {
        let why = format!("{} does not move against the base", quoted(request.tool));
        return Err(whole(Wrong::NotLimbs(why)));
    }
    let dead = graph.prune(graph.group[base], graph.group[platform]);
    let mut notes = std::mem::take(&mut ties.notes);
    if !dead.is_empty() {
        let names = listed(dead.iter().filter_map(|i| model.bodies.get(*i)).map(|body| body.name.as_str()));
        notes.push(format!("left aside, for they lead nowhere: {names}"));
    }
    let paths = limbs(&model, &ties, &graph, base, platform).map_err(whole)?;
    if paths.is_empty() {
        let why = format!("no chain of joints leads from the base to {}", quoted(request.tool));
        return Err(whole(Wrong::NotLimbs(why)));
    }
    let joints = || paths.iter().flat_map(|limb| &limb.joints);
    if let Some(name) = joints().filter_map(|joint| joint.name).find(|name| ties.coupled.contains(name)) {
        let why = format!("joint {} is coupled to another by an equality", quoted(name));
        return Err(whole(Wrong::NotLimbs(why)));
    }
    let mut driven: Vec<&str> = match request.actuated {
        Some(names) => names.iter().map(String::as_str).collect(),
        None => ties.driven.clone(),
    };
    if let Some(name) = driven.iter().find(|name| !joints().any(|joint| joint.name == Some(name))) {
        if request.actuated.is_some() {
            let known = listed(joints().filter_map(|joint| joint.name));
            return Err(whole(Wrong::Missing { what: "joint", found: quoted(name), known }));
        }
        notes.push(format!("the actuated joint {} is on no limb and left aside", quoted(name)));
    }
    if driven.is_empty() && paths.len() == 1 {
        notes.push("the model has no actuators: every joint of the chain counts as actuated".into());
        driven = joints().filter_map(|joint| joint.name).collect();
    }
    if let Some(ball) =
        joints().find(|j| j.kind == JointKind::Ball && j.name.is_some_and(|n| driven.contains(&n)))
    {
        let why = format!("the ball joint {} is actuated", quoted(ball.name.unwrap_or_default()));
        return Err(whole(Wrong::NotLimbs(why)));
    }
    // The tool in the frame of its group.
    let tool = graph.inside[platform] * tool;
    let limbs = named(&paths).into_iter().zip(&paths).map(|(name, path)| draw(name, path, &tool, &driven));
    Ok(Imported {
        name: xml.document.root_element().attribute("model").map(str::to_owned),
        description: format!(
            "MJCF model, {} to {}; home is its initial configuration.",
            request.base.unwrap_or("world"),
            request.tool
        ),
        units: Units::SI,
        mechanism: MechanismDrawing {
            tool: paths.first().map(|path| PoseDrawing::of(&(path.platform * tool), Units::SI)),
            limbs: limbs.collect(),
            ..MechanismDrawing::default()
        },
        notes,
    })
}

/// A name for each limb: its first body's, where those are all there and differ.
fn named(paths: &[LimbPath<'_>]) -> Vec<String> {
    let own: Vec<&str> = paths.iter().filter_map(|path| path.name.as_deref()).collect();
    let differ = own.iter().enumerate().all(|(i, name)| !own.iter().take(i).any(|other| other == name));
    if own.len() == paths.len() && differ {
        return own.into_iter().map(str::to_owned).collect();
    }
    (1..=paths.len()).map(|number| format!("limb{number}")).collect()
}

fn draw(name: String, path: &LimbPath<'_>, tool: &Se3, driven: &[&str]) -> LimbDrawing {
    LimbDrawing {
        name: Some(name),
        tool: Some(PoseDrawing::of(&(path.platform * *tool), Units::SI)),
        joints: path.joints.iter().map(|joint| draw_joint(joint, driven)).collect(),
        ..LimbDrawing::default()
    }
}

fn draw_joint(joint: &Joint<'_>, driven: &[&str]) -> JointDrawing {
    let actuated = joint.name.is_some_and(|name| driven.contains(&name));
    let kind = match joint.kind {
        JointKind::Slide => "prismatic",
        JointKind::Ball => "spherical",
        JointKind::Hinge | JointKind::Free => "revolute",
    };
    let ball = joint.kind == JointKind::Ball;
    let range = joint.range.filter(|_| actuated);
    JointDrawing {
        name: joint.name.map(str::to_owned),
        kind: kind.to_owned(),
        point: joint.point.into(),
        axis: (!ball).then(|| joint.axis.into()),
        axes: ball.then(|| vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        actuated: actuated.then_some(OneOrEach::One(true)),
        home: (actuated && joint.reference != 0.0).then_some(OneOrEach::One(joint.reference)),
        range: range.map(|(low, high)| RangeDrawing(vec![RangeEntry::Limit(low), RangeEntry::Limit(high)])),
        ..JointDrawing::default()
    }
}
