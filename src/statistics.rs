//! Numbers that sum up many runs. Failures are infinite.

/// Two-sided 95 % quantile of the normal distribution.
const Z: f64 = 1.959963984540054;

/// Median and quartiles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Middle {
    /// Quarter below.
    pub low: f64,
    /// Half below.
    pub median: f64,
    /// Three quarters below.
    pub high: f64,
}

/// Quantile `p` (0..=1) of ascending values, linear between order statistics (type 7 of Hyndman and Fan, 1996); an
/// infinite neighbour with weight makes it infinite. `None` of nothing.
pub fn quantile(ascending: &[f64], p: f64) -> Option<f64> {
    let last = ascending.len().checked_sub(1)?;
    let place = p.clamp(0.0, 1.0) * last as f64;
    let below = ascending[place.floor() as usize];
    let above = ascending[(place.ceil() as usize).min(last)];
    let part = place.fract();
    Some(if part == 0.0 || below == above { below } else { below + part * (above - below) })
}

/// The median of the values in any order; those that are not numbers are left out. `None` of nothing.
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    middle(values).map(|middle| middle.median)
}

/// Median and quartiles of the values in any order; those that are not numbers are left out. `None` of nothing.
pub fn middle(values: impl IntoIterator<Item = f64>) -> Option<Middle> {
    let mut values: Vec<f64> = values.into_iter().filter(|v| !v.is_nan()).collect();
    values.sort_by(f64::total_cmp);
    let at = |p| quantile(&values, p);
    Some(Middle { low: at(0.25)?, median: at(0.5)?, high: at(0.75)? })
}

/// Wilson's 95 % interval of a rate (JASA 22(158), 1927); all of 0..1 without trials.
pub fn wilson(successes: usize, trials: usize) -> (f64, f64) {
    if trials == 0 {
        return (0.0, 1.0);
    }
    let (n, p) = (trials as f64, successes as f64 / trials as f64);
    let scale = 1.0 + Z * Z / n;
    let centre = (p + Z * Z / (2.0 * n)) / scale;
    let half = Z / scale * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
    ((centre - half).max(0.0), (centre + half).min(1.0))
}
