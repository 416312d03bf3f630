//! The side on which fixed points stand: distances from targets that lie almost in one plane fit a point and its mirror
//! image almost alike, and which of them is right shows only after the machine has been identified.

use super::references::Ranges;
use super::run::Identification;
use crate::calibration::{Calibration, Postures, Sample};
use crate::lie::Se3;
use crate::linalg;
use crate::measure::{Clue, Gauge, Point};
use crate::model::{Constant, Geometry, Mechanism, Prior};
use crate::problem::{Form, Problem};
use crate::solve::map::Map;
use crate::solve::{Identifier, Stop};
use nalgebra::{Matrix3, Vector3};

/// Most rounds of a decomposition: without a limit one of numbers that are not finite never ends.
const EIGEN_ROUNDS: usize = 1000;

/// Chi-square, deviations in tolerances included, by which one side must be better than the other to be called the right
/// one: odds of 20,000 to 1.
const DECIDED: f64 = 20.0;
/// Chi-square for whose gain points change sides: less is rounding.
const GAIN: f64 = 1e-2;
/// Least number of distances that place a point up to its side.
const LEAST: usize = 3;
/// Most points all of whose combinations of sides are tried; of more, one after the other and all together.
const MOST: usize = 5;
/// Square of a distance from the stated position, in its tolerances, that no reading makes good.
const RULED_OUT: f64 = 400.0;
/// Rounds in which points change sides.
const ROUNDS: usize = 3;
/// Part of its distance from the mirror image within which a point that falls back to where it was has only one side.
const FALLEN_BACK: f64 = 0.1;

/// A fixed point whose side the readings do not tell.
#[derive(Clone, Debug, PartialEq)]
pub struct UndecidedSide {
    /// The point, such as `point bar1`.
    pub point: String,
    /// Where it stands in the result, m in {S}.
    pub here: Vector3<f64>,
    /// Where it may stand as well.
    pub there: Vector3<f64>,
    /// By how much chi-square is larger there, deviations in tolerances included.
    pub difference: f64,
}

/// What was found of the sides of fixed points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sides {
    /// Points that stand on the other side of their readings' plane than registration had put them.
    pub changed: Vec<String>,
    /// Points of which it is not known.
    pub undecided: Vec<UndecidedSide>,
}

/// A start: the machine about which deviations are stated, and deviations (rad, m).
pub(super) type Start = (Mechanism, Vec<f64>);

/// An unknown fixed point with its distances.
struct Ranged {
    /// Index of the first of its constants.
    constant: usize,
    /// Its samples.
    samples: Vec<usize>,
}

/// A machine that explains the readings, with the points on certain sides.
#[derive(Clone)]
struct Explained {
    start: Start,
    /// `|r|^2 + |x|^2`, `x` in tolerances: minus twice the logarithm of its probability, up to a constant.
    energy: f64,
}

/// Whether the machine's instrument has fixed points that are not known.
pub(super) fn has_points(mechanism: &Mechanism) -> bool {
    mechanism.instrument.iter().any(|constant| constant.element.starts_with("point "))
}

/// Tries the mirror images of the fixed points with the identified machine: the start on the better sides, if these are
/// others, and what is known of the sides.
///
/// Each combination of sides is judged by its own maximum-a-posteriori estimate. A point whose own distances alone speak
/// against its mirror image takes no part in them, since other readings can only add to what they say.
pub(super) fn sides(found: &Identification, samples: &[Sample], stop: &Stop) -> (Option<Start>, Sides) {
    let taking = found.taking_part(samples);
    let points = ranged(&found.start, &taking);
    let mut known = Sides::default();
    // A run that did not converge has no machine to begin with: the drawing is nearer to the true one.
    let at = match found.report.outcome.converged() {
        true => found.geometry.deviations_from(&found.start.nominal()),
        false => vec![0.0; found.start.component_count()],
    };
    let from = (found.start.clone(), at);
    if points.iter().all(|point| other_side(&from, point, &taking).is_none()) {
        return (None, known);
    }
    let Some(first) = explained(&from, &taking, stop) else { return (None, known) };
    let mut best = first;
    for round in 0..=ROUNDS {
        let tolerated = DECIDED * disagreement(&best, &taking);
        let others = alternatives(&best, &points, &taking, tolerated, stop);
        let better = others.iter().filter(|(_, o)| round < ROUNDS && o.energy < best.energy - GAIN);
        let Some((changed, other)) = better.min_by(|a, b| a.1.energy.total_cmp(&b.1.energy)) else {
            known.undecided = undecided(&best, &others, &points);
            break;
        };
        for &k in changed {
            let name = element(&found.start, &points[k]);
            match known.changed.iter().position(|known| *known == name) {
                Some(back) => drop(known.changed.remove(back)),
                None => known.changed.push(name),
            }
        }
        best = other.clone();
    }
    ((!known.changed.is_empty()).then_some(best.start), known)
}

