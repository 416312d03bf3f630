//! Whether the residual is as large as the stated noise makes it (docs/theory.md (10.5)).

use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Probability below which the stated noise is contradicted.
pub const CONTRADICTED: f64 = 1e-3;
/// Probability below which it is doubtful.
pub const DOUBTFUL: f64 = 0.05;

/// Chi-square test of the whole residual.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChiSquareTest {
    /// Sum of squares of the whitened residual.
    pub value: f64,
    /// Its expectation under the stated noise.
    pub degrees_of_freedom: f64,
    /// Probability that noise alone makes it as large, or larger.
    pub probability: f64,
    /// Probability that noise alone makes it as small, or smaller.
    pub below: f64,
}

/// What the size of a residual says of the stated noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// The stated noise explains it.
    Explained,
    /// It is larger than the stated noise makes it but once in twenty times or less often.
    Doubtful,
    /// It is too large.
    Large,
    /// It is too small.
    Small,
}

impl ChiSquareTest {
    /// Of a value with its expectation; `None` without degrees of freedom.
    pub fn new(value: f64, degrees_of_freedom: f64) -> Option<Self> {
        if degrees_of_freedom < 0.5 || !value.is_finite() {
            return None;
        }
        let law = ChiSquared::new(degrees_of_freedom).ok()?;
        Some(Self { value, degrees_of_freedom, probability: law.sf(value), below: law.cdf(value) })
    }

    /// Size of the residual in units of what the stated noise makes it.
    pub fn ratio(&self) -> f64 {
        (self.value / self.degrees_of_freedom).sqrt()
    }

    /// What its size says.
    pub fn size(&self) -> Size {
        match () {
            () if self.probability < CONTRADICTED => Size::Large,
            () if self.below < CONTRADICTED => Size::Small,
            () if self.probability < DOUBTFUL => Size::Doubtful,
            () => Size::Explained,
        }
    }

    /// By how much the noise seems larger than stated, where the residual contradicts it: the ratio of Birge (Physical
    /// Review 40, 1932). Errors are never made smaller by it. `None` where the stated noise may be trusted.
    pub fn birge_ratio(&self) -> Option<f64> {
        (self.size() == Size::Large).then(|| self.ratio())
    }
}

/// A probability with two digits.
pub fn probability(p: f64) -> String {
    match p {
        p if !p.is_finite() => "-".into(),
        p if p >= 0.095 => format!("{p:.2}"),
        p if p >= 0.00095 => {
            let places = (1.0 - p.log10().floor()) as usize;
            format!("{p:.places$}")
        }
        p if p >= 1e-99 => format!("{p:.1e}"),
        _ => "below 1e-99".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::probability;

    #[test]
    fn probabilities_have_two_digits() {
        let shown = [0.8541, 0.0999, 0.0478, 0.00223, 0.00012, 3e-9, 0.0, 1.0].map(probability);
        assert_eq!(shown, ["0.85", "0.10", "0.048", "0.0022", "1.2e-4", "3.0e-9", "below 1e-99", "1.00"]);
    }
}
