//! What the deviations say of the stated tolerances, in words.

use super::details::digits;
use super::summary::Summary;
use crate::files::{ProblemFile, ToleranceFactor};
use crate::identify::verdict::chi_square::probability;
use crate::identify::{ToleranceTest, ToleranceVerdict};
use crate::model::{Link, Prior};

/// Tolerance, in rad or machine sizes, beyond which a machine is not the one that was drawn.
const ABSURD: f64 = 0.3;
/// Different tolerances that a warning writes out.
const WRITTEN: usize = 3;

/// What the test says, in a sentence without its full stop.
pub(super) fn sentence(test: &ToleranceTest) -> String {
    let three = |value: f64| crate::render::text::digits(value, 3);
    let (low, high) = test.interval;
    let size = format!("{} times ({} to {})", three(test.factor), three(low), three(high));
    match test.verdict {
        ToleranceVerdict::Explained if low > 1.0 => {
            format!("doubtful: the deviations are {size} what the stated tolerances make them")
        }
        ToleranceVerdict::Explained => {
            format!("the stated tolerances explain the deviations, which are {size} what they make them")
        }
        ToleranceVerdict::TooSmall => {
            format!("the deviations are {size} what the stated tolerances make them")
        }
        ToleranceVerdict::TooLarge => format!(
            "the deviations are {size} what the stated tolerances make them; standard errors keep the stated ones"
        ),
    }
}

/// The line of the summary.
pub(super) fn line(of: &Summary<'_>) -> String {
    of.found.tolerance_test.as_ref().map_or_else(String::new, |test| {
        format!(
            "tolerances  {} directions decided, probability {}: {}\n",
            test.directions,
            probability(test.probability),
            sentence(test)
        )
    })
}

/// What to do where the deviations are larger than the tolerances make them.
pub(super) fn warning(of: &Summary<'_>) -> Option<String> {
    let test = of.found.tolerance_test.as_ref()?;
    if test.verdict != ToleranceVerdict::TooSmall {
        return None;
    }
    let mut text = sentence(test);
    // Postures that stand out drag the machine after them, and only then the deviations: mended, they may be as stated.
    if of.judgement.is_spoiled() {
        let (what, them) = match of.judgement.outliers.len() {
            1 => ("the posture that stands out may have done that", "it"),
            _ => ("the postures that stand out may have done that", "them"),
        };
        return Some(format!(
            "{text}: {what}; correct or remove {them} before anything is believed of the tolerances"
        ));
    }
    let residual = of.judgement.birge_ratio().is_some() || !of.judgement.outliers.is_empty();
    if residual {
        text.push_str(", and the residual is not explained either: errors that the model does not have may be the cause");
    }
    text.push_str(&match test.in_force != 1.0 {
        true => format!(
            "; estimate, standard errors and predictions are those of tolerances {} times as large",
            digits(test.in_force)
        ),
        false => "; standard errors and predictions suppose the stated ones and are too small".to_owned(),
    });
    let factor = if test.in_force != 1.0 { test.in_force } else { test.factor };
    let mistakes =
        "check units, home, directions of axes, actuator order and how rotations are written (gough check)";
    text.push_str(&match is_absurd(of.problem, factor) {
        true => format!(". No machine is that far off: {mistakes}"),
        false => format!(
            ". If the machine may be that far off, {}; if not, {mistakes}",
            restated(of.problem, factor)
        ),
    });
    Some(text)
}

/// Whether tolerances so many times as large are beyond what a drawing may be off by.
pub(super) fn is_absurd(problem: &ProblemFile, factor: f64) -> bool {
    let size = problem.mechanism.characteristic_length();
    let links = problem.mechanism.limbs.iter().flat_map(|limb| &limb.links).map(pair);
    let relative = links.flat_map(|(angle, length)| [angle, length.map(|v| v / size)]).flatten();
    relative.fold(0.0, f64::max) * factor > ABSURD
}

/// What to write into the file.
pub(super) fn restated(problem: &ProblemFile, factor: f64) -> String {
    let units = problem.units;
    let links = problem.mechanism.limbs.iter().flat_map(|limb| &limb.links);
    let mut stated: Vec<(Option<f64>, Option<f64>)> = Vec::new();
    for link in links {
        let pair = pair(link);
        if pair != (None, None) && !stated.contains(&pair) {
            stated.push(pair);
        }
    }
    if stated.is_empty() || stated.len() > WRITTEN {
        return format!("multiply the tolerances by {}", digits(factor));
    }
    let written = |(angle, length): (Option<f64>, Option<f64>), factor: f64| {
        let shown = |v: f64| crate::render::text::digits(v * factor, 3);
        let parts = [
            angle.map(|v| format!("\"angle\": {}", shown(units.from_radians(v)))),
            length.map(|v| format!("\"length\": {}", shown(units.from_metres(v)))),
        ];
        let parts: Vec<String> = parts.into_iter().flatten().collect();
        parts.join(", ")
    };
    let each = stated
        .iter()
        .map(|pair| format!("{{{}}} for tolerances of {{{}}}", written(*pair, factor), written(*pair, 1.0)));
    format!("write {}", each.collect::<Vec<_>>().join(", "))
}

fn pair(link: &Link) -> (Option<f64>, Option<f64>) {
    let sigma = |prior: Prior| match prior {
        Prior::Sigma(sigma) => Some(sigma),
        Prior::Held | Prior::Free => None,
    };
    (sigma(link.tolerance.angle), sigma(link.tolerance.length))
}

/// The test as a result file states it.
pub(super) fn entry(test: &ToleranceTest) -> ToleranceFactor {
    ToleranceFactor {
        value: test.factor,
        interval: [test.interval.0, test.interval.1],
        probability: test.probability,
        directions: test.directions,
        in_force: test.in_force,
        verdict: sentence(test),
    }
}
