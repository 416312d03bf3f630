//! Which readings scatter otherwise than stated: chi-square by set, kind, component and axis (docs/theory.md (10.11)).

use super::cells::{Axis, Cell, Quantity};
use super::linear::{Grams, Linear, Solution};
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Probability with which any group at all is named where none is to blame.
const FALSE_ALARM: f64 = 0.002;
/// Degrees of freedom below which a group is not judged.
const FEW: f64 = 3.0;
/// Groups whose restricted likelihood is computed: the likeliest ones by their own chi-square.
const TRIED: usize = 8;
/// Groups named at most.
const MOST: usize = 4;
/// Steps to a factor, and the relative change at which it is found.
const STEPS: usize = 25;
const FOUND: f64 = 1e-3;
/// Least variance, in stated ones.
const LEAST: f64 = 1e-12;
/// Standard errors by which a factor must differ from what was stated where others are beside it.
const SURE: f64 = 3.0;
/// Gain of twice the log likelihood by which a group of fewer readings must beat one that is said in fewer words.
const SIMPLER: f64 = 4.0;

/// Some of the cells, and what they are called.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Group {
    /// Such as `the angles of set 2`.
    pub name: String,
    /// Indices of its cells.
    pub cells: Vec<usize>,
}

/// Chi-square of a group of readings.
#[derive(Clone, Debug, PartialEq)]
pub struct GroupTest {
    /// Such as `the angles of set 2`.
    pub name: String,
    /// Sum of squares of its residuals, in stated standard deviations.
    pub value: f64,
    /// Its expectation under the stated noise.
    pub degrees_of_freedom: f64,
}

/// Noise of one group of readings.
#[derive(Clone, Debug, PartialEq)]
pub struct NoisePart {
    /// What the group is called.
    pub name: String,
    /// Its residuals in units of what the stated noise makes them, by the estimate as it is.
    pub ratio: f64,
    /// Standard deviation of its noise that the data support, in stated ones.
    pub factor: f64,
    /// Standard error of the factor.
    pub error: f64,
}

/// Groups whose noise is not what was stated.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseFinding {
    /// The groups, the one with the most evidence first.
    pub parts: Vec<NoisePart>,
    /// What the other readings are called and how they scatter in stated standard deviations, where there are others.
    pub others: Option<(String, f64)>,
    /// Log likelihood that it gains.
    pub gain: f64,
}

impl NoiseFinding {
    /// Whether it is the noise of all readings.
    pub fn is_of_all(&self) -> bool {
        self.others.is_none() && self.parts.len() == 1
    }

    /// Keeps what is surely less than stated, with the likelihood that this gains by itself.
    pub(super) fn keep_overstated(&mut self) {
        let before = self.parts.len();
        self.parts.retain(|part| part.factor + SURE * part.error < 1.0);
        if self.parts.len() < before {
            // A factor's standard error is `factor / sqrt(2 freedom)`.
            let gain = |part: &NoisePart| {
                let (freedom, variance) = (0.5 * (part.factor / part.error).powi(2), part.factor.powi(2));
                0.5 * freedom * (variance - 1.0 - variance.ln())
            };
            self.gain = self.parts.iter().map(gain).sum();
        }
    }

    /// What was found, without a full stop.
    pub fn sentence(&self) -> String {
        let word = match () {
            () if self.parts.iter().all(|part| part.factor < 1.0) => "overstated",
            () if self.parts.iter().all(|part| part.factor >= 1.0) => "understated",
            () => "not as stated",
        };
        if let (true, Some(part)) = (self.is_of_all(), self.parts.first()) {
            let ratio = match part.ratio {
                ratio if ratio < 1e-3 => "less than 0.001".to_owned(),
                ratio => format!("{ratio:.3}"),
            };
            let or = match part.factor < 1.0 {
                true => "readings that are not independent",
                false => "errors that the model does not have and that neighbouring postures do not share",
            };
            return format!(
                "the residual is {ratio} times what the stated noise makes it: noise {word}, or {or}"
            );
        }
        let mut seen: Vec<String> =
            self.parts.iter().map(|part| format!("{} are {}", part.name, number(part.ratio))).collect();
        if let Some(first) = seen.first_mut() {
            first.push_str(" of the stated noise");
        }
        seen.extend(self.others.iter().map(|(name, factor)| format!("{name} {}", number(*factor))));
        let supported: Vec<String> = self
            .parts
            .iter()
            .map(|part| {
                let of = if self.parts.len() > 1 { format!(" for {}", part.name) } else { String::new() };
                format!("{} +- {} of what is stated{of}", number(part.factor), number(part.error))
            })
            .collect();
        format!("{}: noise {word}; the data support {}", seen.join(", "), supported.join(", "))
    }
}

