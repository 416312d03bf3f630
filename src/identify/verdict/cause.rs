//! Causes of a residual, and what is said of each.

use super::chi_square::{self, ChiSquareTest, Size};
use super::groups::NoiseFinding;
use super::model::ModelFinding;
use super::order::{DriftFinding, OrderFinding};
use super::posture_noise::PostureNoiseFinding;

/// Why a residual is as it is.
#[derive(Clone, Debug, PartialEq)]
pub enum Cause {
    /// Noise of some readings is not what was stated.
    Noise(NoiseFinding),
    /// What the samples of a posture have in common is not what was stated.
    PostureNoise(PostureNoiseFinding),
    /// Few postures are wrong.
    Outliers(OutlierFinding),
    /// Readings that follow each other err alike.
    Order(OrderFinding),
    /// Readings drift; the name of what drifts most.
    Drift(DriftFinding, String),
    /// The machine has errors that the model does not have.
    Model(ModelFinding),
}

/// Postures that stand out, and the residual without them.
#[derive(Clone, Debug, PartialEq)]
pub struct OutlierFinding {
    /// How many.
    pub count: usize,
    /// Test of the residual of an estimate without them, where linear theory describes it.
    pub without: Option<ChiSquareTest>,
    /// Log likelihood that leaving them out gains.
    pub gain: f64,
}

impl ChiSquareTest {
    /// What the size of the residual says by itself, without a full stop.
    pub(super) fn sentence(&self) -> String {
        let ratio = match self.ratio() {
            ratio if ratio < 1e-3 => "less than 0.001".to_owned(),
            ratio => format!("{ratio:.3}"),
        };
        match self.size() {
            Size::Explained => "the stated noise explains the residual".into(),
            Size::Doubtful => format!(
                "doubtful: the stated noise makes the residual as large in {} % of cases",
                percent(100.0 * self.probability)
            ),
            Size::Large => format!(
                "the residual is {ratio} times what the stated noise makes it: noise understated, or errors that the \
                 model does not have and that neighbouring postures do not share"
            ),
            Size::Small => format!(
                "the residual is {ratio} times what the stated noise makes it: noise overstated, or readings that \
                 are not independent"
            ),
        }
    }
}

/// A share in percent, with two digits.
fn percent(share: f64) -> String {
    if share < 1.0 { format!("{share:.2}") } else { format!("{share:.1}") }
}

impl Cause {
    /// Log likelihood that the cause gains.
    pub fn gain(&self) -> f64 {
        match self {
            Cause::Noise(found) => found.gain,
            Cause::PostureNoise(found) => found.gain,
            Cause::Outliers(found) => found.gain,
            Cause::Order(found) => found.gain,
            Cause::Drift(found, _) => found.gain,
            Cause::Model(found) => found.gain,
        }
    }

    /// Its kind, in one word.
    pub fn kind(&self) -> &'static str {
        match self {
            Cause::Noise(_) => "noise",
            Cause::PostureNoise(_) => "posture_noise",
            Cause::Outliers(_) => "outliers",
            Cause::Order(_) => "order",
            Cause::Drift(..) => "drift",
            Cause::Model(_) => "model",
        }
    }

    /// What was found, without a full stop.
    pub fn sentence(&self) -> String {
        match self {
            Cause::Noise(found) => found.sentence(),
            Cause::PostureNoise(found) => found.sentence(),
            Cause::Outliers(found) => found.sentence(),
            Cause::Order(found) => found.sentence(),
            Cause::Drift(found, name) => found.sentence(name),
            Cause::Model(found) => found.sentence(),
        }
    }
}

impl OutlierFinding {
    /// What was found, without a full stop.
    fn sentence(&self) -> String {
        let (what, them) = match self.count {
            1 => ("1 posture stands out".to_owned(), "it"),
            count => (format!("{count} postures stand out"), "them"),
        };
        match self.without {
            None => what,
            Some(test) => format!(
                "{what}; without {them} chi-square is {:.1} for {:.1} degrees of freedom (probability {})",
                test.value,
                test.degrees_of_freedom,
                chi_square::probability(test.probability)
            ),
        }
    }
}
