//! Figures as SVG, drawn by kuva.
//!
//! Extents and ticks are decided in [`super::axis`] and logarithms are taken here: kuva sees linear axes only, and
//! draws what it is given.

use super::axis::{Axis, Scale};
use super::figure::{Figure, Kind, ReferenceLine, Series, Shape};
use super::palette::Marker;
use super::text::escaped;
use kuva::plot::LegendEntry;
use kuva::plot::legend::{LegendPosition, LegendShape};
use kuva::plot::scatter::MarkerShape;
use kuva::prelude::{BandPlot, Layout, LinePlot, Plot, ScatterPlot, Theme, TickFormat};
use kuva::render::annotations::ReferenceLine as Across;
use std::sync::Arc;

/// Colour of grid lines: visible on white and on black, and in the way on neither.
const GRID: &str = "#80808055";
/// Colour of everything that is text or axis.
const INK: &str = "currentColor";
/// Markers on a step curve.
const MARKED: usize = 7;
/// Family of all text.
const FONT: &str = "system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif";

/// The figure as one SVG element; the same figure gives the same bytes.
pub fn svg(figure: &Figure) -> String {
    let seen: Vec<(&Series, Vec<Placed>)> =
        figure.series.iter().map(|series| (series, placed(figure, series))).collect();
    let across = |x: bool| {
        figure.lines.iter().filter_map(move |line| match line {
            ReferenceLine::X(value, _) if x => figure.x.place(*value),
            ReferenceLine::Y(value, _) if !x => figure.y.place(*value),
            _ => None,
        })
    };
    let bars = figure.series.iter().any(|s| matches!(s.kind, Kind::Bars { .. })) && !figure.y.log;
    let x = figure
        .x
        .scale(seen.iter().flat_map(|(s, p)| p.iter().flat_map(|p| p.xs(s.kind))).chain(across(true)));
    let y = figure.y.scale(
        seen.iter()
            .flat_map(|(_, p)| p.iter().flat_map(Placed::ys))
            .chain(across(false))
            .chain(bars.then_some(0.0)),
    );
    let mut plots = Vec::new();
    let base = if figure.y.log { y.first } else { 0.0 };
    for (series, points) in &seen {
        drawn(series, points, base, &mut plots);
    }
    if plots.is_empty() {
        // kuva draws no axes where there is nothing on them.
        let middle = (0.5 * (x.first + x.last), 0.5 * (y.first + y.last));
        plots.push(ScatterPlot::new().with_data([middle]).with_color("none").into());
    }
    let layout = layout(figure, x, y);
    finished(figure, &kuva::render_to_svg(plots, layout))
}

/// A point in places of the axes.
#[derive(Clone, Copy)]
struct Placed {
    x: f64,
    y: f64,
    across: Option<(f64, f64)>,
    between: Option<(f64, f64)>,
}

impl Placed {
    fn xs(&self, kind: Kind) -> impl Iterator<Item = f64> {
        let half = if let Kind::Bars { width } = kind { 0.5 * width } else { 0.0 };
        let (low, high) = self.across.unwrap_or((self.x - half, self.x + half));
        [low, high].into_iter()
    }

    fn ys(&self) -> impl Iterator<Item = f64> {
        let (low, high) = self.between.unwrap_or((self.y, self.y));
        [self.y, low, high].into_iter()
    }
}

fn placed(figure: &Figure, series: &Series) -> Vec<Placed> {
    let ends = |axis: &Axis, ends: Option<(f64, f64)>, middle: f64| {
        let (low, high) = ends?;
        // An interval that reaches zero has no lower end on a logarithmic axis: it starts at the point.
        Some((axis.place(low).unwrap_or(middle), axis.place(high).unwrap_or(middle)))
    };
    let points = series.points.iter().filter_map(|point| {
        let (x, y) = (figure.x.place(point.x)?, figure.y.place(point.y)?);
        let (across, between) = (ends(&figure.x, point.x_interval, x), ends(&figure.y, point.y_interval, y));
        Some(Placed { x, y, across, between })
    });
    points.collect()
}

