//! Line drawings of things in space, in isometric projection.

use super::text::escaped;

/// Width of a drawing, px.
const WIDTH: f64 = 820.0;
/// Greatest height, px.
const HEIGHT: f64 = 620.0;
/// Room around it for names, px.
const MARGIN: f64 = 46.0;
/// Least distance between base lines of names, px.
const LINE: f64 = 14.0;

/// Slack by which two names at that distance are clear of each other, px.
const ROUNDING: f64 = 0.01;

/// How a line looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stroke {
    /// What is drawn: grey.
    Nominal,
    /// What was found: in colour.
    Found,
    /// An axis of a joint.
    Axis,
    /// An axis of a frame: x, y or z.
    Frame(usize),
}

impl Stroke {
    fn attributes(self) -> &'static str {
        match self {
            Stroke::Nominal => "stroke=\"#808080\" stroke-width=\"4\" stroke-opacity=\"0.45\"",
            Stroke::Found => "stroke=\"#0072b2\" stroke-width=\"2\"",
            Stroke::Axis => "stroke=\"#d55e00\" stroke-width=\"1.2\" stroke-dasharray=\"5 2 1 2\"",
            Stroke::Frame(0) => "stroke=\"#cc3311\" stroke-width=\"2.4\"",
            Stroke::Frame(1) => "stroke=\"#228833\" stroke-width=\"2.4\"",
            Stroke::Frame(_) => "stroke=\"#4477aa\" stroke-width=\"2.4\"",
        }
    }
}

/// A drawing: lines and names in space, z upwards.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Drawing {
    /// Its name in addresses and files.
    pub id: String,
    /// What it shows.
    pub title: String,
    /// How to read it.
    pub caption: String,
    /// Lines through points, any unit of length.
    pub lines: Vec<(Stroke, Vec<[f64; 3]>)>,
    /// Points with a dot.
    pub dots: Vec<(Stroke, [f64; 3])>,
    /// Names beside points.
    pub names: Vec<(String, [f64; 3])>,
}

/// Isometric projection seen from (1, 1, 1), z upwards; right and down.
fn projected(p: &[f64; 3]) -> [f64; 2] {
    let half = 0.5;
    let side = 3.0_f64.sqrt() / 2.0;
    [(p[1] - p[0]) * side, (p[0] + p[1]) * half - p[2]]
}

impl Drawing {
    /// As one SVG element.
    pub fn svg(&self) -> String {
        let points = self.lines.iter().flat_map(|(_, points)| points);
        let points = points.chain(self.dots.iter().map(|(_, p)| p)).chain(self.names.iter().map(|(_, p)| p));
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for p in points.map(projected).filter(|p| p.iter().all(|v| v.is_finite())) {
            for i in 0..2 {
                (low[i], high[i]) = (low[i].min(p[i]), high[i].max(p[i]));
            }
        }
        if low[0] > high[0] {
            (low, high) = ([0.0; 2], [1.0; 2]);
        }
        let span = |i: usize| high[i] - low[i];
        let fits = [(WIDTH - 2.0 * MARGIN) / span(0), (HEIGHT - 2.0 * MARGIN) / span(1)];
        let scale = fits.into_iter().filter(|v| v.is_finite()).fold(f64::INFINITY, f64::min);
        let scale = if scale.is_finite() { scale } else { 1.0 };
        let height = span(1) * scale + 2.0 * MARGIN;
        let left = 0.5 * (WIDTH - span(0) * scale);
        let at = |p: &[f64; 3]| {
            let [x, y] = projected(p);
            [left + (x - low[0]) * scale, MARGIN + (y - low[1]) * scale]
        };
        let mut body = String::new();
        for (stroke, points) in &self.lines {
            let points = points.iter().map(at).filter(|p| p.iter().all(|v| v.is_finite()));
            let path: Vec<String> = points.map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
            body.push_str(&format!(
                "<polyline points=\"{}\" fill=\"none\" stroke-linecap=\"round\" stroke-linejoin=\"round\" {}/>\n",
                path.join(" "),
                stroke.attributes()
            ));
        }
        for (stroke, point) in &self.dots {
            let [x, y] = at(point);
            if x.is_finite() && y.is_finite() {
                let attributes = stroke.attributes();
                body.push_str(&format!(
                    "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\" fill=\"none\" {attributes}/>\n"
                ));
            }
        }
        body.push_str(&self.labels(at));
        let (id, title, caption) = (escaped(&self.id), escaped(&self.title), escaped(&self.caption));
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"figure\" role=\"img\" aria-labelledby=\"{id}-title\" \
             width=\"{WIDTH}\" height=\"{height:.0}\" viewBox=\"0 0 {WIDTH} {height:.0}\" font-size=\"12\" \
             font-family=\"system-ui, sans-serif\" fill=\"currentColor\"><title id=\"{id}-title\">{title}</title>\
             <desc>{caption}</desc>\n{body}</svg>"
        )
    }

    /// The names, each moved down until it is clear of those before it.
    fn labels(&self, at: impl Fn(&[f64; 3]) -> [f64; 2]) -> String {
        let mut taken: Vec<[f64; 3]> = Vec::new();
        let mut out = String::new();
        for (name, point) in &self.names {
            let [x, mut y] = at(point);
            if !x.is_finite() || !y.is_finite() {
                continue;
            }
            let width = 7.0 * name.chars().count() as f64;
            let left = (x + 7.0).min(WIDTH - width - 4.0);
            y -= 5.0;
            while let Some(other) = taken.iter().find(|other| {
                (other[1] - y).abs() < LINE - ROUNDING
                    && left < other[0] + other[2]
                    && other[0] < left + width
            }) {
                y = other[1] + LINE;
            }
            taken.push([left, y, width]);
            let name = escaped(name);
            out.push_str(&format!("<text x=\"{left:.1}\" y=\"{y:.1}\" class=\"name\">{name}</text>\n"));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The three axes stand 120 degrees apart and are equally long, z upwards.
    #[test]
    fn the_projection_is_isometric() {
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|p| projected(&p));
        assert_eq!(axes[2], [0.0, -1.0]);
        for (i, a) in axes.iter().enumerate() {
            assert!((a[0].hypot(a[1]) - 1.0).abs() < 1e-15);
            let b = axes[(i + 1) % 3];
            assert!((a[0] * b[0] + a[1] * b[1] + 0.5).abs() < 1e-15);
        }
    }

    /// Places whose distances round to less than a line.
    #[test]
    fn names_at_any_place_find_room() {
        let names =
            (0..200).map(|i| (format!("joint {i}"), [0.1 * f64::from(i % 7), 0.3, 1.0 / 3.0])).collect();
        let drawing = Drawing { names, ..Drawing::default() };
        assert_eq!(drawing.svg().matches("<text").count(), 200);
    }

    #[test]
    fn names_do_not_cover_each_other() {
        let names = (0..4).map(|i| (format!("joint {i}"), [0.0; 3])).collect();
        let drawing = Drawing { names, dots: vec![(Stroke::Found, [1.0, 0.0, 0.0])], ..Drawing::default() };
        let svg = drawing.svg();
        let mut heights: Vec<f64> = svg
            .match_indices("<text")
            .map(|(i, _)| svg[i..].split("y=\"").nth(1).unwrap().split('"').next().unwrap().parse().unwrap())
            .collect();
        heights.sort_by(f64::total_cmp);
        assert_eq!(heights.len(), 4);
        assert!(heights.windows(2).all(|pair| pair[1] - pair[0] >= LINE - 0.11));
    }
}
