//! Whether the residual is what the stated noise makes it: chi-square, and what else it may be (docs/theory.md (10.5)).

use crate::calibration::postures::{by_posture, telling};
use crate::calibration::{PostureRows, Postures, Sample};
use crate::linalg;
use crate::model::{Geometry, Mechanism};
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Standard deviations of chi-square beyond which the stated noise does not explain it.
const REMARKABLE: f64 = 3.0;
/// Correlation between residuals of neighbouring postures, in its standard deviations, that noise does not have.
const RESEMBLING: f64 = 4.0;
/// The same, as a number: below it nothing is said however many postures there are.
const FAINT: f64 = 0.05;

/// Why a residual is as large as it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The stated noise explains it.
    Explained,
    /// It is smaller than the stated noise.
    Overstated,
    /// It is larger, without resemblance between neighbouring postures: noise, or errors too rough to tell from it.
    Understated,
    /// Without the few postures that stand out the stated noise would explain it.
    Outliers,
    /// It is larger, and neighbouring postures err alike: the machine does what the model does not.
    Incomplete,
}

/// Chi-square test of the residual.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChiSquareTest {
    /// Sum of squares of the whitened residual.
    pub value: f64,
    /// Its expectation under the stated noise.
    pub degrees_of_freedom: f64,
    /// Standard deviations above its expectation, by the cube root that is all but normal (Wilson & Hilferty,
    /// Proc. National Academy of Sciences 17, 1931).
    pub deviation: f64,
    /// Probability that noise alone makes it as large, or larger.
    pub probability: f64,
    /// Correlation between the whitened residuals of each posture and its nearest neighbour; `None` where there are too
    /// few to tell.
    pub neighbours: Option<f64>,
    /// What follows.
    pub verdict: Verdict,
}

impl ChiSquareTest {
    /// Tests residuals of `samples` at `geometry` that took part. `without` has chi-square and degrees of freedom of an
    /// estimate without the postures that stand out, where there are some. `None` without degrees of freedom.
    pub fn new(
        (value, degrees_of_freedom): (f64, f64),
        mechanism: &Mechanism,
        geometry: &Geometry,
        samples: &[Sample],
        without: Option<(f64, f64)>,
    ) -> Option<Self> {
        if degrees_of_freedom < 0.5 || !value.is_finite() {
            return None;
        }
        let deviation = wilson_hilferty(value, degrees_of_freedom);
        let residuals = Residuals::of(mechanism, geometry, samples);
        let (neighbours, spread) = residuals.resemblance(mechanism).unzip();
        let resembling = neighbours
            .zip(spread)
            .is_some_and(|(correlation, spread)| correlation > FAINT && correlation > RESEMBLING * spread);
        let verdict = if deviation < -REMARKABLE {
            Verdict::Overstated
        } else if deviation <= REMARKABLE {
            Verdict::Explained
        } else {
            let explained =
                |(value, freedom): (f64, f64)| freedom > 0.5 && wilson_hilferty(value, freedom) <= REMARKABLE;
            if without.is_some_and(explained) {
                Verdict::Outliers
            } else if resembling {
                Verdict::Incomplete
            } else {
                Verdict::Understated
            }
        };
        let probability = ChiSquared::new(degrees_of_freedom).ok()?.sf(value);
        Some(Self { value, degrees_of_freedom, deviation, probability, neighbours, verdict })
    }

    /// Size of the residual in units of what the stated noise makes it.
    pub fn ratio(&self) -> f64 {
        (self.value / self.degrees_of_freedom).sqrt()
    }

    /// By how much the noise seems larger than stated, where the residual contradicts it: the ratio of Birge (Physical
    /// Review 40, 1932). Errors are never made smaller by it. `None` where the stated noise may be trusted.
    pub fn birge_ratio(&self) -> Option<f64> {
        match self.verdict {
            Verdict::Explained | Verdict::Overstated => None,
            Verdict::Understated | Verdict::Outliers | Verdict::Incomplete => Some(self.ratio()),
        }
    }

