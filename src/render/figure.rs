//! Figures as plain data.

use super::axis::Axis;
use super::palette::Style;
use crate::cells::field;

/// A point of a series, in units of the axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Point {
    /// Along the first axis.
    pub x: f64,
    /// Along the second axis.
    pub y: f64,
    /// Ends of an interval along the first axis.
    pub x_interval: Option<(f64, f64)>,
    /// Ends of an interval along the second axis.
    pub y_interval: Option<(f64, f64)>,
}

impl Point {
    /// A point without intervals.
    pub fn new(x: f64, y: f64) -> Self {
        Self { x, y, ..Self::default() }
    }

    /// The same point with an interval along the first axis.
    pub fn across(mut self, low: f64, high: f64) -> Self {
        self.x_interval = Some((low, high));
        self
    }

    /// The same point with an interval along the second axis.
    pub fn between(mut self, low: f64, high: f64) -> Self {
        self.y_interval = Some((low, high));
        self
    }
}

/// How the points of a series are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// Joined by straight lines.
    Line,
    /// Joined by straight lines, each with its marker.
    LinePoints,
    /// A broken line, for what is expected rather than measured.
    Dashed,
    /// Markers, with the intervals that points have.
    Points,
    /// A staircase that keeps each value until the next point, with some markers along it.
    Steps,
    /// Bars from zero (from the lower edge on a logarithmic axis) of this width along the first axis.
    Bars {
        /// Width, in units of the first axis; in decades where that is logarithmic.
        width: f64,
    },
    /// Filled squares of this size, for maps.
    Cells {
        /// Edge, px.
        size: f64,
    },
    /// An area between the ends of the points' intervals along the second axis.
    Band,
}

/// Points that belong together.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Its name in the legend; a series with an empty name is not in the legend.
    pub name: String,
    /// How it is drawn.
    pub kind: Kind,
    /// Colour and marker.
    pub style: Style,
    /// The points. Those without a place on the axes (not finite, or not positive on a logarithmic axis) are left out.
    pub points: Vec<Point>,
}

impl Series {
    /// A series of points without intervals.
    pub fn new(name: impl Into<String>, kind: Kind, style: Style, points: &[(f64, f64)]) -> Self {
        let points = points.iter().map(|(x, y)| Point::new(*x, *y)).collect();
        Self { name: name.into(), kind, style, points }
    }
}

/// A line across the figure.
#[derive(Clone, Debug, PartialEq)]
pub enum ReferenceLine {
    /// At a value of the first axis.
    X(f64, String),
    /// At a value of the second axis.
    Y(f64, String),
}

/// Outline of a figure.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Shape {
    /// Two stand side by side on a desk.
    #[default]
    Usual,
    /// The whole width of a page.
    Wide,
    /// Both axes equally long, as for maps.
    Square,
    /// As high as it must be for this many rows of names along the second axis.
    Rows(usize),
}

/// A figure.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Its name in addresses and files: lower-case letters, digits and hyphens, unique on a page.
    pub id: String,
    /// What it shows, in a few words.
    pub title: String,
    /// How to read it, in a sentence or two.
    pub caption: String,
    /// First axis.
    pub x: Axis,
    /// Second axis.
    pub y: Axis,
    /// What is drawn, from back to front.
    pub series: Vec<Series>,
    /// Lines across.
    pub lines: Vec<ReferenceLine>,
    /// Outline.
    pub shape: Shape,
}

impl Figure {
    /// An empty figure.
    pub fn new(id: impl Into<String>, title: impl Into<String>, x: Axis, y: Axis) -> Self {
        Self {
            id: id.into(),
            title: title.into(),
            caption: String::new(),
            x,
            y,
            series: Vec::new(),
            lines: Vec::new(),
            shape: Shape::Usual,
        }
    }

    /// The same figure with this caption.
    pub fn captioned(mut self, caption: impl Into<String>) -> Self {
        self.caption = caption.into();
        self
    }

    /// The same figure with one more series.
    pub fn with(mut self, series: Series) -> Self {
        self.series.push(series);
        self
    }

    /// The same figure with one more line across.
    pub fn with_line(mut self, line: ReferenceLine) -> Self {
        self.lines.push(line);
        self
    }

    /// The points of all series as CSV, with the ends of their intervals.
    pub fn csv(&self) -> String {
        let mut out = "series,x,y,x_low,x_high,y_low,y_high\n".to_owned();
        for series in &self.series {
            for point in &series.points {
                let ends = |interval: Option<(f64, f64)>| match interval {
                    Some((low, high)) => format!("{low:?},{high:?}"),
                    None => ",".into(),
                };
                let (name, x, y) = (field(&series.name), point.x, point.y);
                let (across, up) = (ends(point.x_interval), ends(point.y_interval));
                out.push_str(&format!("{name},{x:?},{y:?},{across},{up}\n"));
            }
        }
        out
    }

    /// The same figure with this outline.
    pub fn shaped(mut self, shape: Shape) -> Self {
        self.shape = shape;
        self
    }
}
