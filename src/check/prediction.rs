//! Where the drawing puts the tool at readings that may be wrong by orders of magnitude, in bounded time.

use super::alignment::CLOSED;
use crate::lie::Se3;
use crate::model::{Geometry, Mechanism, Posture};

/// Closures tried on the way from home to one posture.
const CLOSURES: usize = 14;
/// Farthest that a passive joint moves in one stride, rad or machine sizes: beyond, it may have changed branch.
const STRIDE: f64 = 0.7;

/// A machine as drawn with its posture at home, from which others are sought.
pub(super) struct Predictor<'a> {
    mechanism: &'a Mechanism,
    geometry: Geometry,
    home: Posture,
    closes: bool,
}

impl<'a> Predictor<'a> {
    pub fn new(mechanism: &'a Mechanism) -> Self {
        let geometry = mechanism.nominal();
        let mut home = Posture::new(mechanism);
        let closes = home.close(mechanism, &geometry).is_ok();
        Self { mechanism, geometry, home, closes }
    }

    /// Tool poses at these joint variables (rad, m), `None` where the loops were not closed: all, once it is clear that
    /// too few close to be compared.
    pub fn tools(&self, variables: &[Vec<f64>]) -> Vec<Option<Se3>> {
        let mut posture = self.home.clone();
        let most = ((1.0 - CLOSED) * variables.len() as f64) as usize;
        let mut open = 0;
        let tool = |at: &Vec<f64>| {
            let tool = if open <= most { self.tool(at, &mut posture) } else { None };
            open += usize::from(tool.is_none());
            tool
        };
        variables.iter().map(tool).collect()
    }

    fn tool(&self, at: &[f64], posture: &mut Posture) -> Option<Se3> {
        if !self.closes || at.iter().any(|v| !v.is_finite()) {
            return None;
        }
        if self.mechanism.is_open_chain() {
            posture.set_joints(self.mechanism, at, &[]);
            posture.close(self.mechanism, &self.geometry).ok()?;
            return Some(posture.tool());
        }
        let mut passive = self.home.passive(self.mechanism);
        let (mut reached, mut stride) = (0.0, 1.0);
        for _ in 0..CLOSURES {
            let to: f64 = if reached + stride > 1.0 - 1e-9 { 1.0 } else { reached + stride };
            let part: Vec<f64> = at.iter().map(|v| v * to).collect();
            posture.set_joints(self.mechanism, &part, &passive);
            let closed = posture.close(self.mechanism, &self.geometry).is_ok();
            let now = posture.passive(self.mechanism);
            if closed && posture.mode == self.home.mode && self.near(&passive, &now) {
                if to == 1.0 {
                    return Some(posture.tool());
                }
                (passive, reached, stride) = (now, to, 2.0 * stride);
            } else {
                stride *= 0.5;
            }
        }
        None
    }

    fn near(&self, from: &[f64], to: &[f64]) -> bool {
        let length = self.home.length();
        let passive = self.mechanism.limbs.iter().flat_map(|limb| &limb.joints).filter(|j| !j.actuated);
        passive.zip(from.iter().zip(to)).all(|(j, (a, b))| j.motion.size_of(b - a, length) < STRIDE)
    }
}
