//! Residuals before and after: by pose, by component, against the noise.

use super::scale::Scale;
use super::study::Study;
use crate::files::ResultFile;
use crate::identify::residuals::Residual;
use crate::render::{Axis, Cell, Figure, Kind, Part, ReferenceLine, Section, Series, Style, Table};
use crate::statistics::median;
use statrs::distribution::{ContinuousCDF, Normal};

/// An error that samples have, of one kind of measurement.
#[derive(Clone, Copy)]
struct Measured {
    id: &'static str,
    name: &'static str,
    angular: bool,
    of: fn(&Residual) -> Option<f64>,
}

/// The errors that there are.
const MEASURED: [Measured; 6] = [
    Measured { id: "position", name: "Position", angular: false, of: |r| r.error.position },
    Measured { id: "rotation", name: "Rotation", angular: true, of: |r| r.error.rotation },
    Measured { id: "distance", name: "Distance", angular: false, of: |r| r.error.distance },
    Measured { id: "plane", name: "Height", angular: false, of: |r| r.error.plane },
    Measured { id: "joint-angle", name: "Joint angle", angular: true, of: |r| r.error.joint_angle },
    Measured { id: "joint-length", name: "Joint length", angular: false, of: |r| r.error.joint_length },
];

/// Postures listed.
const LISTED: usize = 10;
/// Residuals of a posture by the machine as drawn and as identified.
type Pair = (Option<Residual>, Option<Residual>);

const COMPONENTS: [&str; 6] = ["rx", "ry", "rz", "x", "y", "z"];

/// Figures and tables of residuals.
pub(super) fn section(result: &ResultFile, study: &Study) -> Section {
    let mut section = Section::new("Residuals");
    let after: Vec<&Residual> = study.residuals.iter().filter_map(|pair| pair.1.as_ref()).collect();
    if after.is_empty() {
        return section.with(Part::Text("No posture closes with the identified machine.".into()));
    }
    let mut measured = MEASURED.to_vec();
    measured.retain(|m| after.iter().any(|r| (m.of)(r).is_some()));
    let scaled: Vec<(Measured, Scale)> = measured
        .into_iter()
        .map(|m| {
            let middle = median(after.iter().filter_map(|r| (m.of)(r))).unwrap_or(0.0);
            let scale = if m.angular { Scale::angle(middle, result.units) } else { Scale::length(middle) };
            (m, scale)
        })
        .collect();
    section.parts.extend(scaled.iter().map(|(m, scale)| Part::Figure(by_pose(study, m, *scale))));
    let by_parts = after.iter().any(|r| r.components.iter().any(Option::is_some));
    if by_parts {
        section.parts.push(Part::Figure(by_component(&after)));
    }
    section.parts.push(Part::Figure(quantiles(&after)));
    if by_parts {
        section.parts.push(Part::Table(component_table(result, study)));
    }
    section.parts.push(Part::Table(standing_out(study, &scaled)));
    section
}

fn by_pose(study: &Study, Measured { id, name, of, .. }: &Measured, scale: Scale) -> Figure {
    let points = |after: bool| -> Vec<(f64, f64)> {
        let residuals =
            study.residuals.iter().map(|pair| if after { pair.1.as_ref() } else { pair.0.as_ref() });
        let values = residuals.enumerate().filter_map(|(k, r)| Some(((k + 1) as f64, scale.of(of(r?)?))));
        values.collect()
    };
    let x = Axis::whole("posture").spanning(0.0, study.residuals.len() as f64 + 1.0);
    Figure::new(
        format!("{id}-by-pose"),
        format!("{name} error of each posture"),
        x,
        Axis::log(format!("{} error / {}", name.to_lowercase(), scale.symbol)),
    )
    .captioned(
        "Predicted against measured, by the machine as drawn and as identified, in the order of the data.",
    )
    .with(Series::new("as drawn", Kind::Points, Style::numbered(1), &points(false)))
    .with(Series::new("identified", Kind::Points, Style::numbered(0), &points(true)))
}

