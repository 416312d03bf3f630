//! Axes: what they are called, what they span and where their ticks are.

use super::text::power_of_ten;

/// Ticks aimed at.
const TICKS: f64 = 6.0;
/// Decades that a logarithmic axis spans at most: values farther below the largest are not shown.
const DECADES: f64 = 40.0;

/// An axis of a figure.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// What is shown, with its unit: `position error / mm`.
    pub label: String,
    /// Whether equal distances are equal ratios. Values that are not positive are then left out.
    pub log: bool,
    /// Whether ticks stand at whole numbers only.
    pub whole: bool,
    /// First and last value shown; from the data where it is `None`.
    pub range: Option<(f64, f64)>,
    /// Names of the values 0, 1, 2, ..., where the axis counts things.
    pub categories: Vec<String>,
}

impl Axis {
    /// An axis of equal steps.
    pub fn linear(label: impl Into<String>) -> Self {
        Self { label: label.into(), log: false, whole: false, range: None, categories: Vec::new() }
    }

    /// An axis of equal ratios.
    pub fn log(label: impl Into<String>) -> Self {
        Self { log: true, ..Self::linear(label) }
    }

    /// An axis that counts.
    pub fn whole(label: impl Into<String>) -> Self {
        Self { whole: true, ..Self::linear(label) }
    }

    /// An axis of named things at 0, 1, 2, ...
    pub fn categories(label: impl Into<String>, names: Vec<String>) -> Self {
        Self { categories: names, ..Self::linear(label) }
    }

    /// The same axis from `first` to `last`.
    pub fn spanning(mut self, first: f64, last: f64) -> Self {
        self.range = Some((first, last));
        self
    }

    /// Where a value stands: itself, or its decimal logarithm; `None` where it has no place.
    pub(super) fn place(&self, value: f64) -> Option<f64> {
        let placed = if self.log { value.log10() } else { value };
        placed.is_finite().then_some(placed)
    }

    /// First and last place, and the distance of ticks, for values at these places.
    pub(super) fn scale(&self, places: impl Iterator<Item = f64>) -> Scale {
        if !self.categories.is_empty() {
            return Scale { first: -0.5, last: self.categories.len() as f64 - 0.5, step: 1.0 };
        }
        let stated = self.range.and_then(|(a, b)| Some((self.place(a)?, self.place(b)?)));
        let (mut low, mut high) = stated.unwrap_or_else(|| {
            places.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
        });
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        if self.log {
            let last = (high - 1e-9).ceil();
            let first = (low + 1e-9).floor().max(last - DECADES).min(last - 1.0);
            return Scale { first, last, step: ((last - first) / TICKS).ceil() };
        }
        if high - low <= 1e-12 * high.abs().max(low.abs()) {
            let half = if high == 0.0 { 1.0 } else { 0.5 * high.abs() };
            (low, high) = (low - half, high + half);
        }
        let mut step = nice((high - low) / TICKS);
        if self.whole {
            step = step.max(1.0);
        }
        match stated {
            Some((first, last)) if first < last => Scale { first, last, step },
            _ => Scale { first: (low / step).floor() * step, last: (high / step).ceil() * step, step },
        }
    }

    /// The text at a tick.
    pub(super) fn tick(&self, place: f64, step: f64) -> String {
        if !self.categories.is_empty() {
            let index = place.round();
            let named = (place - index).abs() < 1e-6 && index >= 0.0;
            return named.then(|| self.categories.get(index as usize).cloned()).flatten().unwrap_or_default();
        }
        if self.log {
            return power_of_ten(place.round() as i64);
        }
        // The place of the last digit that tells neighbouring ticks apart.
        let exponent = (step.log10() + 1e-9).floor() as i32;
        let value = if place.abs() < 1e-9 * step { 0.0 } else { place };
        if !(-4..=5).contains(&exponent) {
            return if value == 0.0 { "0".into() } else { format!("{value:.1e}") };
        }
        let decimals = usize::try_from(-exponent).unwrap_or(0);
        format!("{value:.decimals$}")
    }
}

/// Extent of an axis in places.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scale {
    pub(super) first: f64,
    pub(super) last: f64,
    pub(super) step: f64,
}

/// The smallest of 1, 2, 5 times a power of ten that is not below `step`.
fn nice(step: f64) -> f64 {
    let power = 10_f64.powf(step.log10().floor());
    let found = [1.0, 2.0, 5.0, 10.0].into_iter().find(|m| m * power >= step * (1.0 - 1e-9));
    found.unwrap_or(10.0) * power
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scale(axis: &Axis, values: &[f64]) -> (f64, f64, f64) {
        let scale = axis.scale(values.iter().filter_map(|v| axis.place(*v)));
        (scale.first, scale.last, scale.step)
    }

    #[test]
    fn ticks_are_round() {
        let linear = Axis::linear("x / mm");
        assert_eq!(scale(&linear, &[0.0, 10.0]), (0.0, 10.0, 2.0));
        assert_eq!(scale(&linear, &[-3.0, 4.1]), (-4.0, 6.0, 2.0));
        assert_eq!(scale(&linear, &[2.0]), (1.0, 3.0, 0.5));
        assert_eq!(scale(&linear, &[]), (0.0, 1.0, 0.2));
        assert_eq!(scale(&Axis::whole("n"), &[1.0, 4.0]), (1.0, 4.0, 1.0));
        assert_eq!(linear.tick(0.30000000000000004, 0.1), "0.3");
        assert_eq!(linear.tick(-4.0, 2.0), "-4");
        assert_eq!(linear.tick(3e-6, 1e-6), "3.0e-6");
    }

    #[test]
    fn decades_are_whole_and_bad_values_have_no_place() {
        let log = Axis::log("s");
        assert_eq!(scale(&log, &[0.02, 300.0, 0.0, -1.0, f64::NAN]), (-2.0, 3.0, 1.0));
        assert_eq!(scale(&log, &[1e-18, 1.0]), (-18.0, 0.0, 3.0));
        assert_eq!(scale(&log, &[10.0]), (0.0, 1.0, 1.0));
        assert_eq!(log.tick(-3.0, 1.0), "10⁻³");
        assert_eq!(log.place(-1.0), None);
    }

    #[test]
    fn categories_stand_at_whole_numbers() {
        let axis = Axis::categories("link", vec!["a".into(), "b".into()]);
        assert_eq!(scale(&axis, &[7.0]), (-0.5, 1.5, 1.0));
        assert_eq!(
            (axis.tick(1.0, 1.0), axis.tick(0.5, 1.0), axis.tick(2.0, 1.0)),
            ("b".into(), String::new(), String::new())
        );
    }
}