    /// What the test says, in a sentence without its full stop.
    pub fn sentence(&self) -> String {
        let ratio = match self.ratio() {
            ratio if ratio < 1e-3 => "less than 0.001".to_owned(),
            ratio => format!("{ratio:.3}"),
        };
        let what = match self.verdict {
            Verdict::Explained => "the stated noise explains the residual".to_owned(),
            Verdict::Overstated => format!(
                "the residual is {ratio} times what the stated noise makes it: noise overstated, or readings that \
                 are not independent"
            ),
            Verdict::Understated => format!(
                "the residual is {ratio} times what the stated noise makes it: noise understated, or errors that the \
                 model does not have and that neighbouring postures do not share"
            ),
            Verdict::Outliers => format!(
                "the residual is {ratio} times what the stated noise makes it, because of the few postures that \
                 stand out"
            ),
            Verdict::Incomplete => format!(
                "the residual is {ratio} times what the stated noise makes it, and neighbouring postures err \
                 alike: the machine has errors that the model does not have"
            ),
        };
        match self.neighbours.filter(|_| self.verdict == Verdict::Incomplete) {
            Some(correlation) => format!("{what} (correlation {correlation:.2})"),
            None => what,
        }
    }
}

/// Standard normal deviate of a chi-square value.
fn wilson_hilferty(value: f64, freedom: f64) -> f64 {
    let spread = 2.0 / (9.0 * freedom);
    ((value / freedom).max(0.0).cbrt() - (1.0 - spread)) / spread.sqrt()
}

/// Whitened residuals, posture by posture.
struct Residuals<'a> {
    postures: Vec<(&'a Sample, Vec<f64>)>,
}

impl<'a> Residuals<'a> {
    fn of(mechanism: &Mechanism, geometry: &Geometry, samples: &'a [Sample]) -> Self {
        let (mut room, mut rows) = (Postures::new(mechanism), PostureRows::default());
        let mut found = Vec::new();
        for of in by_posture(samples) {
            let all = || of.iter().copied();
            let Some(telling) = telling(all()) else { continue };
            if telling.close_all(mechanism, geometry, &mut room).is_ok()
                && let Ok(rows) = rows.evaluate(all(), &room, geometry)
            {
                found.push((telling, rows.rows.iter().map(|row| row.r).collect()));
            }
        }
        Self { postures: found }
    }

    /// Correlation between residuals of nearest neighbours in actuator space, and its standard deviation under
    /// independent noise.
    fn resemblance(&self, mechanism: &Mechanism) -> Option<(f64, f64)> {
        // Searching all pairs: enough of them tell.
        let some = &self.postures[..self.postures.len().min(2000)];
        if some.len() < 12 {
            return None;
        }
        let length = mechanism.characteristic_length();
        let joints = mechanism.limbs.iter().flat_map(|limb| &limb.joints).filter(|joint| joint.actuated);
        let unit: Vec<f64> =
            joints.map(|joint| if joint.motion.is_angular() { 1.0 } else { length }).collect();
        let apart = |a: &Sample, b: &Sample| -> f64 {
            let each = a.actuators.iter().zip(&b.actuators).zip(&unit);
            each.map(|((a, b), unit)| ((a - b) / unit).powi(2)).sum()
        };
        let (mut product, mut square, mut spread) = (0.0, 0.0, 0.0);
        for (i, (sample, r)) in some.iter().enumerate() {
            let others = some.iter().enumerate().filter(|(j, (_, s))| *j != i && s.len() == r.len());
            let nearest = others.min_by(|a, b| apart(sample, a.1.0).total_cmp(&apart(sample, b.1.0)));
            let Some(nearest) = nearest else { continue };
            product += linalg::dot(r, &nearest.1.1);
            spread += linalg::dot(r, r) * linalg::dot(&nearest.1.1, &nearest.1.1) / r.len().max(1) as f64;
            square += linalg::dot(r, r);
        }
        // Neighbours are often mutual, which counts a pair twice.
        (square > 0.0).then(|| (product / square, (2.0 * spread).sqrt() / square))
    }
}
