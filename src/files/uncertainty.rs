//! What a result file says of how well its machine is known.

use super::error::FileError;
use super::fault::Fault;
use super::place::Place;
use super::units::Units;
use crate::lie::Se3;
use crate::lie::se3::{self, Twist};
use crate::model::{Geometry, Mechanism};
use serde::{Deserialize, Serialize};

/// Square root of the covariance of the links of a result's `mechanism`, in units of the file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UncertaintyDrawing {
    /// Of each direction, the share of its variance that stems from the tolerances and not from the measurements.
    pub prior_share: Vec<f64>,
    /// Independent errors of one standard deviation, a row each: six numbers a link of `mechanism`, limb by limb, its
    /// rotation and translation in the frame of the joint that it carries.
    pub root: Vec<Vec<f64>>,
}

/// An [`UncertaintyDrawing`] in rad and m.
#[derive(Clone, Debug, PartialEq)]
pub struct LinkUncertainty {
    /// Share of the prior in each direction.
    pub prior_share: Vec<f64>,
    /// Directions, six numbers a link.
    pub root: Vec<Vec<f64>>,
}

/// Significant digits that are written are seven: an uncertainty has two or three.
fn rounded(value: f64) -> f64 {
    format!("{value:.6e}").parse().unwrap_or(value)
}

impl UncertaintyDrawing {
    /// Draws directions (body twists of the links of `geometry`, rad and m) for the machine `redrawn`, whose joints lie
    /// on the same lines but have frames of their own.
    pub fn of(
        geometry: &Geometry,
        redrawn: &Mechanism,
        root: &[Vec<f64>],
        prior_share: &[f64],
        units: Units,
    ) -> Self {
        let frames = |geometry: &Geometry| -> Vec<Se3> {
            (0..geometry.limbs.len()).flat_map(|i| geometry.home_frames(i)).collect()
        };
        let pairs = frames(geometry).into_iter().zip(frames(&redrawn.nominal()));
        let turns: Vec<_> = pairs.map(|(from, to)| se3::adjoint(&(to.inverse() * from))).collect();
        let draw = |direction: &Vec<f64>| {
            let links = direction.chunks_exact(6).zip(&turns);
            let turned = links.flat_map(|(b, turn)| {
                let b = turn * Twist::from_column_slice(b);
                let value = |i: usize| if i < 3 { units.from_radians(b[i]) } else { units.from_metres(b[i]) };
                std::array::from_fn::<f64, 6, _>(|i| rounded(value(i)))
            });
            turned.collect()
        };
        Self {
            prior_share: prior_share.iter().map(|v| rounded(*v)).collect(),
            root: root.iter().map(draw).collect(),
        }
    }

    /// In rad and m, for a machine of so many links.
    pub(super) fn read(
        &self,
        links: usize,
        units: Units,
        at: &Place<'_>,
    ) -> Result<LinkUncertainty, FileError> {
        let (shares, root_at) = (at.key("prior_share"), at.key("root"));
        if self.prior_share.len() != self.root.len() {
            return Err(
                shares.error(Fault::Length { found: self.prior_share.len(), wanted: self.root.len() })
            );
        }
        if let Some((i, share)) =
            self.prior_share.iter().enumerate().find(|(_, share)| !(0.0..=1.0).contains(*share))
        {
            return Err(shares.index(i).error(Fault::Share(*share)));
        }
        let mut root = Vec::with_capacity(self.root.len());
        for (i, direction) in self.root.iter().enumerate() {
            let here = root_at.index(i);
            if direction.len() != 6 * links {
                return Err(here.error(Fault::Length { found: direction.len(), wanted: 6 * links }));
            }
            let mut read = Vec::with_capacity(direction.len());
            for (j, value) in direction.iter().enumerate() {
                let place = here.index(j);
                read.push(match j % 6 {
                    0..3 => units.angle(*value, &place)?,
                    _ => units.length(*value, &place)?,
                });
            }
            root.push(read);
        }
        Ok(LinkUncertainty { prior_share: self.prior_share.clone(), root })
    }
}
