//! Uncertainty of predicted poses over the workspace.

use super::scale::Scale;
use super::study::Study;
use crate::files::ResultFile;
use crate::identify::spread::{PoseSpread, pose_spreads};
use crate::render::text::digits;
use crate::render::{Axis, Figure, Kind, Marker, Part, Section, Series, Shape, Style};
use crate::simulate::draw_postures;
use crate::statistics::median;

/// Postures drawn.
const POSTURES: usize = 400;
/// Classes of uncertainty.
const CLASSES: usize = 6;

/// Maps from above and from the side.
pub(super) fn section(result: &ResultFile, study: &Study) -> Section {
    let section = Section::new("Predicted poses");
    let Some(root) = &study.root else {
        return section.with(Part::Text(study.no_covariance(result).into()));
    };
    let measured: Vec<Vec<f64>> = study.training.iter().map(|sample| sample.actuators.clone()).collect();
    // Where the ranges hold too few postures that close, the measured ones stand in.
    let (actuators, which) = match draw_postures(&study.start, &[&study.geometry], POSTURES, 1) {
        Ok(drawn) => (drawn, format!("{POSTURES} random postures within the actuators' ranges")),
        Err(_) => (measured, "the measured postures".into()),
    };
    let spreads = match pose_spreads(&study.supported, &study.at, root, &actuators) {
        Ok(spreads) if !spreads.is_empty() => spreads,
        Ok(_) => return section.with(Part::Text("No posture closes from home.".into())),
        Err(why) => return section.with(Part::Text(format!("The uncertainty cannot be evaluated: {why}."))),
    };
    let middle = |of: &dyn Fn(&PoseSpread) -> f64| median(spreads.iter().map(of)).unwrap_or(0.0);
    let (position, rotation) = (middle(&|s| s.position), middle(&|s| s.rotation));
    let (length, angle) = (Scale::length(position), Scale::angle(rotation, result.units));
    let worst = |of: &dyn Fn(&PoseSpread) -> f64| spreads.iter().map(of).fold(0.0, f64::max);
    let text = format!(
        "How far predictions of the identified machine may be off, by what the data left open: root mean square \
         displacement of the tool point and angle, at {which}. Median {} {} and {} {}, at worst {} {} and {} {}. \
         Errors that the model does not have are not in it.",
        digits(length.of(position), 3),
        length.symbol,
        digits(angle.of(rotation), 3),
        angle.symbol,
        digits(length.of(worst(&|s| s.position)), 3),
        length.symbol,
        digits(angle.of(worst(&|s| s.rotation)), 3),
        angle.symbol,
    );
    let position = |s: &PoseSpread| length.of(s.position);
    let rotation = |s: &PoseSpread| angle.of(s.rotation);
    let map = |id: &str, title: &str, symbol: &str, axes: (usize, usize), of: &dyn Fn(&PoseSpread) -> f64| {
        Part::Figure(map(result, &spreads, (id, title, symbol), axes, of))
    };
    section
        .with(Part::Text(text))
        .with(map("position-above", "Position uncertainty from above", length.symbol, (0, 1), &position))
        .with(map("position-side", "Position uncertainty from the side", length.symbol, (0, 2), &position))
        .with(map("rotation-above", "Rotation uncertainty from above", angle.symbol, (0, 1), &rotation))
        .with(map("rotation-side", "Rotation uncertainty from the side", angle.symbol, (0, 2), &rotation))
}

fn map(
    result: &ResultFile,
    spreads: &[PoseSpread],
    (id, title, symbol): (&str, &str, &str),
    (across, up): (usize, usize),
    of: &dyn Fn(&PoseSpread) -> f64,
) -> Figure {
    let mut values: Vec<f64> = spreads.iter().map(of).collect();
    values.sort_by(f64::total_cmp);
    // Equal steps up to all but the largest fiftieth, which would else be the only ones told apart.
    let low = values.first().copied().unwrap_or(0.0);
    let high = values.get((values.len() * 49) / 50).or(values.last()).copied().unwrap_or(1.0);
    let step = ((high - low) / CLASSES as f64).max(f64::MIN_POSITIVE);
    let class = |v: f64| (((v - low) / step) as usize).min(CLASSES - 1);
    let units = result.units;
    let axis = |i: usize| Axis::linear(format!("{} / {}", ["x", "y", "z"][i], units.length_symbol()));
    let mut figure = Figure::new(id, title, axis(across), axis(up)).shaped(Shape::Square).captioned(format!(
        "Colour: root mean square uncertainty in {symbol}, at the predicted tool point in {{S}}."
    ));
    for k in 0..CLASSES {
        let points = spreads.iter().filter(|s| class(of(s)) == k);
        let points: Vec<(f64, f64)> =
            points.map(|s| (units.from_metres(s.tool[across]), units.from_metres(s.tool[up]))).collect();
        let edge = |k: usize| digits(low + step * k as f64, 3);
        let name = match k + 1 {
            CLASSES => format!("above {} {symbol}", edge(k)),
            _ => format!("{} to {} {symbol}", edge(k), edge(k + 1)),
        };
        let style = Style { marker: Marker::Circle, ..Style::sequential(k, CLASSES) };
        figure = figure.with(Series::new(name, Kind::Points, style, &points));
    }
    figure
}
