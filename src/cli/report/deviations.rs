//! Deviations of the links, with their intervals, against the tolerances.

use crate::files::{Model, ResultFile};
use crate::model::{Link, Prior};
use crate::render::{
    Axis, Cell, Figure, Kind, Part, Point, ReferenceLine, Section, Series, Shape, Style, Table,
};

/// Names of the components of a deviation.
pub(super) const COMPONENTS: [&str; 6] = ["rx", "ry", "rz", "x", "y", "z"];
/// Components in the figure with names.
const NAMED: usize = 24;
/// Standard errors from the estimate to the end of its interval (95 %).
const INTERVAL: f64 = 1.96;

/// Tolerance of component `i` of a link, rad or m, where it has one.
pub(super) fn tolerance(link: &Link, i: usize) -> Option<f64> {
    sigma(if i < 3 { link.tolerance.angle } else { link.tolerance.length })
}

/// Standard deviation of a prior, where it has one.
pub(super) fn sigma(prior: Prior) -> Option<f64> {
    match prior {
        Prior::Sigma(sigma) => Some(sigma),
        Prior::Held | Prior::Free => None,
    }
}

/// A component of a deviation, in units of the file.
struct Component {
    limb: usize,
    name: [String; 3],
    value: f64,
    std: Option<f64>,
    tolerance: Option<f64>,
    angular: bool,
}

impl Component {
    /// Deviation and standard error in tolerances.
    fn scaled(&self) -> Option<(f64, Option<f64>)> {
        let tolerance = self.tolerance?;
        Some((self.value / tolerance, self.std.map(|std| std / tolerance)))
    }

    fn label(&self) -> String {
        format!("{}.{} {}", self.name[0], self.name[1], self.name[2])
    }
}

/// Two figures and the table of all components.
pub(super) fn section(result: &ResultFile, model: &Model) -> Section {
    let all = components(result, model);
    let intervals = if has_intervals(&all) {
        "Intervals are 95 %; what the data cannot see keeps the width of its tolerance."
    } else {
        "The result has no standard errors, so that no intervals are drawn."
    };
    let mut section = Section::new("Link deviations").with(Part::Text(format!(
        "Each link deviates from the drawing by a small rotation (rx, ry, rz) and translation (x, y, z) in the frame of \
         the joint that it carries. {intervals}"
    )));
    if result.placement.is_some() || result.tool_mounting.is_some() {
        section.parts.push(Part::Table(mounts(result)));
    }
    section.parts.push(Part::Figure(largest(&all)));
    section.parts.push(Part::Figure(overview(&all)));
    section.parts.push(Part::Table(table(result, &all)));
    if !result.instrument.is_empty() {
        section.parts.push(Part::Table(constants(result)));
    }
    section
}

/// Where free ends were found.
fn mounts(result: &ResultFile) -> Table {
    let heads = ["what", "component", "#identified", "#standard error", "unit"];
    let mut table = Table::new("mounts", "Placement and tool mounting.", &heads).captioned(
        "One motion that all first links have in common (of the drawing in {S}), and one of all last links (of the tool in \
         its frame as drawn). First and last links deviate beside these.",
    );
    let (length, angle) = (result.units.length_symbol(), result.units.angle_symbol());
    for (name, mount) in [("placement", &result.placement), ("tool mounting", &result.tool_mounting)] {
        let Some(mount) = mount else { continue };
        let all = mount.rotation.into_iter().chain(mount.position);
        for (i, value) in all.enumerate() {
            let std =
                mount.std.as_ref().map(|std| if i < 3 { std.rotation[i] } else { std.translation[i - 3] });
            table.push(vec![
                Cell::text(name),
                Cell::text(COMPONENTS[i]),
                Cell::number(value, 7),
                std.map_or_else(Cell::none, |std| Cell::number(std, 3)),
                Cell::text(if i < 3 { angle } else { length }),
            ]);
        }
    }
    table
}

/// What was found of the instrument.
fn constants(result: &ResultFile) -> Table {
    let heads = ["constant", "#as stated", "#identified", "#standard error"];
    let mut table = Table::new("instrument", "Constants of the instrument.", &heads)
        .captioned("Lengths and angles in units of the file; scales have none.");
    for found in &result.instrument {
        table.push(vec![
            Cell::text(&found.name),
            Cell::number(found.nominal, 6),
            Cell::number(found.value, 6),
            found.std.map_or_else(Cell::none, |std| Cell::number(std, 3)),
        ]);
    }
    table
}