/// Two digits.
pub(super) fn number(v: f64) -> String {
    if v < 1e-6 {
        return format!("{v:.1e}");
    }
    let places = (1.0 - v.abs().log10().floor()).clamp(0.0, 6.0) as usize;
    format!("{v:.places$}")
}

/// All groups that can be told apart, those said in the fewest words first.
pub(super) fn groups(cells: &[Cell]) -> Vec<Group> {
    let sets = cells.iter().map(|cell| cell.set).max().unwrap_or(0) + 1;
    let mut found: Vec<Group> = Vec::new();
    let mut add = |name: String, of: &dyn Fn(&Cell) -> bool| {
        let own: Vec<usize> = (0..cells.len()).filter(|&i| of(&cells[i])).collect();
        if !own.is_empty() && !found.iter().any(|group| group.cells == own) {
            found.push(Group { name, cells: own });
        }
    };
    let several = sets > 1;
    let kinds = [(true, "the angles"), (false, "the lengths")];
    let mut quantities: Vec<Quantity> = cells.iter().map(|cell| cell.quantity).collect();
    quantities.sort_unstable();
    quantities.dedup();
    let mut axes: Vec<(Quantity, Axis)> = cells.iter().filter_map(|c| Some((c.quantity, c.axis?))).collect();
    axes.sort_unstable();
    axes.dedup();
    add("all readings".into(), &|_| true);
    for set in (0..sets).filter(|_| several) {
        add(format!("the readings of set {}", set + 1), &|c| c.set == set);
    }
    for (angular, name) in kinds {
        add(name.into(), &|c| c.quantity.is_angular() == angular);
    }
    for &quantity in &quantities {
        add(format!("the {}", quantity.name()), &|c| c.quantity == quantity);
    }
    for set in (0..sets).filter(|_| several) {
        for (angular, name) in kinds {
            add(format!("{name} of set {}", set + 1), &|c| {
                c.set == set && c.quantity.is_angular() == angular
            });
        }
        for &quantity in &quantities {
            let name = format!("the {} of set {}", quantity.name(), set + 1);
            add(name, &|c| c.set == set && c.quantity == quantity);
        }
    }
    for &(quantity, axis) in &axes {
        add(axis_name(quantity, axis), &|c| c.quantity == quantity && c.axis == Some(axis));
    }
    for set in (0..sets).filter(|_| several) {
        for &(quantity, axis) in &axes {
            let name = format!("{} of set {}", axis_name(quantity, axis), set + 1);
            add(name, &|c| c.set == set && c.quantity == quantity && c.axis == Some(axis));
        }
    }
    found
}

/// What a cell is called.
pub(super) fn cell_name(cells: &[Cell], index: usize) -> String {
    let Some(cell) = cells.get(index) else { return "the readings".into() };
    let what = match cell.axis {
        Some(axis) => axis_name(cell.quantity, axis),
        None => format!("the {}", cell.quantity.name()),
    };
    let several = cells.iter().any(|other| other.set != cell.set);
    if several { format!("{what} of set {}", cell.set + 1) } else { what }
}

fn axis_name(quantity: Quantity, axis: Axis) -> String {
    let what = if quantity == Quantity::Rotation { "the rotations about" } else { "the positions along" };
    match axis {
        Axis::Frame(i) => format!("{what} {}", ["x", "y", "z"].get(i).copied().unwrap_or("?")),
        Axis::Sensor(i) => format!("the {} of sensor {}", quantity.name(), i + 1),
        Axis::Principal(i) => format!("{what} principal axis {} of their noise", i + 1),
    }
}

/// Chi-square of each group, at an estimate.
pub(super) fn tests(groups: &[Group], at: &Solution) -> Vec<GroupTest> {
    let sum = |of: &[f64], group: &Group| group.cells.iter().map(|&i| of[i]).sum::<f64>();
    let test = |group: &Group| GroupTest {
        name: group.name.clone(),
        value: sum(&at.square, group),
        degrees_of_freedom: sum(&at.freedom, group),
    };
    groups.iter().map(test).collect()
}

