//! Base and tool frames, and constants of the instrument, that are known to nobody, before any link moves.
//!
//! `measured_k = X g_k Y` over predicted poses `g_k`. Rotation of X from relative rotations (Park & Martin, IEEE
//! Trans. Robotics and Automation 10(5), 1994), then Y's rotation, then both translations by linear least
//! squares; where all rotations share an axis, [`super::common_axis`]. Rotations that are small tell less than that: so the
//! drawn tool and base are starts, too, and `super::ends` refines them and takes the best. With positions only see
//! `targets`; fixed points and planes are placed by `references`.

use super::common_axis::placed;
use super::ends::{Refinement, Stand};
use super::references::place_references;
use super::targets::{free_targets, place_targets};
use super::untold::Untold;
use crate::calibration::{Sample, close_at};
use crate::lie::{Se3, so3};
use crate::measure::Clue;
use crate::model::{Mechanism, Posture, Prior, Tolerance};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// Most rounds of a factorisation.
const ITERATIONS: usize = 1000;

/// Which ends of the machine stand free.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FreeEnds {
    /// Nothing is known of the placement, or every limb's first link has no prior.
    pub base: bool,
    /// Nothing is known of the tool's mounting, or every limb's last link has no prior.
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
            let refinement = Refinement::new(seen, free, free_constants, length);
            let (stand, untold) = refinement.best(&starts)?;
            found.untold = Untold::named(&untold, free);
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
    let (mut predicted, mut measured) = (Vec::new(), Vec::new());
    for sighting in sightings {
        if let Clue::Pose(pose) = sighting.clue {
            predicted.push(sighting.tool);
            measured.push(pose);
        }
    }
    let points = sightings.iter().any(|s| matches!(s.clue, Clue::Position { .. }));
    let ends = free.base || free.tool;
    if ends && predicted.len() >= 3 {
        let stand = |(base, tool): (Se3, Se3)| {
            let moved = |s: &Sighting| Sighting { tool: base * s.tool * tool, ..*s };
            let there: Vec<Sighting> = sightings.iter().map(moved).collect();
            let targets = place_targets(mechanism, &there, FreeEnds { base: false, tool: false })?;
            Some(Stand { base, tool, instrument: targets.instrument })
        };
        return Some(from_poses(&predicted, &measured, free).into_iter().filter_map(stand).collect())
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
fn from_poses(predicted: &[Se3], measured: &[Se3], free: FreeEnds) -> Vec<(Se3, Se3)> {
    let mut starts = Vec::new();
    starts.extend(closed_form(predicted, measured, free));
    if free.base {
        let count = predicted.len() as f64;
        let mean = |of: &[Se3]| of.iter().map(|g| g.p).sum::<Vector3<f64>>() / count;
        let (from, to) = (mean(predicted), mean(measured));
        let pairs = || predicted.iter().zip(measured);
        let by_positions = pairs().map(|(g, m)| (m.p - to) * (g.p - from).transpose()).sum();
        let by_rotations = pairs().map(|(g, m)| m.r * g.r.transpose()).sum();
        for sum in [by_positions, by_rotations] {
            starts.extend(nearest_rotation(&sum).map(|r| (Se3 { r, p: to - r * from }, Se3::identity())));
        }
    }
    starts.push((Se3::identity(), Se3::identity()));
    starts
}

fn closed_form(predicted: &[Se3], measured: &[Se3], free: FreeEnds) -> Option<(Se3, Se3)> {
    let rotation_base = if free.base && free.tool {
        // log(M_j M_i') = R_X log(G_j G_i'): pairs a third of the set apart differ by more than neighbours do.
        let n = predicted.len();
        let mut sum = Matrix3::zeros();
        for stride in [1, (n / 3).max(1)] {
            for i in 0..n {
                let j = (i + stride) % n;
                let from = so3::log(&(predicted[j].r * predicted[i].r.transpose()));
                let to = so3::log(&(measured[j].r * measured[i].r.transpose()));
                // A turn by almost pi has no sure sign.
                if from.norm() < 2.8 && to.norm() < 2.8 {
                    sum += to * from.transpose();
                }
            }
        }
        match nearest_rotation(&sum) {
            Some(rotation) => rotation,
            None => return placed(predicted, measured, &sum),
        }
    } else if free.base {
        nearest_rotation(&predicted.iter().zip(measured).map(|(g, m)| m.r * g.r.transpose()).sum())?
    } else {
        Matrix3::identity()
    };
    let rotation_tool = if free.tool {
        nearest_rotation(
            &predicted
                .iter()
                .zip(measured)
                .map(|(g, m)| g.r.transpose() * rotation_base.transpose() * m.r)
                .sum(),
        )?
    } else {
        Matrix3::identity()
    };
    // p_m - R_X p_g = R_X R_g p_Y + p_X
    let columns = 3 * (usize::from(free.base) + usize::from(free.tool));
    let mut a = DMatrix::zeros(3 * predicted.len(), columns);
    let mut b = DVector::zeros(3 * predicted.len());
    for (k, (g, m)) in predicted.iter().zip(measured).enumerate() {
        b.fixed_rows_mut::<3>(3 * k).copy_from(&(m.p - rotation_base * g.p));
        if free.base {
            a.fixed_view_mut::<3, 3>(3 * k, 0).copy_from(&Matrix3::identity());
        }
        if free.tool {
            a.fixed_view_mut::<3, 3>(3 * k, columns - 3).copy_from(&(rotation_base * g.r));
        }
    }
    let solution = a.try_svd(true, true, f64::EPSILON, ITERATIONS)?.solve(&b, 1e-9).ok()?;
    let part = |at: usize| solution.fixed_rows::<3>(at).into_owned();
    let base = Se3 { r: rotation_base, p: if free.base { part(0) } else { Vector3::zeros() } };
    let tool = Se3 { r: rotation_tool, p: if free.tool { part(columns - 3) } else { Vector3::zeros() } };
    Some((base, tool))
}

/// The rotation `R` that maximises `tr(R' sum)`; `None` where two singular values vanish and it is not unique.
pub(super) fn nearest_rotation(sum: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let svd = sum.try_svd(true, true, f64::EPSILON, ITERATIONS)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    let mut s = svd.singular_values;
    s.as_mut_slice().sort_by(|a, b| b.total_cmp(a));
    if s[1].is_nan() || s[1] <= 1e-9 * s[0] {
        return None;
    }
    let mut flip = Matrix3::identity();
    let smallest = svd.singular_values.argmin().0;
    flip[(smallest, smallest)] = (u * v_t).determinant().signum();
    Some(u * flip * v_t)
}