fn drawn(series: &Series, points: &[Placed], base: f64, plots: &mut Vec<Plot>) {
    if points.is_empty() {
        return;
    }
    let colour = &series.style.colour;
    let xy = || points.iter().map(|p| (p.x, p.y));
    let line = || LinePlot::new().with_data(xy()).with_color(colour).with_stroke_width(1.8);
    match series.kind {
        Kind::Line => plots.push(line().into()),
        Kind::LinePoints => plots.extend([line().into(), markers(series, points, 3.5)]),
        Kind::Dashed => plots.push(line().with_stroke_width(1.3).with_dashed().into()),
        Kind::Points => plots.push(markers(series, points, 3.0)),
        Kind::Steps => plots.extend([line().with_step().into(), markers(series, &some(points), 3.0)]),
        Kind::Cells { size } => {
            let marks = ScatterPlot::new().with_data(xy()).with_color(colour).with_size(0.5 * size);
            plots.push(marks.with_marker(MarkerShape::Square).into());
        }
        Kind::Bars { width } => plots.extend(points.iter().map(|p| {
            let bar = BandPlot::new([p.x - 0.5 * width, p.x + 0.5 * width], [base, base], [p.y, p.y]);
            bar.with_color(colour).with_opacity(0.85).into()
        })),
        Kind::Band => {
            let ends = || points.iter().map(|p| p.between.unwrap_or((p.y, p.y)));
            let band = BandPlot::new(xy().map(|p| p.0), ends().map(|e| e.0), ends().map(|e| e.1));
            plots.push(band.with_color(colour).with_opacity(0.2).into());
        }
    }
}

/// Points spread over all, first and last among them: enough to tell curves of one colour apart.
fn some(points: &[Placed]) -> Vec<Placed> {
    let last = points.len().saturating_sub(1);
    let mut indices: Vec<usize> = (0..MARKED).map(|k| k * last / (MARKED - 1)).collect();
    indices.dedup();
    indices.into_iter().filter_map(|index| points.get(index).copied()).collect()
}

/// Markers, behind them the intervals that points have.
fn markers(series: &Series, points: &[Placed], size: f64) -> Plot {
    let spread = |value: f64, ends: Option<(f64, f64)>| {
        ends.map_or((0.0, 0.0), |(low, high)| ((value - low).max(0.0), (high - value).max(0.0)))
    };
    let mut plot = ScatterPlot::new()
        .with_data(points.iter().map(|p| (p.x, p.y)))
        .with_color(&series.style.colour)
        .with_marker(shape(series.style.marker))
        .with_size(size);
    if points.iter().any(|p| p.across.is_some()) {
        plot = plot.with_x_err_asymmetric(points.iter().map(|p| spread(p.x, p.across)));
    }
    if points.iter().any(|p| p.between.is_some()) {
        plot = plot.with_y_err_asymmetric(points.iter().map(|p| spread(p.y, p.between)));
    }
    plot.into()
}

fn shape(marker: Marker) -> MarkerShape {
    match marker {
        Marker::Circle => MarkerShape::Circle,
        Marker::Square => MarkerShape::Square,
        Marker::Triangle => MarkerShape::Triangle,
        Marker::Diamond => MarkerShape::Diamond,
        Marker::Cross => MarkerShape::Cross,
        Marker::Plus => MarkerShape::Plus,
        Marker::TriangleDown => MarkerShape::TriangleDown,
        Marker::Star => MarkerShape::Star,
        Marker::Pentagon => MarkerShape::Pentagon,
        Marker::Hexagon => MarkerShape::Hexagon,
    }
}

