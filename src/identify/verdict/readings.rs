//! What is wrong with a row that stands out: the reading of an actuator, or what was measured (docs/theory.md (10.14)).

use crate::calibration::{Postures, Sample};
use crate::measure::Evaluation;
use crate::model::{Geometry, Mechanism};
use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Most rounds of a decomposition: without a limit one of numbers that are not finite never ends.
const ROUNDS: usize = 1000;

/// Probability of a residual that a corrected reading leaves, below which it does not explain the row.
const EXPLAINS: f64 = 1e-3;
/// Part of the row's chi-square that must be gone, too.
const GONE: f64 = 0.99;
/// Steps to the best reading.
const STEPS: usize = 30;
/// Step of difference quotients, rad or machine sizes.
const DIFFERENCE: f64 = 1e-6;
/// Changes of a reading that are tried at first, rad or machine sizes.
const AWAY: [f64; 6] = [0.02, 0.05, 0.1, 0.2, 0.4, 0.8];
/// Longest step, rad or machine sizes.
const LONGEST: f64 = 0.3;

/// What explains a row.
#[derive(Clone, Debug, PartialEq)]
pub enum RowCause {
    /// The reading of one actuator, by so much (rad or m, read less true).
    Reading {
        /// `limb.joint`.
        joint: String,
        /// Whether it is an angle.
        angular: bool,
        /// Read less true.
        amount: f64,
    },
    /// Several readings: some actuators' readings explain the row, no single one does.
    Readings,
    /// What was measured: no readings explain it.
    Measured,
    /// Too little was measured to tell.
    Unknown,
}

/// What explains the residual of a sample by a machine that the others give.
pub(super) fn cause(mechanism: &Mechanism, geometry: &Geometry, sample: &Sample) -> RowCause {
    let trial = Trial { mechanism, geometry, sample };
    let (rows, count) = (sample.measurement.rows(), sample.actuators.len());
    let square = trial.residual(&sample.actuators).map_or(f64::INFINITY, |r| r.norm_squared());
    let explains = |left: f64, unknowns: usize| {
        let law = ChiSquared::new(rows.saturating_sub(unknowns) as f64);
        rows > unknowns && left < (1.0 - GONE) * square && law.is_ok_and(|law| law.sf(left) > EXPLAINS)
    };
    if rows < 3 || sample.measurement.second().is_some() {
        return RowCause::Unknown;
    }
    let joints = mechanism
        .limbs
        .iter()
        .flat_map(|limb| limb.joints.iter().filter(|joint| joint.actuated).map(move |joint| (limb, joint)));
    let mut found = Vec::new();
    for (i, (limb, joint)) in joints.enumerate().take(count) {
        if let Some((left, actuators)) = trial.best(&[i])
            && explains(left, 1)
        {
            let amount = sample.actuators[i] - actuators[i];
            let joint_name = format!("{}.{}", limb.name, joint.name);
            found.push(RowCause::Reading { joint: joint_name, angular: joint.motion.is_angular(), amount });
        }
    }
    match found.len() {
        1 => return found.swap_remove(0),
        0 => {}
        _ => return RowCause::Readings,
    }
    if rows <= count {
        return RowCause::Unknown;
    }
    let all: Vec<usize> = (0..count).collect();
    match trial.best(&all) {
        Some((left, _)) if explains(left, count) => RowCause::Readings,
        _ => RowCause::Measured,
    }
}

struct Trial<'a> {
    mechanism: &'a Mechanism,
    geometry: &'a Geometry,
    sample: &'a Sample,
}

impl Trial<'_> {
    /// Whitened residual at other readings; `None` where the machine does not close there.
    fn residual(&self, actuators: &[f64]) -> Option<DVector<f64>> {
        let sample = Sample { actuators: actuators.to_vec(), ..self.sample.clone() };
        let mut postures = Postures::new(self.mechanism);
        sample.close_all(self.mechanism, self.geometry, &mut postures).ok()?;
        let mut out = Evaluation::default();
        sample.measurement.evaluate(&postures.view(&sample, self.geometry), &mut out);
        let r = DVector::from_iterator(out.rows.len(), out.rows.iter().map(|row| row.r));
        r.iter().all(|v| v.is_finite()).then_some(r)
    }

    /// Where to begin: the readings as they are, or one of them changed by a part of a turn or of the machine's size.
    fn start(&self, which: &[usize], unit: &[f64]) -> Option<(Vec<f64>, DVector<f64>)> {
        let as_read = self.sample.actuators.clone();
        let mut tried = vec![as_read.clone()];
        if let &[only] = which {
            for part in AWAY.iter().flat_map(|part| [*part, -part]) {
                let mut moved = as_read.clone();
                moved[only] += part * unit[only];
                tried.push(moved);
            }
        }
        let found = tried.into_iter().filter_map(|at| Some((self.residual(&at)?, at)));
        let (r, at) = found.min_by(|a, b| a.0.norm_squared().total_cmp(&b.0.norm_squared()))?;
        Some((at, r))
    }

    /// Least sum of squares over the readings `which`, and where (Gauss-Newton, steps halved until they gain).
    fn best(&self, which: &[usize]) -> Option<(f64, Vec<f64>)> {
        let length = self.mechanism.characteristic_length();
        let joints = self.mechanism.limbs.iter().flat_map(|limb| &limb.joints).filter(|joint| joint.actuated);
        let unit: Vec<f64> =
            joints.map(|joint| if joint.motion.is_angular() { 1.0 } else { length }).collect();
        let (mut at, mut r) = self.start(which, &unit)?;
        for _ in 0..STEPS {
            let mut jac = DMatrix::zeros(r.len(), which.len());
            for (c, &i) in which.iter().enumerate() {
                let mut moved = at.clone();
                moved[i] += DIFFERENCE * unit[i];
                jac.set_column(c, &((self.residual(&moved)? - &r) / DIFFERENCE));
            }
            let step = jac.try_svd(true, true, 5.0 * f64::EPSILON, ROUNDS)?.solve(&-&r, 1e-9).ok()?;
            let longest = step.amax();
            let mut part = if longest > LONGEST { LONGEST / longest } else { 1.0 };
            let mut next = None;
            for _ in 0..12 {
                let mut moved = at.clone();
                which.iter().enumerate().for_each(|(c, &i)| moved[i] += part * step[c] * unit[i]);
                next =
                    self.residual(&moved).filter(|n| n.norm_squared() < r.norm_squared()).map(|n| (moved, n));
                if next.is_some() {
                    break;
                }
                part *= 0.5;
            }
            let Some((moved, better)) = next else { break };
            let gained = r.norm_squared() - better.norm_squared();
            (at, r) = (moved, better);
            if gained < 1e-6 * (1.0 + r.norm_squared()) {
                break;
            }
        }
        Some((r.norm_squared(), at))
    }
}
