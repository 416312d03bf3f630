//! Base and tool frames, and constants of the instrument, that are known to nobody, before any link moves.
//!
//! `measured_k = X g_k Y` over predicted poses `g_k`, in closed form by [`super::hand_eye`] or, where all rotations share an
//! axis, [`super::common_axis`]. Rotations that are small tell less than that: so the drawn tool and base are starts, too,
//! and `super::ends` refines them and takes the best. With positions only see
//! `targets`; fixed points and planes are placed by `references`.

use super::common_axis::placed;
use super::ends::Refinement;
use super::hand_eye::{self, Pair};
use super::references::place_references;
use super::targets::{free_targets, place_targets};
use super::untold::{Part, Untold};
use crate::calibration::{Sample, close_at};
use crate::lie::{Se3, so3};
use crate::measure::Clue;
use crate::model::{Mechanism, Posture, Prior, Tolerance};
use nalgebra::{Matrix3, Vector3};

/// Sharpness at which an axis, and no more, determines a rotation.
const SHARP: f64 = 1e-9;
/// Pull towards the tool as drawn: what relative rotations smaller than this tell is rounding.
const PULL: f64 = 1e-9;

/// Which ends of the machine stand free.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FreeEnds {
    /// Nothing is known of the placement, or of part of it, or every limb's first link has no prior.
    pub base: bool,
    /// Nothing is known of the tool's mounting, or of part of it, or every limb's last link has no prior.
    pub tool: bool,
}

impl FreeEnds {
    /// Reads them off the priors.
    pub fn of(mechanism: &Mechanism) -> Self {
        let free = |link: Option<&crate::model::Link>| {
            link.is_some_and(|l| l.tolerance.angle == Prior::Free && l.tolerance.length == Prior::Free)
        };
        let stated =
            |end: Option<Tolerance>| end.is_some_and(|t| t.angle == Prior::Free || t.length == Prior::Free);
        Self {
            base: stated(mechanism.ends.placement)
                || mechanism.limbs.iter().all(|limb| free(limb.links.first())),
            tool: stated(mechanism.ends.tool_mounting)
                || mechanism.limbs.iter().all(|limb| free(limb.links.last())),
        }
    }

    /// What of the free ends registration moves: of a placement or a mounting whose turn or displacement is stated that
    /// part stays as drawn.
    pub(super) fn parts(self, mechanism: &Mechanism) -> Vec<Part> {
        let of = |free: bool, stated: Option<Tolerance>, [turn, shift]: [Part; 2]| {
            let moves = |prior: Option<Prior>| prior.is_none_or(|prior| prior == Prior::Free);
            // A tolerance of both parts is that of a motion beside links that are free.
            let stated = stated.filter(|t| t.angle == Prior::Free || t.length == Prior::Free);
            let part = |part: Part, prior: Option<Prior>| (free && moves(prior)).then_some(part);
            [part(turn, stated.map(|t| t.angle)), part(shift, stated.map(|t| t.length))]
        };
        let ends = mechanism.ends;
        let base = of(self.base, ends.placement, [Part::BaseTurn, Part::BasePlace]);
        let tool = of(self.tool, ends.tool_mounting, [Part::ToolTurn, Part::ToolOffset]);
        base.into_iter().chain(tool).flatten().collect()
    }
}

/// Where base and tool stand, and the values of the instrument's constants.
#[derive(Clone, Debug)]
pub(super) struct Stand {
    /// In front of the machine as drawn.
    pub base: Se3,
    /// Behind it.
    pub tool: Se3,
    /// rad, m or 1.
    pub instrument: Vec<f64>,
}

impl Stand {
    /// The same with everything but `parts` as drawn.
    pub fn held(mut self, parts: &[Part]) -> Self {
        for (end, turn, place) in [
            (&mut self.base, Part::BaseTurn, Part::BasePlace),
            (&mut self.tool, Part::ToolTurn, Part::ToolOffset),
        ] {
            if !parts.contains(&turn) {
                end.r = Matrix3::identity();
            }
            if !parts.contains(&place) {
                end.p = Vector3::zeros();
            }
        }
        self
    }
}

/// A predicted tool pose and what was read there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sighting {
    /// Predicted by the machine as drawn.
    pub tool: Se3,
    /// What the reading says.
    pub clue: Clue,
}

/// The machine where the measurements say that it stands.
#[derive(Clone, Debug)]
pub struct Registration {
    /// The drawing with its free ends, and the instrument's free constants, moved there.
    pub machine: Mechanism,
    /// What was put in front of the drawing.
    pub base: Se3,
    /// What was put behind it.
    pub tool: Se3,
    /// What the measurements do not tell of base and tool: it was kept as drawn.
    pub untold: Vec<Untold>,
}

impl Registration {
    /// The machine as drawn: nothing is free.
    pub fn as_drawn(mechanism: &Mechanism) -> Self {
        let still = Se3::identity();
        Self { machine: mechanism.clone(), base: still, tool: still, untold: Vec::new() }
    }
}

