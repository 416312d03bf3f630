//! What the data can see: singular values with the three counts, and the directions that it sees worst.

use super::deviations::{COMPONENTS, sigma, tolerance};
use super::study::Study;
use crate::calibration::Coordinates;
use crate::files::ResultFile;
use crate::problem::Form;
use crate::render::{Axis, Cell, Figure, Kind, Part, ReferenceLine, Section, Series, Shape, Style, Table};
use std::ops::Range;

/// Weakest directions shown.
const DIRECTIONS: usize = 6;
/// Components that the matrix of correlations shows.
const SHOWN: usize = 14;
/// Components named of each direction.
const NAMED: usize = 4;
/// Limits between the classes of correlations.
const LIMITS: [f64; 6] = [-0.75, -0.5, -0.25, 0.25, 0.5, 0.75];

/// Singular values, and the directions that are determined worst.
pub(super) fn section(result: &ResultFile, study: &Result<Study, String>) -> Section {
    let mut section = Section::new("What the data can see");
    if result.singular_values.is_empty() {
        section.parts.push(Part::Text("The result cannot be linearised: it has no singular values.".into()));
    } else {
        section.parts.push(Part::Figure(singular_values(result)));
    }
    match study {
        Err(why) => section.parts.push(Part::Text(format!(
            "Correlations of the weakest directions need the problem and its data: {why}."
        ))),
        Ok(study) => match weakest(study) {
            Some((matrix, table)) => section.parts.extend([Part::Figure(matrix), Part::Table(table)]),
            None if study.decoupled && study.root.is_some() => section.parts.push(Part::Text(format!(
                "{} estimates each limb by itself, so that there are no directions of all limbs together to show. The \
                 standard errors of all components are in the table of link deviations.",
                result.solver
            ))),
            None => section.parts.push(Part::Text(study.no_covariance(result).into())),
        },
    }
    section
}

fn singular_values(result: &ResultFile) -> Figure {
    let values = &result.singular_values;
    let points: Vec<(f64, f64)> = values.iter().enumerate().map(|(k, s)| ((k + 1) as f64, *s)).collect();
    let positive = || values.iter().copied().filter(|s| *s > 0.0 && s.is_finite());
    let low = positive().fold(0.5, f64::min);
    let high = positive().fold(2.0, f64::max);
    let x = Axis::whole("number").spanning(0.0, values.len() as f64 + 1.0);
    let mut figure = Figure::new(
        "singular-values",
        "Whitened singular values",
        x,
        Axis::log("singular value (signal / noise)"),
    )
    .captioned(
        "At the solution, in units of tolerance and noise, the signal-to-noise ratio of one tolerance: above 1 the readings know more than the tolerances. \
         Zeros are not drawn. The lines end the three counts.",
    )
    .with(Series::new("singular values", Kind::Points, Style::numbered(0), &points));
    let counts = result.counts;
    for (style, name, count) in [
        (1, "structural", counts.structural),
        (2, "first order", counts.first_order),
        (3, "practical", counts.practical),
    ] {
        let at = count as f64 + 0.5;
        let name = format!("{name}: {count}");
        figure =
            figure.with(Series::new(name, Kind::Dashed, Style::numbered(style), &[(at, low), (at, high)]));
    }
    figure.with_line(ReferenceLine::Y(1.0, "signal = noise".into()))
}

