//! What measurements do not tell of where base and tool stand, in words.

use nalgebra::{DMatrix, Vector3};

/// Part of a direction that lies in what is named for it, at least.
const MOSTLY: f64 = 0.6;
const ITERATIONS: usize = 200;
/// Entry of a unit vector that is shown as zero.
const ZERO: f64 = 0.005;

/// What a direction moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// How the tool is turned, axes in the tool's frame as drawn.
    ToolTurn,
    /// Where the tool point is, axes in the tool's frame as drawn.
    ToolOffset,
    /// How the base is turned, axes in {S}.
    BaseTurn,
    /// Where the base is, axes in {S}.
    BasePlace,
}

/// Directions of one part that measurements do not tell.
#[derive(Clone, Debug, PartialEq)]
pub struct Untold {
    /// What they move.
    pub part: Part,
    /// Unit vectors, square to each other.
    pub along: Vec<Vector3<f64>>,
}

impl Untold {
    /// By `parts`, of directions a column each, three rows a part.
    pub(super) fn named(directions: &DMatrix<f64>, parts: &[Part]) -> Vec<Self> {
        if directions.ncols() == 0 {
            return Vec::new();
        }
        let mut found = Vec::new();
        for (k, &part) in parts.iter().enumerate() {
            let block = directions.rows(3 * k, 3).into_owned();
            let Some(svd) = block.try_svd(true, false, f64::EPSILON, ITERATIONS) else { continue };
            let Some(u) = svd.u else { continue };
            let along = (0..svd.singular_values.len()).filter(|i| svd.singular_values[*i] > MOSTLY);
            let along: Vec<Vector3<f64>> =
                along.map(|i| Vector3::new(u[(0, i)], u[(1, i)], u[(2, i)])).collect();
            if !along.is_empty() {
                found.push(Self { part, along });
            }
        }
        found
    }

    /// What is not told, such as `the tool's offset along [0, 0, 1] of {T}`.
    pub fn words(&self) -> String {
        let frame = match self.part {
            Part::ToolTurn | Part::ToolOffset => "{T}",
            Part::BaseTurn | Part::BasePlace => "{S}",
        };
        let (what, one) = match self.part {
            Part::ToolTurn => ("how the tool is turned", "about"),
            Part::ToolOffset => ("the tool's offset", "along"),
            Part::BaseTurn => ("how the base is turned", "about"),
            Part::BasePlace => ("where the base stands", "along"),
        };
        match self.along.as_slice() {
            [a] => format!("{what} {one} {} of {frame}", shown(a)),
            [a, b] => format!("{what} {one} any direction square to {} of {frame}", shown(&a.cross(b))),
            _ => what.to_owned(),
        }
    }
}

/// What registration kept as drawn, in a sentence; `None` where the measurements tell everything.
pub fn untold_words(untold: &[Untold]) -> Option<String> {
    let words: Vec<String> = untold.iter().map(Untold::words).collect();
    (!words.is_empty()).then(|| {
        format!(
            "free base and tool: the readings do not tell {}; kept as drawn, it holds only where was measured",
            words.join(", and ")
        )
    })
}

/// A unit vector, its largest entry positive.
fn shown(a: &Vector3<f64>) -> String {
    let sign = a[a.iamax()].signum();
    let entry = |v: f64| if v.abs() < ZERO { "0".to_owned() } else { format!("{:.2}", sign * v) };
    let whole = |text: String| text.strip_suffix(".00").map_or(text.clone(), str::to_owned);
    format!("[{}, {}, {}]", whole(entry(a.x)), whole(entry(a.y)), whole(entry(a.z)))
}