/// The machine with its free ends, and the instrument's free constants, moved to where the measurements say that they
/// are; `None` where base or tool are free and the samples do not determine them.
///
/// Distances, touches and passive joints alone say nothing of base and tool: these then stay as drawn.
pub fn register(mechanism: &Mechanism, samples: &[Sample], free: FreeEnds) -> Option<Registration> {
    let geometry = mechanism.nominal();
    let mut posture = Posture::new(mechanism);
    let (mut sightings, mut seen) = (Vec::with_capacity(samples.len()), Vec::with_capacity(samples.len()));
    for sample in samples {
        // The measured pose lies elsewhere: the posture is sought from home.
        if close_at(mechanism, &geometry, &sample.actuators, None, &mut posture).is_ok() {
            let sighting = Sighting { tool: posture.tool(), clue: sample.measurement.clue() };
            if matches!(sighting.clue, Clue::Pose(_) | Clue::Position { .. } | Clue::None) {
                seen.push((sighting.tool, sample));
            }
            sightings.push(sighting);
        }
    }
    let ends = free.base || free.tool;
    let starts = starts(mechanism, &sightings, free)?;
    let mut found = Registration::as_drawn(mechanism);
    let free_constants = free_targets(mechanism, &sightings);
    let stand = match starts.first() {
        Some(_) if ends => {
            let length = mechanism.characteristic_length();
            let parts = free.parts(mechanism);
            let starts: Vec<Stand> = starts.into_iter().map(|start| start.held(&parts)).collect();
            let refinement = Refinement::new(seen, parts.clone(), free_constants, length);
            let (stand, untold) = refinement.best(&starts)?;
            found.untold = Untold::named(&untold, &parts);
            Some(stand)
        }
        first => first.cloned(),
    };
    if let Some(Stand { base, tool, instrument }) = stand {
        if !base.is_finite() || !tool.is_finite() {
            return None;
        }
        for sighting in &mut sightings {
            sighting.tool = base * sighting.tool * tool;
        }
        found.machine = mechanism.relocated(&base, &tool);
        found.machine.instrument.iter_mut().zip(instrument).for_each(|(c, value)| c.nominal = value);
        (found.base, found.tool) = (base, tool);
    }
    place_references(&mut found.machine, &sightings);
    Some(found)
}

/// Where base, tool and targets may stand, closed forms first; none where nothing refers to them, `None` where what
/// refers to them does not determine them.
fn starts(mechanism: &Mechanism, sightings: &[Sighting], free: FreeEnds) -> Option<Vec<Stand>> {
    let pair = |s: &Sighting| match s.clue {
        Clue::Pose(pose) => Some((s.tool, pose)),
        _ => None,
    };
    let pairs: Vec<Pair> = sightings.iter().filter_map(pair).collect();
    let points = sightings.iter().any(|s| matches!(s.clue, Clue::Position { .. }));
    let ends = free.base || free.tool;
    if ends && pairs.len() >= 3 {
        let stand = |(base, tool): (Se3, Se3)| {
            let moved = |s: &Sighting| Sighting { tool: base * s.tool * tool, ..*s };
            let there: Vec<Sighting> = sightings.iter().map(moved).collect();
            let targets = place_targets(mechanism, &there, FreeEnds { base: false, tool: false })?;
            Some(Stand { base, tool, instrument: targets.instrument })
        };
        return Some(from_poses(&pairs, free).into_iter().filter_map(stand).collect())
            .filter(|starts: &Vec<Stand>| !starts.is_empty());
    }
    if points {
        let mut starts = vec![place_targets(mechanism, sightings, free)?];
        if free.base && free.tool {
            starts.extend(place_targets(mechanism, sightings, FreeEnds { base: true, tool: false }));
        }
        return Some(starts);
    }
    let poses = |s: &Sighting| matches!(s.clue, Clue::Pose(_) | Clue::None);
    (!ends || !sightings.iter().all(poses)).then(Vec::new)
}

/// Base and tool by closed forms, the one that supposes least first: by relative rotations; the tool being as drawn, by
/// positions alone and by rotations alone; as drawn.
fn from_poses(pairs: &[Pair], free: FreeEnds) -> Vec<(Se3, Se3)> {
    let mut starts = Vec::new();
    starts.extend(closed_form(pairs, free));
    if free.base {
        let mean =
            |of: fn(&Pair) -> Vector3<f64>| pairs.iter().map(of).sum::<Vector3<f64>>() / pairs.len() as f64;
        let (from, to) = (mean(|(g, _)| g.p), mean(|(_, m)| m.p));
        let by_positions = pairs.iter().map(|(g, m)| (m.p - to) * (g.p - from).transpose()).sum();
        for sum in [by_positions, hand_eye::turns(pairs)] {
            let near = so3::nearest(&sum).filter(|near| near.sharpness > SHARP);
            let base = near.map(|near| Se3 { r: near.rotation, p: to - near.rotation * from });
            starts.extend(base.map(|base| (base, Se3::identity())));
        }
    }
    starts.push((Se3::identity(), Se3::identity()));
    starts
}

fn closed_form(pairs: &[Pair], free: FreeEnds) -> Option<(Se3, Se3)> {
    let sharp = |sum: &Matrix3<f64>| so3::nearest(sum).filter(|near| near.sharpness > SHARP);
    let rotation_base = if free.base && free.tool {
        let sum = hand_eye::relative_turns(pairs);
        match sharp(&sum) {
            Some(near) => near.rotation,
            None => return placed(pairs, &sum),
        }
    } else if free.base {
        sharp(&hand_eye::turns(pairs))?.rotation
    } else {
        Matrix3::identity()
    };
    let rotation_tool = match free.tool {
        true => sharp(&hand_eye::tool_turns(pairs, &rotation_base))?.rotation,
        false => Matrix3::identity(),
    };
    let (place, offset) = hand_eye::shifts(pairs, &rotation_base, (free.base, free.tool), PULL)?;
    Some((Se3 { r: rotation_base, p: place }, Se3 { r: rotation_tool, p: offset }))
}