fn components(result: &ResultFile, model: &Model) -> Vec<Component> {
    let units = result.units;
    let links = model.mechanism.limbs.iter().enumerate();
    let links = links.flat_map(|(k, limb)| limb.links.iter().map(move |link| (k, link)));
    let mut all = Vec::new();
    for ((limb, link), found) in links.zip(&result.links) {
        let six = |d: &crate::files::summary::Deviation| {
            let ([a, b, c], [x, y, z]) = (d.rotation, d.translation);
            [a, b, c, x, y, z]
        };
        let (deviation, std) = found.own();
        let std = std.map(six);
        for (i, value) in six(deviation).into_iter().enumerate() {
            let shown = |v: f64| if i < 3 { units.from_radians(v) } else { units.from_metres(v) };
            all.push(Component {
                limb,
                name: [found.limb.clone(), found.link.clone(), COMPONENTS[i].into()],
                value,
                std: std.map(|std| std[i]),
                tolerance: tolerance(link, i).map(shown),
                angular: i < 3,
            });
        }
    }
    all
}

fn has_intervals(all: &[Component]) -> bool {
    all.iter().any(|c| c.std.is_some())
}

/// How the figures' captions begin.
fn in_tolerances(all: &[Component]) -> &'static str {
    if has_intervals(all) { "In tolerances, with 95 % intervals" } else { "In tolerances" }
}

fn point(x: f64, value: f64, std: Option<f64>) -> Point {
    let point = Point::new(x, value);
    std.map_or(point, |std| point.between(value - INTERVAL * std, value + INTERVAL * std))
}

/// The components farthest off, by name.
fn largest(all: &[Component]) -> Figure {
    let mut scaled: Vec<(&Component, f64, Option<f64>)> =
        all.iter().filter_map(|c| c.scaled().map(|(value, std)| (c, value, std))).collect();
    scaled.retain(|(_, value, _)| value.is_finite());
    scaled.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    scaled.truncate(NAMED);
    scaled.reverse();
    let names = scaled.iter().map(|(c, _, _)| c.label()).collect();
    let points = scaled.iter().enumerate().map(|(k, (_, value, std))| {
        let point = Point::new(*value, k as f64);
        std.map_or(point, |std| point.across(value - INTERVAL * std, value + INTERVAL * std))
    });
    let points = points.collect();
    Figure::new(
        "largest-deviations",
        "The components farthest off",
        Axis::linear("deviation / tolerance"),
        Axis::categories("", names),
    )
    .captioned(format!("{}; the broken lines are one tolerance.", in_tolerances(all)))
    .shaped(Shape::Rows(scaled.len()))
    .with(Series { name: String::new(), kind: Kind::Points, style: Style::numbered(0), points })
    .with_line(ReferenceLine::X(-1.0, String::new()))
    .with_line(ReferenceLine::X(1.0, String::new()))
    .with_line(ReferenceLine::X(0.0, String::new()))
}

/// All components with a tolerance, limb by limb.
fn overview(all: &[Component]) -> Figure {
    let mut figure = Figure::new(
        "deviations",
        "All components, link by link from base to tool",
        Axis::whole("component").spanning(0.0, all.len() as f64 + 1.0),
        Axis::linear("deviation / tolerance"),
    )
    .captioned(format!("{}. Held components and those without a tolerance are left out.", in_tolerances(all)))
    .shaped(Shape::Wide);
    let limbs = all.iter().map(|c| c.limb + 1).max().unwrap_or(0);
    for limb in 0..limbs {
        let own = all.iter().enumerate().filter(|(_, c)| c.limb == limb);
        let points =
            own.filter_map(|(k, c)| c.scaled().map(|(value, std)| point((k + 1) as f64, value, std)));
        let points: Vec<Point> = points.collect();
        let name = all.iter().find(|c| c.limb == limb).map_or(String::new(), |c| c.name[0].clone());
        figure = figure.with(Series { name, kind: Kind::Points, style: Style::numbered(limb), points });
    }
    figure.with_line(ReferenceLine::Y(1.0, String::new())).with_line(ReferenceLine::Y(-1.0, String::new()))
}

fn table(result: &ResultFile, all: &[Component]) -> Table {
    let heads = [
        "limb",
        "link",
        "component",
        "#deviation",
        "#standard error",
        "#tolerance",
        "unit",
        "#in tolerances",
        "#in standard errors",
    ];
    let mut table = Table::new("links", "All components.", &heads);
    let shown = |v: Option<f64>, digits: usize| v.map_or_else(Cell::none, |v| Cell::number(v, digits));
    for c in all {
        let [limb, link, component] = c.name.each_ref().map(Cell::text);
        let unit = if c.angular { result.units.angle_symbol() } else { result.units.length_symbol() };
        table.push(vec![
            limb,
            link,
            component,
            Cell::number(c.value, 4),
            shown(c.std, 3),
            shown(c.tolerance, 3),
            Cell::text(unit),
            shown(c.scaled().map(|s| s.0), 3),
            shown(c.std.filter(|std| *std > 0.0).map(|std| c.value / std), 3),
        ]);
    }
    table
}
