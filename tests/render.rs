//! Pages, figures and tables as bytes: well-formed, the same every time, whatever the data.

use gough::render::figure::{Figure, Kind, Point, ReferenceLine, Series, Shape};
use gough::render::{Axis, Cell, Drawing, Page, Palette, Part, Section, Style, Table, svg::svg};
use std::collections::HashSet;

const KINDS: [Kind; 8] = [
    Kind::Band,
    Kind::Bars { width: 0.8 },
    Kind::Cells { size: 12.0 },
    Kind::Line,
    Kind::LinePoints,
    Kind::Dashed,
    Kind::Points,
    Kind::Steps,
];

fn parsed(text: &str) -> roxmltree::Document<'_> {
    let options = roxmltree::ParsingOptions { allow_dtd: true, ..Default::default() };
    roxmltree::Document::parse_with_options(text, options).unwrap_or_else(|why| panic!("{why}\n{text}"))
}

/// All kinds on all axes, with values that have no place and text that must be escaped.
fn figure(id: &str, x: Axis, y: Axis, shape: Shape) -> Figure {
    let bad = [f64::NAN, f64::INFINITY, 0.0, -1.0, 1e300, 1e-300];
    let palette = Palette::new(["minimal", "map"]);
    let mut figure = Figure::new(id, "A < B & \"C\"", x, y).captioned("]]> <script>").shaped(shape);
    for (k, kind) in KINDS.into_iter().enumerate() {
        let mut points: Vec<Point> = (1..=5)
            .map(|i| {
                Point::new(f64::from(i), f64::from(i * i) + k as f64).between(0.0, 30.0).across(-1.0, 9.0)
            })
            .collect();
        points.extend(bad.map(|v| Point::new(v, f64::NAN)));
        let name = format!("series <{k}>");
        figure = figure.with(Series { style: palette.style(&name), name, kind, points });
    }
    figure
        .with_line(ReferenceLine::Y(3.0, "three & more".into()))
        .with_line(ReferenceLine::X(f64::NAN, "nowhere".into()))
}

fn figures() -> Vec<Figure> {
    let names = vec!["a".to_owned(), "b<".into(), "c".into()];
    vec![
        figure("linear", Axis::linear("x / mm"), Axis::linear("y / deg"), Shape::Usual),
        figure("log", Axis::log("x / mm"), Axis::log("y / deg"), Shape::Wide),
        figure("names", Axis::linear("x / mm"), Axis::categories("link", names), Shape::Rows(3)),
        figure("whole", Axis::whole("iteration"), Axis::linear("y").spanning(-1.0, 1.0), Shape::Square),
        Figure::new("empty", "Empty", Axis::log("x"), Axis::linear("y")).with(Series::new(
            "none",
            Kind::LinePoints,
            Style::numbered(0),
            &[],
        )),
    ]
}

#[test]
fn every_figure_is_well_formed_and_finite() {
    for figure in figures() {
        let text = svg(&figure);
        let document = parsed(&text);
        for node in document.descendants() {
            for attribute in node.attributes() {
                let value = attribute.value();
                let numbers = [
                    "x",
                    "y",
                    "x1",
                    "x2",
                    "y1",
                    "y2",
                    "cx",
                    "cy",
                    "r",
                    "d",
                    "points",
                    "width",
                    "height",
                    "transform",
                ];
                if numbers.contains(&attribute.name()) {
                    assert!(!value.contains("NaN") && !value.contains("inf"), "{}: {value}", figure.id);
                }
            }
        }
        let shown: Vec<&str> = document.descendants().filter_map(|node| node.text()).collect();
        for label in [&figure.x.label, &figure.y.label] {
            assert!(shown.iter().any(|text| text.trim() == *label), "{}: no axis {label}", figure.id);
        }
        for series in &figure.series {
            assert!(
                shown.iter().any(|text| text.trim() == series.name),
                "{}: no legend {}",
                figure.id,
                series.name
            );
        }
    }
}

#[test]
fn the_same_figure_gives_the_same_bytes_on_every_thread() {
    let once: Vec<String> = figures().iter().map(svg).collect();
    let threads: Vec<_> =
        (0..4).map(|_| std::thread::spawn(|| figures().iter().map(svg).collect::<Vec<_>>())).collect();
    for thread in threads {
        assert_eq!(thread.join().unwrap(), once);
    }
}

#[test]
fn a_page_is_one_well_formed_file_with_names_of_its_own() {
    let mut table = Table::new("t", "T", &["name", "#value"]);
    table.push(vec![Cell::text("<a>"), Cell::number(1.5, 3)]);
    table.push(vec![Cell::text("&b"), Cell::none()]);
    let mut section =
        Section::new("Figures & more").with(Part::Text("1 < 2".into())).with(Part::Table(table));
    section.parts.extend(figures().into_iter().map(Part::Figure));
    let drawing = Drawing {
        id: "drawing".into(),
        names: vec![("<tool>".into(), [0.0, 0.0, f64::NAN])],
        ..Drawing::default()
    };
    section.parts.push(Part::Drawing(drawing));
    let page =
        Page { title: "<title>".into(), intro: "a & b".into(), sections: vec![section], note: "note".into() };
    assert_eq!(page.figure_count(), figures().len() + 1);
    let text = page.html();
    assert_eq!(text, page.html());
    let document = parsed(&text);
    let mut names = HashSet::new();
    for node in document.descendants() {
        if let Some(id) = node.attribute("id") {
            assert!(names.insert(id.to_owned()), "{id} stands twice");
        }
        // Nothing is fetched from anywhere.
        for key in ["src", "href", "{http://www.w3.org/1999/xlink}href"] {
            let value = node.attribute(key).unwrap_or("#");
            assert!(value.starts_with('#') || value == "data:,", "{key}={value}");
        }
    }
    assert!(!text.contains("@import") && !text.contains("url(http"));
    let figures = document.descendants().filter(|node| node.attribute("class") == Some("figure")).count();
    assert_eq!(figures, page.figure_count());
    std::fs::write(std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("render.html"), text).unwrap();
}
