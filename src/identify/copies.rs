//! Samples that are copies of another of their posture.

use crate::calibration::{ByPosture, Sample};

/// Decimals looked at, of rad and m; a number with more is not written on a decimal grid.
const DECIMALS: i32 = 13;
/// Part of itself by which a number may miss the grid on which it was written, from conversion of units.
const ROUNDING: f64 = 1e-14;
/// Digits that a copy must lack beside its original, over all its numbers: by chance one number in ten ends in 0.
const LACKING: i32 = 6;

/// How many samples repeat an earlier one of their posture, number by number as it is or rounded: no instrument reads the
/// same twice, so that they are copies, which tell nothing of what the samples of a posture have in common.
pub fn copies(samples: &[Sample]) -> usize {
    let of_posture = |posture: &[usize]| {
        let mut all: Vec<Written> = posture.iter().map(|&i| Written::of(&samples[i])).collect();
        all.sort_by(|a, b| a.bits().cmp(b.bits()));
        let same = all.windows(2).filter(|pair| pair[0].bits().eq(pair[1].bits())).count();
        all.dedup_by(|a, b| a.bits().eq(b.bits()));
        let most = all.iter().map(|one| one.digits).max().unwrap_or(0);
        // Only what has fewer digits than another is looked for among the others.
        let shorter = all.iter().filter(|one| one.digits + LACKING <= most);
        same + shorter.filter(|copy| all.iter().any(|original| copy.is_rounded(original))).count()
    };
    ByPosture::of(samples).iter().filter(|posture| posture.len() > 1).map(of_posture).sum()
}

/// What was read, and how it is written.
struct Written {
    values: Vec<f64>,
    decimals: Vec<Option<i32>>,
    /// Decimals of all of them.
    digits: i32,
}

impl Written {
    fn of(sample: &Sample) -> Self {
        Self::new(sample.measurement.readings())
    }

    fn new(values: Vec<f64>) -> Self {
        let decimals: Vec<Option<i32>> = values.iter().map(|value| decimals(*value)).collect();
        let digits = decimals.iter().map(|decimals| decimals.unwrap_or(DECIMALS)).sum();
        Self { values, decimals, digits }
    }

    fn bits(&self) -> impl Iterator<Item = u64> {
        self.values.iter().map(|value| value.to_bits())
    }

    /// Whether it has the numbers of `original` with fewer digits. Numbers that are on no decimal grid, such as angles
    /// converted from degrees, do not tell.
    fn is_rounded(&self, original: &Self) -> bool {
        let (mut lacking, mut told) = (0, 0);
        let written = self.values.iter().zip(&self.decimals);
        for ((b, decimals), (a, others)) in written.zip(original.values.iter().zip(&original.decimals)) {
            let Some(decimals) = decimals else { continue };
            let grid = 10f64.powi(-decimals);
            if (a - b).abs() > 0.5 * grid * (1.0 + 1e-6) + ROUNDING * a.abs() {
                return false;
            }
            told += 1;
            lacking += others.unwrap_or(DECIMALS) - decimals;
        }
        self.values.len() == original.values.len() && 2 * told >= self.values.len() && lacking >= LACKING
    }
}

/// Decimals with which a number is written; `None` where that is not seen.
fn decimals(value: f64) -> Option<i32> {
    (0..=DECIMALS).find(|k| {
        let scaled = value * 10f64.powi(*k);
        let rounding = 4.0 * ROUNDING * scaled.abs().max(1.0);
        // On a grid that fine every number lies on it.
        rounding < 0.01 && (scaled - scaled.round()).abs() <= rounding
    })
}

#[cfg(test)]
mod tests {
    use super::{Written, decimals};

    fn is_rounded(original: &[f64], copy: &[f64]) -> bool {
        Written::new(copy.to_vec()).is_rounded(&Written::new(original.to_vec()))
    }

    #[test]
    fn rounded_numbers_are_told_from_others() {
        assert_eq!([0.25, 12.0, 0.123456].map(decimals), [Some(2), Some(0), Some(6)]);
        assert_eq!(decimals(1.0 / 3.0), None);
        let original = [0.812345678912, -0.10234567891, 0.40000012345];
        // In mm with two decimals, converted to m.
        assert!(is_rounded(&original, &[812.35e-3, -102.35e-3, 400.0e-3]));
        assert!(!is_rounded(&original, &original));
        // Another reading of the same resolution, and one that ends in a 0.
        assert!(!is_rounded(&original, &[0.812345678812, -0.10234567891, 0.40000012345]));
        assert!(!is_rounded(&[0.81234, -0.10234, 0.40001], &[0.81234, -0.1023, 0.40001]));
        // Rounded, but of another reading.
        assert!(!is_rounded(&original, &[812.36e-3, -102.35e-3, 400.0e-3]));
    }
}