fn layout(figure: &Figure, x: Scale, y: Scale) -> Layout {
    let (width, height) = match figure.shape {
        Shape::Usual => (540.0, 350.0),
        Shape::Wide => (1100.0, 360.0),
        Shape::Square => (540.0, 520.0),
        Shape::Rows(rows) => (540.0, 110.0 + 17.0 * rows.max(1) as f64),
    };
    let theme = Theme {
        background: "none".into(),
        axis_color: INK.into(),
        grid_color: GRID.into(),
        tick_color: INK.into(),
        text_color: INK.into(),
        legend_bg: "none".into(),
        legend_border: "none".into(),
        font_family: Some(FONT.into()),
        ..Theme::light()
    };
    let entries: Vec<LegendEntry> = figure.series.iter().filter(|s| !s.name.is_empty()).map(entry).collect();
    // The legend takes its room from the height: some lines of about four names.
    let height = height + 13.0 * (entries.len() as f64 / 4.0).ceil();
    let mut layout = Layout::new((x.first, x.last), (y.first, y.last))
        .with_width(width)
        .with_height(height)
        .with_theme(theme)
        .with_font_family(FONT)
        .with_label_size(14)
        .with_tick_size(12)
        .with_body_size(12)
        .with_axis_line_width(1.0)
        .with_tick_width(1.0)
        .with_grid_line_width(0.7)
        .with_x_label(&figure.x.label)
        .with_y_label(&figure.y.label)
        .with_x_axis_min(x.first)
        .with_x_axis_max(x.last)
        .with_y_axis_min(y.first)
        .with_y_axis_max(y.last)
        .with_x_tick_step(x.step)
        .with_y_tick_step(y.step)
        .with_x_tick_format(ticks(&figure.x, x.step))
        .with_y_tick_format(ticks(&figure.y, y.step));
    layout.show_legend = !entries.is_empty();
    if layout.show_legend {
        layout = layout
            .with_legend_entries(entries)
            .with_legend_box(false)
            .with_legend_position(LegendPosition::OutsideBottomColumns);
    }
    for line in &figure.lines {
        let (across, label) = match line {
            ReferenceLine::X(value, label) => (figure.x.place(*value).map(Across::vertical), label),
            ReferenceLine::Y(value, label) => (figure.y.place(*value).map(Across::horizontal), label),
        };
        if let Some(across) = across {
            let across = across.with_color(INK).with_stroke_width(1.0);
            let across = if label.is_empty() { across } else { across.with_label(label) };
            layout = layout.with_reference_line(across);
        }
    }
    layout
}

fn entry(series: &Series) -> LegendEntry {
    let shape = match series.kind {
        Kind::Line | Kind::Dashed => LegendShape::Line,
        Kind::LinePoints | Kind::Points | Kind::Steps => LegendShape::Marker(shape(series.style.marker)),
        Kind::Bars { .. } | Kind::Cells { .. } | Kind::Band => LegendShape::Rect,
    };
    let dasharray = (series.kind == Kind::Dashed).then(|| "6 4".to_owned());
    LegendEntry { label: series.name.clone(), color: series.style.colour.clone(), shape, dasharray }
}

fn ticks(axis: &Axis, step: f64) -> TickFormat {
    let axis = axis.clone();
    TickFormat::Custom(Arc::new(move |place| axis.tick(place, step)))
}

/// The drawing with a size that follows the page, a name and a description for those who do not see it, and names of
/// its parts that no other figure has.
fn finished(figure: &Figure, drawn: &str) -> String {
    let (head, body) = drawn.split_once('>').unwrap_or((drawn, ""));
    let size = |key: &str| {
        let rest = head.split_once(&format!(" {key}=\""))?.1;
        rest.split_once('"').map(|(value, _)| value.to_owned())
    };
    let (width, height) = (size("width").unwrap_or_default(), size("height").unwrap_or_default());
    let family = escaped(FONT);
    let (id, title, caption) = (escaped(&figure.id), escaped(&figure.title), escaped(&figure.caption));
    // kuva numbers its clips through the life of the process.
    let mut parts = body.split("kuva-clip-");
    let mut text = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let rest = part.trim_start_matches(|c: char| c.is_ascii_digit());
        text.push_str(&format!("{id}-clip{rest}"));
    }
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"figure\" role=\"img\" aria-labelledby=\"{id}-title\" \
         width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" font-family=\"{family}\" \
         fill=\"{INK}\"><title id=\"{id}-title\">{title}</title><desc>{caption}</desc>{text}"
    )
}
