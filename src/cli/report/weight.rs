//! The curve from which the weight of a penalty was chosen.

use crate::files::ResultFile;
use crate::render::text::digits;
use crate::render::{Axis, Figure, Kind, ReferenceLine, Series, Style};
use crate::solve::WeightPoint;
use crate::solve::conic::weight::{WeightRule, best};

/// The figure; `None` where the weight was given.
pub(super) fn figure(result: &ResultFile) -> Option<Figure> {
    let by_noise = result.settings.get("weight").is_some_and(|rule| rule == "discrepancy");
    let rule = if by_noise { WeightRule::Discrepancy } else { WeightRule::CrossValidation };
    let curve: Vec<WeightPoint> =
        result.weights.iter().map(|w| WeightPoint { weight: w.weight, score: w.score }).collect();
    let chosen = best(rule, &curve).filter(|_| !curve.is_empty())?;
    let points: Vec<(f64, f64)> = curve.iter().map(|point| (point.weight, point.score)).collect();
    let (label, caption) = match rule {
        WeightRule::Discrepancy => (
            "residual / noise, mean square",
            "The largest weight that leaves no more than the stated noise, 1, is taken (Morozov's discrepancy principle).",
        ),
        _ => (
            "error of samples left out / noise, mean square",
            "Each weight by how well it predicts samples that took no part, a fifth of them at a time; the least error is \
             taken.",
        ),
    };
    let figure = Figure::new(
        "weight",
        "Choice of the penalty's weight",
        Axis::log("weight of the penalty (1: tolerances as stated)"),
        Axis::log(label),
    )
    .captioned(caption)
    .with(Series::new("", Kind::LinePoints, Style::numbered(2), &points))
    .with_line(ReferenceLine::X(chosen, format!("chosen: {}", digits(chosen, 3))));
    Some(if by_noise { figure.with_line(ReferenceLine::Y(1.0, "noise".into())) } else { figure })
}
