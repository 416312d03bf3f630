//! Cost and step of each iteration.

use super::weight;
use crate::files::ResultFile;
use crate::render::{Axis, Figure, Kind, Part, Section, Series, Style};

/// Two figures, or a sentence where nothing was iterated; a third where a weight was chosen.
pub(super) fn section(result: &ResultFile) -> Section {
    let section = Section::new("Convergence");
    if result.trace.is_empty() {
        let section = section.with(Part::Text("No iteration was accepted.".into()));
        return with_weight(section, result);
    }
    let figure = |id: &str, title: &str, label: &str, style: usize, of: &dyn Fn(usize) -> f64| {
        let points: Vec<(f64, f64)> = (0..result.trace.len()).map(|k| ((k + 1) as f64, of(k))).collect();
        let x = Axis::whole("accepted iteration").spanning(0.5, points.len() as f64 + 0.5);
        let sizes = || points.iter().map(|p| p.1).filter(|v| *v > 0.0 && v.is_finite());
        let (low, high) = sizes().fold((f64::INFINITY, 0.0_f64), |(low, high), v| (low.min(v), high.max(v)));
        // Within a decade a logarithmic axis has hardly a tick.
        let y = if high < 10.0 * low { Axis::linear(label) } else { Axis::log(label) };
        Figure::new(id, title, x, y).with(Series::new("", Kind::LinePoints, Style::numbered(style), &points))
    };
    let cost = figure("cost", "Merit after each step", "merit (half a sum of squares)", 0, &|k| {
        result.trace[k].cost
    });
    let step = figure("step", "Length of each step", "step / identifier's coordinates", 1, &|k| {
        result.trace[k].step
    });
    let section = section
        .with(Part::Figure(cost.captioned(
            "Half the sum of squared whitened residuals, with whatever the identifier penalises.",
        )))
        .with(Part::Figure(step.captioned("In the identifier's own coordinates: tolerances, for most.")));
    with_weight(section, result)
}

fn with_weight(section: Section, result: &ResultFile) -> Section {
    match weight::figure(result) {
        Some(figure) => section.with(Part::Figure(figure)),
        None => section,
    }
}