/// Which groups contradict the stated noise, under which the estimate is `stated`, by how much, and the variance of each cell that follows. Group after
/// group the one that restricted likelihood (Patterson & Thompson, *Biometrika* 58, 1971) prefers is given a factor, until
/// none is left that contradicts what they have.
pub(super) fn noise(linear: &Linear, grams: &Grams, stated: &Solution) -> (Option<NoiseFinding>, Vec<f64>) {
    let all = groups(&linear.cells);
    let mut factors = vec![1.0; linear.cells.len()];
    let mut here = stated.clone();
    let mut chosen: Vec<usize> = Vec::new();
    while chosen.len() < MOST {
        let tested = tests(&all, &here);
        let level = FALSE_ALARM / all.len() as f64;
        let mut candidates: Vec<usize> = (0..all.len())
            .filter(|&k| tested[k].degrees_of_freedom >= FEW && tested[k].probability() < level)
            .collect();
        candidates.sort_by(|&a, &b| tested[b].likelihood().total_cmp(&tested[a].likelihood()));
        candidates.truncate(TRIED);
        candidates.sort_unstable();
        let mut best: Option<(usize, Vec<f64>, Solution)> = None;
        for k in candidates {
            let Some((found, at)) = fitted(linear, grams, &factors, &all[k]) else { continue };
            if best.as_ref().is_none_or(|(_, _, best)| at.objective < best.objective - SIMPLER) {
                best = Some((k, found, at));
            }
        }
        let Some((k, found, at)) = best else { break };
        if at.objective > here.objective {
            break;
        }
        chosen.push(k);
        (factors, here) = (found, at);
    }
    if chosen.is_empty() {
        return (None, factors);
    }
    (Some(finding(&all, &chosen, &factors, (stated, &here))), factors)
}

impl GroupTest {
    /// Probability of a value as far from its expectation, to either side.
    pub fn probability(&self) -> f64 {
        let law = ChiSquared::new(self.degrees_of_freedom);
        law.map_or(1.0, |law| (2.0 * law.sf(self.value).min(law.cdf(self.value))).min(1.0))
    }

    /// Residuals in units of what the stated noise makes them.
    pub fn ratio(&self) -> f64 {
        (self.value / self.degrees_of_freedom).sqrt()
    }

    /// Twice the log likelihood that a factor of its own gains, the estimate unchanged.
    fn likelihood(&self) -> f64 {
        let q = (self.value / self.degrees_of_freedom).max(LEAST);
        self.degrees_of_freedom * (q - 1.0 - q.ln())
    }
}

/// The factors under which the group's chi-square is its expectation.
fn fitted(linear: &Linear, grams: &Grams, from: &[f64], group: &Group) -> Option<(Vec<f64>, Solution)> {
    let mut factors = from.to_vec();
    let mut at = linear.solve(grams, &factors)?;
    for _ in 0..STEPS {
        let sum = |of: &[f64]| group.cells.iter().map(|&i| of[i]).sum::<f64>();
        let ratio = sum(&at.square) / sum(&at.freedom).max(1e-3);
        group.cells.iter().for_each(|&i| factors[i] = (factors[i] * ratio).max(LEAST));
        at = linear.solve(grams, &factors)?;
        if (ratio - 1.0).abs() < FOUND {
            break;
        }
    }
    Some((factors, at))
}

/// The groups in words: of each the factor of those of its cells that no later group has.
fn finding(
    all: &[Group],
    chosen: &[usize],
    factors: &[f64],
    (stated, at): (&Solution, &Solution),
) -> NoiseFinding {
    let name_of = |cells: &[usize], otherwise: &str| {
        all.iter().find(|group| group.cells == cells).map_or(otherwise.to_owned(), |group| group.name.clone())
    };
    let sum = |cells: &[usize], of: &dyn Fn(usize) -> f64| cells.iter().map(|&i| of(i)).sum::<f64>();
    let mut parts = Vec::new();
    let mut taken: Vec<usize> = Vec::new();
    for (place, &k) in chosen.iter().enumerate() {
        let later = chosen[place + 1..].iter().flat_map(|&other| all[other].cells.iter());
        let later: Vec<usize> = later.copied().collect();
        let own: Vec<usize> = all[k].cells.iter().copied().filter(|i| !later.contains(i)).collect();
        let freedom = sum(&own, &|i| at.freedom[i]).max(1e-9);
        let factor = (sum(&own, &|i| at.freedom[i] * factors[i]) / freedom).sqrt();
        let ratio = (sum(&own, &|i| stated.square[i]) / sum(&own, &|i| stated.freedom[i]).max(1e-9)).sqrt();
        if !own.is_empty() {
            let error = factor / (2.0 * freedom.max(1.0)).sqrt();
            parts.push(NoisePart { name: name_of(&own, &all[k].name), ratio, factor, error });
        }
        taken.extend(&all[k].cells);
    }
    let rest: Vec<usize> = (0..factors.len()).filter(|i| !taken.contains(i)).collect();
    let freedom = sum(&rest, &|i| at.freedom[i]);
    let others = (freedom >= FEW).then(|| {
        let scatter = (sum(&rest, &|i| at.square[i] * factors[i]) / freedom).sqrt();
        (name_of(&rest, "the other readings"), scatter)
    });
    NoiseFinding { parts, others, gain: 0.5 * (stated.objective - at.objective) }
}
