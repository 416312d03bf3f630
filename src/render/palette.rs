//! Colours and markers.

/// Blue, vermilion, green, purple, orange, sky and grey: distinct to colour-blind readers, and on white as on black.
///
/// Okabe and Ito, "Color Universal Design" (2008), without yellow and black, which vanish on one of the two.
const COLOURS: [&str; 7] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#808080"];

/// From little to much: viridis without its darkest end.
const SEQUENTIAL: [&str; 7] = ["#46327e", "#365c8d", "#277f8e", "#1fa187", "#4ac16d", "#a0da39", "#fde725"];

/// From -1 to 1: blue, hardly anything, vermilion.
const DIVERGING: [&str; 7] = ["#0072b2", "#4a9bcb", "#93c0da", "#80808055", "#e0ad88", "#dc8444", "#d55e00"];

/// Shape of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Marker {
    /// ●
    Circle,
    /// ■
    Square,
    /// ▲
    Triangle,
    /// ◆
    Diamond,
    /// ×
    Cross,
    /// +
    Plus,
    /// ▼
    TriangleDown,
    /// ★
    Star,
    /// Five corners.
    Pentagon,
    /// Six corners.
    Hexagon,
}

const MARKERS: [Marker; 10] = [
    Marker::Circle,
    Marker::Square,
    Marker::Triangle,
    Marker::Diamond,
    Marker::Cross,
    Marker::Plus,
    Marker::TriangleDown,
    Marker::Star,
    Marker::Pentagon,
    Marker::Hexagon,
];

/// How a series looks.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Style {
    /// CSS colour.
    pub colour: String,
    /// Shape of its points.
    pub marker: Marker,
}

impl Style {
    /// Style number `index`: 70 differ in colour or marker, neighbours in both.
    pub fn numbered(index: usize) -> Self {
        let marker = MARKERS[index % MARKERS.len()];
        Self { colour: COLOURS[index % COLOURS.len()].into(), marker }
    }

    /// A filled square for class `index` of `count` from little to much.
    pub fn sequential(index: usize, count: usize) -> Self {
        Self::of_scale(&SEQUENTIAL, index, count)
    }

    /// A filled square for class `index` of `count` from most negative to most positive.
    pub fn diverging(index: usize, count: usize) -> Self {
        Self::of_scale(&DIVERGING, index, count)
    }

    fn of_scale(scale: &[&str; 7], index: usize, count: usize) -> Self {
        let at = match count {
            0 | 1 => 3,
            _ => (6 * index.min(count - 1) + (count - 1) / 2) / (count - 1),
        };
        Self { colour: scale[at].into(), marker: Marker::Square }
    }
}

/// Gives every name its style, the same in every figure.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Palette {
    names: Vec<String>,
}

impl Palette {
    /// A palette for these names, in this order: give all names that there are, not those of one figure.
    pub fn new(names: impl IntoIterator<Item = impl Into<String>>) -> Self {
        Self { names: names.into_iter().map(Into::into).collect() }
    }

    /// The style of `name`; a name that the palette was not given gets one that depends on its letters alone.
    pub fn style(&self, name: &str) -> Style {
        let listed = self.names.iter().position(|known| known == name);
        Style::numbered(listed.unwrap_or_else(|| {
            // FNV-1a
            let hash = name.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
                (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3)
            });
            (hash % 70) as usize
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn seventy_styles_differ_and_neighbours_differ_in_both() {
        let all: HashSet<Style> = (0..70).map(Style::numbered).collect();
        assert_eq!(all.len(), 70);
        for i in 0..70 {
            let (a, b) = (Style::numbered(i), Style::numbered(i + 1));
            assert!(a.colour != b.colour && a.marker != b.marker);
        }
    }

    #[test]
    fn a_name_keeps_its_style() {
        let palette = Palette::new(["minimal", "map"]);
        assert_eq!(palette.style("map"), Style::numbered(1));
        assert_eq!(palette.style("other"), Palette::default().style("other"));
    }

    #[test]
    fn scales_reach_both_ends() {
        assert_eq!(Style::sequential(0, 5).colour, SEQUENTIAL[0]);
        assert_eq!(Style::sequential(4, 5).colour, SEQUENTIAL[6]);
        assert_eq!(Style::diverging(3, 7).colour, DIVERGING[3]);
        assert_eq!(Style::diverging(0, 1).colour, DIVERGING[3]);
    }
}
