//! Whether what the samples of a posture have in common is what was stated of it (docs/theory.md (10.20)).

use super::groups::number;
use crate::calibration::{ByPosture, Sample};
use crate::identify::copies::copies;
use crate::identify::posture_noise::{FEWEST, Rows, least};
use crate::identify::run::Identification;
use crate::measure::PostureNoise;
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Probability with which what was stated rightly is contradicted.
const FALSE_ALARM: f64 = 1e-3;
/// Factors tried before the best is refined.
const GRID: [f64; 11] = [0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0, 1.7, 3.5, 8.0, 30.0];
/// Gain of twice the log likelihood for which one factor for both parts is given up.
const SIMPLER: f64 = 4.0;
/// Step of the logarithm of a factor over which the likelihood bends.
const BEND: f64 = 0.1;

/// Which of angle and length have a factor, the factor, twice the negative log likelihood there, and the readings' own noise
/// in units of what it was taken for.
type Fitted = ([bool; 2], f64, f64, f64);

/// One part of what is common, and the factor that the data support.
#[derive(Clone, Debug, PartialEq)]
pub struct PostureNoisePart {
    /// What it is: both parts where they have one factor.
    pub name: &'static str,
    /// Standard deviation that the data support, in stated ones.
    pub factor: f64,
    /// Standard error of the factor; `None` where it is so small that the likelihood does not bend.
    pub error: Option<f64>,
}

/// The samples of a posture have more, or less, in common than was stated.
#[derive(Clone, Debug, PartialEq)]
pub struct PostureNoiseFinding {
    /// What differs.
    pub part: PostureNoisePart,
    /// What the data support.
    pub supported: PostureNoise,
    /// Probability of such data if what was stated were right.
    pub probability: f64,
    /// Log likelihood that it gains.
    pub gain: f64,
}

impl PostureNoiseFinding {
    /// From the residual of an identification under what was stated, the readings' own noise being of any size. `None`
    /// where nothing was stated, where samples state different things, where postures have single samples or copies, which
    /// tell nothing, and where the data do not contradict it.
    pub(super) fn of(found: &Identification, samples: &[Sample]) -> Option<Self> {
        let stated = samples.first()?.measurement.posture_noise()?;
        let postures = ByPosture::of(samples);
        let told = postures.sample_count() - postures.count() >= FEWEST
            && samples.iter().all(|s| s.measurement.posture_noise() == Some(stated))
            && copies(samples) == 0;
        let rows = if told { Rows::of(found, samples).ok()?? } else { return None };
        let size = |value: f64, unit: f64| if unit > 0.0 { value / unit } else { 0.0 };
        let stated_in_units = [size(stated.angle, rows.unit[0]), size(stated.length, rows.unit[1])];
        let (mut both, mut one): (Option<Fitted>, Option<Fitted>) = (None, None);
        let mut tries = 0.0;
        for which in [[true, true], [true, false], [false, true]] {
            // A part that was not stated has no factor.
            let none = (0..2).any(|k| which[k] && stated_in_units[k] == 0.0);
            if none {
                continue;
            }
            tries += 1.0;
            // In parts of the readings' own noise; what has no factor keeps the size that was stated.
            let own = both.map_or(1.0, |(.., own)| own);
            let parts = |part: f64| scaled(stated_in_units.map(|size| size / own), which, part * own);
            let at = |part: f64| rows.deviance(parts(part));
            let (mut part, mut deviance) = least(&at, &GRID)?;
            let nothing = at(0.0)?;
            if nothing <= deviance {
                (part, deviance) = (0.0, nothing);
            }
            let own = rows.own(parts(part))?;
            let of = if which == [true, true] { &mut both } else { &mut one };
            if of.is_none_or(|(_, _, least, _)| deviance < least) {
                *of = Some((which, part * own, deviance, own));
            }
        }
        let (which, factor, deviance, own) = match (both, one) {
            (Some(both), Some(one)) if one.2 < both.2 - SIMPLER => one,
            (both, one) => both.or(one)?,
        };
        let at = |factor: f64| rows.deviance_of(scaled(stated_in_units, which, factor), own);
        let as_stated = at(1.0)?;
        let probability = ChiSquared::new(1.0).ok()?.sf((as_stated - deviance).max(0.0));
        if tries * probability > FALSE_ALARM {
            return None;
        }
        let bend =
            (at(factor * BEND.exp())? - 2.0 * at(factor)? + at(factor * (-BEND).exp())?) / (BEND * BEND);
        let supported = scaled([stated.angle, stated.length], which, factor);
        let name = match which {
            [true, true] => "posture_noise",
            [true, false] => "posture_noise.angle",
            _ => "posture_noise.length",
        };
        Some(Self {
            part: PostureNoisePart {
                name,
                factor,
                error: (bend > 0.0 && factor > 0.0).then(|| factor * (2.0 / bend).sqrt()),
            },
            supported: PostureNoise { angle: supported[0], length: supported[1] },
            probability,
            gain: 0.5 * (as_stated - deviance),
        })
    }

    /// What was found, without a full stop.
    pub fn sentence(&self) -> String {
        let PostureNoisePart { name, factor, error } = &self.part;
        let share = match (factor, error) {
            (factor, _) if *factor < GRID[0] => format!("less than {}", number(GRID[0])),
            (factor, Some(error)) => format!("{} +- {}", number(*factor), number(*error)),
            (factor, None) => number(*factor),
        };
        let word = if *factor < 1.0 { "overstated" } else { "understated" };
        format!("what the samples of a posture have in common is {share} of the stated {name}: it is {word}")
    }
}

fn scaled(size: [f64; 2], which: [bool; 2], factor: f64) -> [f64; 2] {
    std::array::from_fn(|k| if which[k] { factor * size[k] } else { size[k] })
}
