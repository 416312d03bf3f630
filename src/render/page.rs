//! A page: one HTML file that needs nothing else.

use super::drawing::Drawing;
use super::figure::{Figure, Shape};
use super::svg::svg;
use super::table::Table;
use super::text::{escaped, slug};

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");
/// The browser itself refuses whatever is not in the file.
const POLICY: &str =
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:";

/// What a section holds.
#[derive(Clone, Debug, PartialEq)]
pub enum Part {
    /// A paragraph.
    Text(String),
    /// A figure.
    Figure(Figure),
    /// A drawing.
    Drawing(Drawing),
    /// A table.
    Table(Table),
}

/// A part of a page with a head.
#[derive(Clone, Debug, PartialEq)]
pub struct Section {
    /// Its head.
    pub title: String,
    /// What it holds.
    pub parts: Vec<Part>,
}

/// A page.
#[derive(Clone, Debug, PartialEq)]
pub struct Page {
    /// Its title.
    pub title: String,
    /// What it is about, in a paragraph.
    pub intro: String,
    /// Sections.
    pub sections: Vec<Section>,
    /// Last line: what made it.
    pub note: String,
}

impl Page {
    /// Number of figures and drawings.
    pub fn figure_count(&self) -> usize {
        let parts = self.sections.iter().flat_map(|section| &section.parts);
        parts.filter(|part| matches!(part, Part::Figure(_) | Part::Drawing(_))).count()
    }

    /// The page as one HTML file: no network, light and dark, for desk, phone and paper. When it is ready, the root
    /// element says so (`data-ready`), how many of its figures have a size (`data-figures`), how many errors its script
    /// met (`data-errors`), how far it is wider than the window (`data-overflow`, px), how wide that is (`data-width`)
    /// and which colours it has (`data-scheme`).
    pub fn html(&self) -> String {
        let title = escaped(&self.title);
        let mut body = format!("<h1>{title}</h1>\n<p class=\"intro\">{}</p>\n", escaped(&self.intro));
        if self.sections.len() > 2 {
            body.push_str("<nav aria-label=\"Sections\"><ul>");
            for section in &self.sections {
                body.push_str(&format!(
                    "<li><a href=\"#{}\">{}</a></li>",
                    slug(&section.title),
                    escaped(&section.title)
                ));
            }
            body.push_str("</ul></nav>\n");
        }
        for section in &self.sections {
            body.push_str(&section.html());
        }
        body.push_str(&format!("<footer>{}</footer>\n", escaped(&self.note)));
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"/>\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
             <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\"/>\n\
             <meta name=\"color-scheme\" content=\"light dark\"/>\n<title>{title}</title>\n\
             <link rel=\"icon\" href=\"data:,\"/>\n<style>\n{STYLE}</style>\n</head><body><main>\n{body}</main>\n\
             <script>\n{SCRIPT}</script>\n</body></html>\n"
        )
    }
}

impl Section {
    /// An empty section.
    pub fn new(title: impl Into<String>) -> Self {
        Self { title: title.into(), parts: Vec::new() }
    }

    /// The same section with one more part.
    pub fn with(mut self, part: Part) -> Self {
        self.parts.push(part);
        self
    }

    fn html(&self) -> String {
        let mut out = format!("<section id=\"{}\"><h2>{}</h2>\n", slug(&self.title), escaped(&self.title));
        // Figures that follow one another share a grid.
        let mut in_grid = false;
        for part in &self.parts {
            let figure = matches!(part, Part::Figure(_) | Part::Drawing(_));
            if figure != in_grid {
                out.push_str(if figure { "<div class=\"grid\">\n" } else { "</div>\n" });
                in_grid = figure;
            }
            out.push_str(&part.html());
        }
        if in_grid {
            out.push_str("</div>\n");
        }
        out.push_str("</section>\n");
        out
    }
}

impl Part {
    fn html(&self) -> String {
        match self {
            Part::Text(text) => format!("<p>{}</p>\n", escaped(text)),
            Part::Table(table) => table.html(),
            Part::Figure(figure) => {
                let wide = figure.shape == Shape::Wide;
                framed(&figure.id, &figure.title, &figure.caption, &svg(figure), wide)
            }
            Part::Drawing(of) => framed(&of.id, &of.title, &of.caption, &of.svg(), true),
        }
    }
}

fn framed(id: &str, title: &str, caption: &str, svg: &str, wide: bool) -> String {
    let class = if wide { " class=\"wide\"" } else { "" };
    let (id, title, caption) = (escaped(id), escaped(title), escaped(caption));
    format!(
        "<figure id=\"{id}\"{class}><div class=\"scroll\">{svg}</div>\
         <figcaption><b>{title}.</b> {caption}</figcaption></figure>\n"
    )
}