/// Whitened residuals beside each other, one column a component.
fn by_component(after: &[&Residual]) -> Figure {
    let count = after.len() as f64;
    let mut points = Vec::new();
    for (k, residual) in after.iter().enumerate() {
        for (i, r) in residual.whitened.iter().enumerate() {
            if let Some(r) = r {
                points.push((i as f64 + 0.7 * ((k as f64 + 0.5) / count - 0.5), *r));
            }
        }
    }
    let names = COMPONENTS.map(String::from).to_vec();
    Figure::new(
        "by-component",
        "Residuals of each component",
        Axis::categories("component", names),
        Axis::linear("residual / noise standard deviation"),
    )
    .captioned(
        "After identification, in standard deviations of the noise; within each column in the order of the data. \
         A trend or an offset is an error that the model does not have.",
    )
    .with(Series::new("", Kind::Points, Style::numbered(0), &points))
    .with_line(ReferenceLine::Y(2.0, String::new()))
    .with_line(ReferenceLine::Y(-2.0, String::new()))
}

fn quantiles(after: &[&Residual]) -> Figure {
    let mut values: Vec<f64> = after.iter().flat_map(|r| r.rows.iter().copied()).collect();
    values.sort_by(f64::total_cmp);
    let count = values.len() as f64;
    let normal = Normal::standard();
    let points: Vec<(f64, f64)> =
        values.iter().enumerate().map(|(k, v)| (normal.inverse_cdf((k as f64 + 0.5) / count), *v)).collect();
    let end = points.last().map_or(1.0, |p| p.0);
    Figure::new(
        "quantiles",
        "Residuals against the stated noise",
        Axis::linear("quantile of the standard normal distribution"),
        Axis::linear("residual / noise standard deviation"),
    )
    .captioned(
        "All whitened residuals, sorted. On the line they are as the noise says; a flatter row is what fitting many \
         parameters leaves; ends that turn away are gross errors.",
    )
    .with(Series::new("", Kind::Points, Style::numbered(0), &points))
    .with(Series::new("stated noise", Kind::Dashed, Style::numbered(1), &[(-end, -end), (end, end)]))
}

fn component_table(result: &ResultFile, study: &Study) -> Table {
    let columns =
        ["component", "unit", "#rms as drawn", "#rms identified", "#mean identified", "#rms in noise"];
    let mut table = Table::new("components", "Residuals of each component.", &columns)
        .captioned("In {S} axes: rotation vector and displacement of the tool point.");
    let units = result.units;
    for (i, name) in COMPONENTS.iter().enumerate() {
        let of = |pick: &dyn Fn(&Pair) -> Option<f64>| -> Vec<f64> {
            study.residuals.iter().filter_map(pick).collect()
        };
        let before = of(&|pair| pair.0.as_ref()?.components[i]);
        let after = of(&|pair| pair.1.as_ref()?.components[i]);
        let whitened = of(&|pair| pair.1.as_ref()?.whitened[i]);
        if after.is_empty() {
            continue;
        }
        let shown = |v: f64| if i < 3 { units.from_radians(v) } else { units.from_metres(v) };
        let mean = after.iter().sum::<f64>() / after.len() as f64;
        table.push(vec![
            Cell::text(*name),
            Cell::text(if i < 3 { units.angle_symbol() } else { units.length_symbol() }),
            Cell::number(shown(rms(&before)), 3),
            Cell::number(shown(rms(&after)), 3),
            Cell::number(shown(mean), 3),
            Cell::number(rms(&whitened), 3),
        ]);
    }
    table
}

fn standing_out(study: &Study, scaled: &[(Measured, Scale)]) -> Table {
    let mut columns = vec!["posture".to_owned(), "#residual in noise".into()];
    columns.extend(scaled.iter().map(|(m, s)| format!("#{} error / {}", m.name.to_lowercase(), s.symbol)));
    let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
    let mut table = Table::new("standing-out", "Postures that fit worst.", &columns)
        .captioned("By root mean square of the whitened residual after identification.");
    let mut worst: Vec<&Residual> = study.residuals.iter().filter_map(|pair| pair.1.as_ref()).collect();
    worst.sort_by(|a, b| b.weighted_rms().total_cmp(&a.weighted_rms()).then_with(|| a.name.cmp(&b.name)));
    for residual in worst.into_iter().take(LISTED) {
        let shown =
            |v: Option<f64>, scale: Scale| v.map_or_else(Cell::none, |v| Cell::number(scale.of(v), 3));
        let mut row = vec![Cell::text(&residual.name), Cell::number(residual.weighted_rms(), 3)];
        row.extend(scaled.iter().map(|(m, scale)| shown((m.of)(residual), *scale)));
        table.push(row);
    }
    table
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / f64::max(values.len() as f64, 1.0)).sqrt()
}