/// Points with enough distances, each with its samples.
fn ranged(mechanism: &Mechanism, samples: &[Sample]) -> Vec<Ranged> {
    let mut points: Vec<Ranged> = Vec::new();
    for (i, sample) in samples.iter().enumerate() {
        let Clue::Range { point, .. } = sample.measurement.clue() else { continue };
        let Some(constant) = point.constants else { continue };
        match points.iter_mut().find(|known| known.constant == constant) {
            Some(known) => known.samples.push(i),
            None => points.push(Ranged { constant, samples: vec![i] }),
        }
    }
    let known = |p: &Ranged| p.samples.len() >= LEAST && mechanism.instrument.len() >= p.constant + 3;
    points.into_iter().filter(known).collect()
}

fn element(mechanism: &Mechanism, point: &Ranged) -> String {
    mechanism.instrument[point.constant].element.clone()
}

fn place(geometry: &Geometry, point: &Ranged) -> Vector3<f64> {
    Vector3::from_column_slice(&geometry.instrument[point.constant..point.constant + 3])
}

/// The maximum-a-posteriori estimate from a start; `None` where it fails or a sample does not close.
fn explained(start: &Start, samples: &[Sample], stop: &Stop) -> Option<Explained> {
    let problem = Calibration::new(&start.0, samples, Form::Minimal, &start.1);
    if problem.sample_count() < samples.len() {
        return None;
    }
    let report = Map::default().identify(&problem, &problem.coordinates().nearest(&start.1), stop);
    let energy = 2.0 * report.cost + linalg::dot(&report.x, &report.x);
    let at = problem.coordinates().deviations(&report.x);
    energy.is_finite().then(|| Explained { start: (start.0.clone(), at), energy })
}

/// By how much the residual is larger than the noise, at least 1: understated noise makes differences of chi-square larger
/// than they are.
fn disagreement(best: &Explained, samples: &[Sample]) -> f64 {
    let problem = Calibration::new(&best.start.0, samples, Form::Minimal, &best.start.1);
    let rows = problem.rows() as f64;
    let Ok(here) = problem.compress(&problem.coordinates().nearest(&best.start.1)) else { return 1.0 };
    let seen = linalg::singular_values(here.jac.as_ref()).unwrap_or_default();
    let fitted: f64 = seen.iter().map(|s| s * s / (1.0 + s * s)).sum();
    (2.0 * here.cost / (rows - fitted).max(1.0)).max(1.0)
}

/// Combinations of points on their other sides, each with what explains it, as far as they are not worse by more than
/// `tolerated`.
fn alternatives(
    best: &Explained,
    points: &[Ranged],
    samples: &[Sample],
    tolerated: f64,
    stop: &Stop,
) -> Vec<(Vec<usize>, Explained)> {
    let limit = best.energy + tolerated;
    let mirrored: Vec<Option<Vector3<f64>>> =
        points.iter().map(|point| other_side(&best.start, point, samples)).collect();
    let with = |changed: &[usize]| {
        let mut start = best.start.clone();
        for &k in changed {
            if let Some(there) = &mirrored[k] {
                moved(&mut start, points[k].constant, there);
            }
        }
        start
    };
    let own = |k: usize| -> Vec<Sample> { points[k].samples.iter().map(|&i| samples[i].clone()).collect() };
    let open: Vec<usize> = (0..points.len())
        .filter(|&k| mirrored[k].is_some())
        .filter(|&k| explained(&with(&[k]), &own(k), stop).is_some_and(|alone| alone.energy <= limit))
        .collect();
    let combinations: Vec<Vec<usize>> = match open.len() {
        0..=MOST => (1..1usize << open.len())
            .map(|set| (0..open.len()).filter(|i| set >> i & 1 == 1).map(|i| open[i]).collect())
            .collect(),
        _ => open.iter().map(|&k| vec![k]).chain([open.clone()]).collect(),
    };
    let tried = combinations.into_iter().filter_map(|changed| {
        let other = explained(&with(&changed), samples, stop)?;
        Some((changed, other))
    });
    tried.filter(|(_, other)| other.energy <= limit).collect()
}

