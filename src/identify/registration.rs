//! Start for base and tool frames, and for constants of the instrument, that are known to nobody.
//!
//! `measured_k = X g_k Y` over predicted poses `g_k`. Rotation of X from relative rotations (Park & Martin, IEEE
//! Trans. Robotics and Automation 10(5), 1994), then Y's rotation, then both translations by linear least
//! squares; where all rotations share an axis, [`super::common_axis`]. With positions only see `targets`; fixed
//! points and planes are placed by `references`.

use super::common_axis::placed;
use super::references::place_references;
use super::targets::place_targets;
use crate::calibration::{Sample, close_at};
use crate::lie::{Se3, so3};
use crate::measure::Clue;
use crate::model::{Mechanism, Posture, Prior};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// Which ends of the machine stand free.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FreeEnds {
    /// Every limb's first link has no prior.
    pub base: bool,
    /// Every limb's last link has no prior.
    pub tool: bool,
}

impl FreeEnds {
    /// Reads them off the priors: an end is free where that link of every limb is.
    pub fn of(mechanism: &Mechanism) -> Self {
        let free = |link: Option<&crate::model::Link>| {
            link.is_some_and(|l| l.tolerance.angle == Prior::Free && l.tolerance.length == Prior::Free)
        };
        Self {
            base: mechanism.limbs.iter().all(|limb| free(limb.links.first())),
            tool: mechanism.limbs.iter().all(|limb| free(limb.links.last())),
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

/// The machine with its free ends, and the instrument's free constants, moved to where the measurements say that they
/// are; `None` where base or tool are free and the samples do not determine them.
///
/// Distances, touches and passive joints alone say nothing of base and tool: these then stay as drawn.
pub fn registered(mechanism: &Mechanism, samples: &[Sample], free: FreeEnds) -> Option<Mechanism> {
    let geometry = mechanism.nominal();
    let mut posture = Posture::new(mechanism);
    let mut sightings = Vec::with_capacity(samples.len());
    for sample in samples {
        // The measured pose lies elsewhere: the posture is sought from home.
        if close_at(mechanism, &geometry, &sample.actuators, None, &mut posture).is_ok() {
            sightings.push(Sighting { tool: posture.tool(), clue: sample.measurement.clue() });
        }
    }
    let (mut predicted, mut poses, mut points) = (Vec::new(), Vec::new(), false);
    for sighting in &sightings {
        match sighting.clue {
            Clue::Pose(pose) => {
                predicted.push(sighting.tool);
                poses.push(pose);
            }
            Clue::Position { .. } => points = true,
            Clue::Range { .. } | Clue::Touch { .. } | Clue::Internal | Clue::None => {}
        }
    }
    let ends = free.base || free.tool;
    let mut moved = mechanism.clone();
    if ends && poses.len() >= 3 {
        let (base, tool) = from_poses(&predicted, &poses, free)?;
        moved = relocated(mechanism, &mut sightings, &base, &tool)?;
        place_targets(&mut moved, &sightings, FreeEnds { base: false, tool: false });
    } else if points {
        let placed = place_targets(&mut moved, &sightings, free);
        let (base, tool) = placed.or_else(|| (!ends).then(|| (Se3::identity(), Se3::identity())))?;
        moved = relocated(&moved, &mut sightings, &base, &tool)?;
    } else if ends && samples.iter().all(|s| matches!(s.measurement.clue(), Clue::Pose(_) | Clue::None)) {
        return None;
    }
    place_references(&mut moved, &sightings);
    Some(moved)
}

/// The machine between base and tool as found, and its predictions there.
fn relocated(mechanism: &Mechanism, sightings: &mut [Sighting], base: &Se3, tool: &Se3) -> Option<Mechanism> {
    for sighting in sightings {
        sighting.tool = *base * sighting.tool * *tool;
    }
    (base.is_finite() && tool.is_finite()).then(|| mechanism.relocated(base, tool))
}

fn from_poses(predicted: &[Se3], measured: &[Se3], free: FreeEnds) -> Option<(Se3, Se3)> {
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
    let solution = a.svd(true, true).solve(&b, 1e-9).ok()?;
    let part = |at: usize| solution.fixed_rows::<3>(at).into_owned();
    let base = Se3 { r: rotation_base, p: if free.base { part(0) } else { Vector3::zeros() } };
    let tool = Se3 { r: rotation_tool, p: if free.tool { part(columns - 3) } else { Vector3::zeros() } };
    Some((base, tool))
}

/// The rotation `R` that maximises `tr(R' sum)`; `None` where two singular values vanish and it is not unique.
pub(super) fn nearest_rotation(sum: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let svd = sum.svd(true, true);
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