/// Correlations of the components of the directions that are weakest among those that the data determine, and these
/// directions.
fn weakest(study: &Study) -> Option<(Figure, Table)> {
    if study.decoupled {
        return None;
    }
    let (seen, root) = (study.seen.as_ref()?, study.root.as_ref()?);
    let kept = seen.counts.practical.min(root.ncols());
    let range = kept.saturating_sub(DIRECTIONS)..kept;
    let (names, sigma): (Vec<String>, Vec<Option<f64>>) = components(study).into_iter().unzip();
    let coordinates = Coordinates::new(&study.supported, Form::Minimal);
    // In tolerances; components without one do not take part.
    let column = |k: usize| -> Vec<f64> {
        let column: Vec<f64> = root.col(k).iter().copied().collect();
        let d = coordinates.deviations(&column);
        d.iter().zip(&sigma).map(|(d, sigma)| sigma.map_or(0.0, |sigma| d / sigma)).collect()
    };
    let columns: Vec<Vec<f64>> = (0..root.ncols()).map(column).collect();
    let ranked = |column: &[f64]| -> Vec<usize> {
        let mut order: Vec<usize> = (0..column.len()).filter(|&i| column[i] != 0.0).collect();
        order.sort_by(|&a, &b| column[b].abs().total_cmp(&column[a].abs()).then(a.cmp(&b)));
        order
    };
    let mut shown: Vec<usize> = Vec::new();
    for rank in 0..SHOWN {
        for column in columns[range.clone()].iter().rev() {
            if let Some(&i) = ranked(column).get(rank)
                && !shown.contains(&i)
                && shown.len() < SHOWN
            {
                shown.push(i);
            }
        }
    }
    shown.sort_unstable();
    if shown.is_empty() {
        return None;
    }
    let covariance = |i: usize, j: usize| columns.iter().map(|c| c[i] * c[j]).sum::<f64>();
    let correlation = |i: usize, j: usize| covariance(i, j) / (covariance(i, i) * covariance(j, j)).sqrt();
    let figure = matrix(&shown, &names, correlation);
    let table = table(range, &seen.singular_values, &columns, &names, ranked);
    Some((figure, table))
}

fn components(study: &Study) -> Vec<(String, Option<f64>)> {
    let mut all = Vec::new();
    for limb in &study.start.limbs {
        for link in &limb.links {
            for (i, component) in COMPONENTS.iter().enumerate() {
                all.push((format!("{}.{} {component}", limb.name, link.name), tolerance(link, i)));
            }
        }
    }
    all.extend(study.start.instrument.iter().map(|constant| (constant.name(), sigma(constant.prior))));
    all
}

fn matrix(shown: &[usize], names: &[String], correlation: impl Fn(usize, usize) -> f64) -> Figure {
    let count = LIMITS.len() + 1;
    let mut classes: Vec<Vec<(f64, f64)>> = vec![Vec::new(); count];
    for (x, &i) in shown.iter().enumerate() {
        for (y, &j) in shown.iter().rev().enumerate() {
            let value = correlation(i, j);
            if value.is_finite() {
                let class = LIMITS.iter().filter(|limit| value > **limit).count();
                classes[class].push((x as f64, y as f64));
            }
        }
    }
    let numbers = (1..=shown.len()).map(|k| k.to_string()).collect();
    let labels = shown.iter().enumerate().rev().map(|(k, &i)| format!("{}  {}", names[i], k + 1)).collect();
    let mut figure = Figure::new(
        "correlations",
        "Correlation of what the data determine worst",
        Axis::categories("component, by its number", numbers),
        Axis::categories("", labels),
    )
    .shaped(Shape::Rows(shown.len()))
    .captioned(
        "Correlation between estimated components of link deviations, for the components that make the weakest \
         directions. Strong colours: the data know the sum or the difference, hardly the parts.",
    );
    for (k, points) in classes.iter().enumerate() {
        let low = if k == 0 { -1.0 } else { LIMITS[k - 1] };
        let high = if k + 1 == count { 1.0 } else { LIMITS[k] };
        let name = format!("{low} to {high}");
        figure =
            figure.with(Series::new(name, Kind::Cells { size: 15.0 }, Style::diverging(k, count), points));
    }
    figure
}

fn table(
    range: Range<usize>,
    singular_values: &[f64],
    columns: &[Vec<f64>],
    names: &[String],
    ranked: impl Fn(&[f64]) -> Vec<usize>,
) -> Table {
    let heads = ["#number", "#singular value", "#standard error / tolerance", "mostly"];
    let mut table = Table::new("weakest", "The weakest directions that the data determine.", &heads)
        .captioned("Each with its four largest components, in parts of its length.");
    for k in range.rev() {
        let column = &columns[k];
        let length = crate::linalg::norm(column);
        let parts = ranked(column).into_iter().take(NAMED);
        let parts: Vec<String> = parts.map(|i| format!("{:+.2} {}", column[i] / length, names[i])).collect();
        table.push(vec![
            Cell::count(k + 1),
            Cell::number(singular_values.get(k).copied().unwrap_or(f64::NAN), 3),
            Cell::number(length, 3),
            Cell::text(parts.join(", ")),
        ]);
    }
    table
}