/// The constants of a point moved to `there`: those that stand free begin there, the others deviate.
fn moved((mechanism, at): &mut Start, first: usize, there: &Vector3<f64>) {
    let links = mechanism.link_component_count();
    for (i, value) in there.iter().enumerate() {
        let constant = &mut mechanism.instrument[first + i];
        if constant.prior == Prior::Free {
            constant.nominal = *value;
        }
        at[links + first + i] = value - constant.nominal;
    }
}

/// Where a point's own distances put it on the other side of the plane in which its targets lie, the machine held; `None`
/// where there is no other side, or one that its tolerance rules out.
fn other_side((mechanism, at): &Start, point: &Ranged, samples: &[Sample]) -> Option<Vector3<f64>> {
    let geometry = mechanism.deviated(at);
    let mut postures = Postures::new(mechanism);
    let mut seen: Vec<(Vector3<f64>, f64)> = Vec::with_capacity(point.samples.len());
    for &i in &point.samples {
        samples[i].close_all(mechanism, &geometry, &mut postures).ok()?;
        let tool = postures.view(&samples[i], &geometry).tool;
        if let Clue::Range { target, gauge, reading, .. } = samples[i].measurement.clue() {
            seen.push((on_tool(&tool, &target, &geometry), distance(&gauge, &geometry, reading)));
        }
    }
    let count = seen.len() as f64;
    let centre = seen.iter().map(|(p, _)| p).sum::<Vector3<f64>>() / count;
    let spread: Matrix3<f64> = seen.iter().map(|(p, _)| (p - centre) * (p - centre).transpose()).sum();
    let eigen = spread.try_symmetric_eigen(f64::EPSILON, EIGEN_ROUNDS)?;
    let normal: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    let here = place(&geometry, point);
    let image = here - 2.0 * normal * normal.dot(&(here - centre));
    let (_, there, _) = Ranges { seen: &seen, with_zero: false }.settled(image, 0.0);
    let apart = (there - here).norm();
    let off = |(i, value): (usize, &f64)| match mechanism.instrument[point.constant + i] {
        Constant { prior: Prior::Sigma(sigma), nominal, .. } => ((value - nominal) / sigma).powi(2),
        _ => 0.0,
    };
    let ruled_out = there.iter().enumerate().map(off).sum::<f64>() > RULED_OUT;
    (apart > FALLEN_BACK * (image - here).norm() && apart.is_finite() && !ruled_out).then_some(there)
}

fn on_tool(tool: &Se3, target: &Point, geometry: &Geometry) -> Vector3<f64> {
    tool.p + tool.r * target.at(&geometry.instrument)
}

fn distance(gauge: &Gauge, geometry: &Geometry, reading: f64) -> f64 {
    let (zero, scale) = gauge.at(&geometry.instrument);
    (reading - zero) / scale
}

/// Points that stand elsewhere in an alternative, at their least difference.
fn undecided(best: &Explained, others: &[(Vec<usize>, Explained)], points: &[Ranged]) -> Vec<UndecidedSide> {
    let at =
        |explained: &Explained, k: usize| place(&explained.start.0.deviated(&explained.start.1), &points[k]);
    let mut undecided = Vec::new();
    for (k, point) in points.iter().enumerate() {
        let with_it = others.iter().filter(|(changed, _)| changed.contains(&k));
        let Some((_, other)) = with_it.min_by(|a, b| a.1.energy.total_cmp(&b.1.energy)) else { continue };
        let (here, there) = (at(best, k), at(other, k));
        // Both ended in one place: there is no other side.
        if (there - here).norm() > 1e-6 * best.start.0.characteristic_length() {
            undecided.push(UndecidedSide {
                point: element(&best.start.0, point),
                here,
                there,
                difference: other.energy - best.energy,
            });
        }
    }
    undecided
}
