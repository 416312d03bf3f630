//! What the samples of a posture have in common, estimated from them (docs/theory.md (10.20)).

use super::copies::copies;
use super::noise::NoiseEstimate;
use super::run::{Identification, IdentifyError};
use crate::calibration::{ByPosture, Calibration, Sample};
use crate::linalg::{self, RowStream};
use crate::measure::{OfPosture, PostureNoise};
use crate::problem::{EvalError, Form, Problem};
use faer::Mat;
use nalgebra::{Matrix6, Vector6};
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Probability with which samples are said to have something in common where they have nothing.
pub const FALSE_ALARM: f64 = 0.005;
/// Most postures that the estimate is made from; it costs a factorisation for each value tried.
const MOST: usize = 400;
/// Fewest samples beside the first of their postures.
pub(super) const FEWEST: usize = 6;
/// Singular value above which the residual says nothing of a direction: the machine has taken it up.
const TAKEN_UP: f64 = 0.3;
/// Rounds of estimate and identification, and the relative change at which they agree.
const ROUNDS: usize = 8;
const AGREED: f64 = 0.02;
/// Values tried, in parts of what one reading tells of a twist, before the best is refined.
const GRID: [f64; 9] = [0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 8.0, 25.0, 100.0];
/// Sizes of the readings' own noise that are tried, in parts of a guess, before the best is refined.
const OWN: [f64; 9] = [0.1, 0.4, 0.7, 0.9, 1.0, 1.1, 1.4, 2.5, 10.0];
/// Steps of the refinement, each to 0.62 of the interval.
const REFINED: usize = 9;

/// An estimate of what the samples of a posture have in common.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PostureNoiseEstimate {
    /// Its size.
    pub noise: PostureNoise,
    /// Probability that samples without anything in common look as if they had it.
    pub probability: f64,
    /// Standard deviation of what is each reading's own, in units of what it was taken for.
    pub own: f64,
}

/// The samples, whose postures have this in common.
pub fn sharing(samples: &[Sample], noise: PostureNoise) -> Vec<Sample> {
    let of = |s: &Sample| Sample { measurement: OfPosture::by(s.measurement.clone(), noise), ..s.clone() };
    samples.iter().map(of).collect()
}

/// Whether there is anything to estimate it from: several samples in some postures, none of them copies, and no statement
/// of it.
pub fn is_asked(samples: &[Sample]) -> bool {
    let postures = ByPosture::of(samples);
    copies(samples) == 0
        && postures.sample_count() - postures.count() >= FEWEST
        && samples.iter().all(|s| s.measurement.posture_noise().is_none() && s.measurement.second().is_none())
}

/// What [`identify_sharing`] found.
pub type Shared = (Identification, Option<NoiseEstimate>, Option<PostureNoiseEstimate>);

/// Identifies, estimates what the samples of a posture have in common, and identifies again under it until both agree.
/// `identified` identifies from the samples that it is given, and says by which noise where it had to estimate it.
pub fn identify_sharing(
    samples: &[Sample],
    identified: impl Fn(&[Sample]) -> Result<(Identification, Option<NoiseEstimate>), IdentifyError>,
) -> Result<Shared, IdentifyError> {
    let (mut found, mut noise) = identified(samples)?;
    if !is_asked(samples) {
        return Ok((found, noise, None));
    }
    let mut last: Option<PostureNoiseEstimate> = None;
    for _ in 0..ROUNDS {
        let weighed = noise.map_or_else(|| samples.to_vec(), |noise| noise.weigh(samples));
        let next = estimate(&found, &weighed);
        match (last, next) {
            (None, None) => break,
            // What was seen in the residual of a machine that had bent to it is not seen any more.
            (Some(_), None) => {
                (found, noise) = identified(samples)?;
                return Ok((found, noise, None));
            }
            (Some(last), Some(next)) if agree(last.noise, next.noise) => break,
            (_, Some(next)) => {
                (found, noise) = identified(&sharing(samples, next.noise))?;
                last = Some(next);
            }
        }
    }
    Ok((found, noise, last))
}

fn agree(a: PostureNoise, b: PostureNoise) -> bool {
    let near = |a: f64, b: f64| (a - b).abs() <= AGREED * a.max(b);
    near(a.angle, b.angle) && near(a.length, b.length)
}

/// Estimates from the residual of an identification; `None` where the samples show nothing in common that chance does
/// not.
pub fn estimate(found: &Identification, samples: &[Sample]) -> Option<PostureNoiseEstimate> {
    let rows = Rows::of(found, samples).ok()??;
    let none = rows.deviance([0.0; 2])?;
    let single = |k: usize| {
        let at = |v: f64| rows.deviance(if k == 0 { [v, 0.0] } else { [0.0, v] });
        let found = least(&at, &GRID).filter(|_| rows.unit[k] > 0.0);
        found.map_or(([0.0; 2], none), |(value, deviance)| {
            (if k == 0 { [value, 0.0] } else { [0.0, value] }, deviance)
        })
    };
    let (by_angle, by_length) = (single(0), single(1));
    // Lengths explain rotations of far targets and the other way round: lengths where it makes no difference.
    let simple = if by_angle.1 < by_length.1 - 2.0 { by_angle } else { by_length };
    let one = ChiSquared::new(1.0).ok()?;
    // Of a variance that is zero by hypothesis half of the estimates are zero (Self & Liang, J. American Statistical
    // Association 82, 1987); two were tried.
    let probability = one.sf((none - simple.1).max(0.0));
    if probability > FALSE_ALARM {
        return None;
    }
    let mut best = simple;
    for k in [0, 1, 0, 1] {
        let at = |v: f64| {
            let mut point = best.0;
            point[k] = v;
            rows.deviance(point)
        };
        if let Some((value, deviance)) = least(&at, &GRID)
            && deviance < best.1
        {
            best.0[k] = value;
            best.1 = deviance;
        }
    }
    let worth_it = 0.5 * one.sf((simple.1 - best.1).max(0.0)) <= FALSE_ALARM;
    let chosen = if worth_it { best.0 } else { simple.0 };
    let noise = PostureNoise { angle: chosen[0] * rows.unit[0], length: chosen[1] * rows.unit[1] };
    Some(PostureNoiseEstimate { noise, probability, own: rows.own(chosen)? })
}

/// Least of a function of one positive number: on a grid, then by golden sections of its logarithm.
pub(super) fn least(at: &dyn Fn(f64) -> Option<f64>, grid: &[f64]) -> Option<(f64, f64)> {
    let tried: Vec<f64> = grid.iter().map(|v| at(*v)).collect::<Option<_>>()?;
    let best = (0..grid.len()).min_by(|a, b| tried[*a].total_cmp(&tried[*b]))?;
    let (mut low, mut high) = (grid[best.saturating_sub(1)].ln(), grid[(best + 1).min(grid.len() - 1)].ln());
    const GOLDEN: f64 = 0.618_033_988_749_895;
    let inner = |low: f64, high: f64| (high - GOLDEN * (high - low), low + GOLDEN * (high - low));
    let (mut a, mut b) = inner(low, high);
    let (mut of_a, mut of_b) = (at(a.exp())?, at(b.exp())?);
    for _ in 0..REFINED {
        if of_a < of_b {
            high = b;
            (b, of_b) = (a, of_a);
            a = inner(low, high).0;
            of_a = at(a.exp())?;
        } else {
            low = a;
            (a, of_a) = (b, of_b);
            b = inner(low, high).1;
            of_b = at(b.exp())?;
        }
    }
    let refined = if of_a < of_b { (a.exp(), of_a) } else { (b.exp(), of_b) };
    Some(if refined.1 < tried[best] { refined } else { (grid[best], tried[best]) })
}

/// Rows of one posture that answer to its common twist, turned so that no others do.
struct Common {
    /// By the common twist, in units.
    by: Vec<Vector6<f64>>,
    /// By the machine's directions, and the residual: rows x (k + 1).
    rows: Mat<f64>,
}

/// The residual as a model with two variances: `r = J x + B c + e`.
pub(super) struct Rows {
    postures: Vec<Common>,
    /// What answers to no common twist, compressed: `[J r]`, and its part of the squares that no machine explains.
    rest: Mat<f64>,
    square: f64,
    /// Number of rows, and of directions that the machine takes up.
    count: usize,
    directions: usize,
    /// One unit of a common rotation (rad) and displacement (m): what one posture's readings tell of it.
    pub unit: [f64; 2],
}

impl Rows {
    pub fn of(found: &Identification, samples: &[Sample]) -> Result<Option<Self>, EvalError> {
        let outlying: std::collections::HashSet<&str> =
            found.outliers.iter().flat_map(|o| &o.samples).map(String::as_str).collect();
        let taking: Vec<Sample> = found
            .taking_part(samples)
            .into_iter()
            .filter(|s| !outlying.contains(s.name.as_str()))
            .map(|s| Sample { measurement: s.measurement.alone().unwrap_or(s.measurement.clone()), ..s })
            .collect();
        let at = found.geometry.deviations_from(&found.start.nominal());
        let problem = Calibration::new(&found.start, &taking, Form::Minimal, &at);
        let x = problem.coordinates().nearest(&at);
        let not_finite = || EvalError("the Jacobian is not finite".into());
        let svd = linalg::svd(problem.compress(&x)?.jac.as_ref()).ok_or_else(not_finite)?;
        let k = svd.s.iter().filter(|s| **s > TAKEN_UP).count();
        let step = problem.posture_count().div_ceil(MOST).max(1);
        let (mut split, mut square) = (Vec::new(), [0.0; 2]);
        for posture in (0..problem.posture_count()).step_by(step) {
            let (lin, by) = problem.only(posture..posture + 1).linearize_with_twists(&x)?;
            let turned = lin.jac * svd.v.get(.., ..k);
            for by in &by {
                square[0] += by[..3].iter().map(|v| v * v).sum::<f64>();
                square[1] += by[3..].iter().map(|v| v * v).sum::<f64>();
            }
            split.push((turned, lin.r, by));
        }
        let count: usize = split.iter().map(|(_, r, _)| r.len()).sum();
        if count < k + FEWEST || !square.iter().all(|s| s.is_finite()) {
            return Ok(None);
        }
        // Readings of the tool point say nothing of rotations.
        let told = |square: f64| if square > 0.0 { (3.0 * split.len() as f64 / square).sqrt() } else { 0.0 };
        let unit = square.map(told);
        let scale: [f64; 6] = std::array::from_fn(|i| unit[i / 3]);
        let mut rest = RowStream::new(k, count);
        let mut postures = Vec::with_capacity(split.len());
        for (turned, r, by) in split {
            let m = r.len();
            let mut table = Mat::from_fn(m, 6 + k + 1, |i, j| match j {
                0..6 => by[i][j] * scale[j],
                _ if j < 6 + k => turned[(i, j - 6)],
                _ => r[i],
            });
            let factor = linalg::upper_factor(table.as_mut());
            let c = factor.nrows().min(6);
            let by = (0..c).map(|i| Vector6::from_fn(|j, _| factor[(i, j)])).collect();
            postures.push(Common { by, rows: factor.get(..c, 6..).to_owned() });
            let below = factor.get(c.., 6..);
            let mut block = rest.next(below.nrows());
            for j in 0..=k {
                block.column(j).iter_mut().zip(below.col(j).iter()).for_each(|(to, from)| *to = *from);
            }
            rest.add_square(below.col(k).iter().map(|v| v * v).sum());
        }
        let rest = rest.finish();
        let beyond = 2.0 * rest.cost - rest.r.iter().map(|v| v * v).sum::<f64>();
        let rows = Mat::from_fn(rest.r.len(), k + 1, |i, j| if j < k { rest.jac[(i, j)] } else { rest.r[i] });
        Ok(Some(Self { postures, rest: rows, square: beyond.max(0.0), count, directions: k, unit }))
    }

    /// Squares that neither machine nor common twists of this size (in units) explain, and the logarithms of the
    /// determinants of the covariance and of the machine's information.
    fn explained(&self, size: [f64; 2]) -> Option<(f64, f64)> {
        let k = self.directions;
        let scale = Vector6::from_fn(|i, _| size[i / 3]);
        let mut stream = RowStream::new(k, self.rest.nrows() + 6 * self.postures.len());
        let mut push = |rows: &Mat<f64>| {
            let mut block = stream.next(rows.nrows());
            for (j, column) in rows.col_iter().enumerate() {
                block.column(j).iter_mut().zip(column.iter()).for_each(|(to, from)| *to = *from);
            }
            stream.add_square(rows.col(k).iter().map(|v| v * v).sum());
        };
        push(&self.rest);
        let mut log_det = 0.0;
        for posture in &self.postures {
            let c = posture.by.len();
            let by: Vec<Vector6<f64>> = posture.by.iter().map(|by| by.component_mul(&scale)).collect();
            let covariance = Matrix6::from_fn(|i, j| {
                let own = if i == j { 1.0 } else { 0.0 };
                if i < c && j < c { own + by[i].dot(&by[j]) } else { own }
            });
            let lower = covariance.cholesky()?.l();
            log_det += (0..c).map(|i| 2.0 * lower[(i, i)].ln()).sum::<f64>();
            let mut rows = posture.rows.clone();
            for j in 0..=k {
                let column = Vector6::from_fn(|i, _| if i < c { rows[(i, j)] } else { 0.0 });
                let solved = lower.solve_lower_triangular(&column)?;
                (0..c).for_each(|i| rows[(i, j)] = solved[i]);
            }
            push(&rows);
        }
        let all = stream.finish();
        let left = 2.0 * all.cost - all.r.iter().map(|v| v * v).sum::<f64>() + self.square;
        let information: f64 = (0..k).map(|i| all.jac[(i, i)].abs().ln()).sum();
        (left > 0.0).then_some((left, log_det + 2.0 * information))
    }

    /// Minus twice the restricted log likelihood, the size of the readings' own noise chosen best (Patterson & Thompson,
    /// Biometrika 58, 1971), up to a constant.
    pub fn deviance(&self, size: [f64; 2]) -> Option<f64> {
        let (left, log_det) = self.explained(size)?;
        let value = log_det + self.freedom() * left.ln();
        value.is_finite().then_some(value)
    }

    /// The same where `common` is in units as it is, not in parts of the readings' own noise; `own` is a guess of that.
    pub fn deviance_of(&self, common: [f64; 2], own: f64) -> Option<f64> {
        let freedom = self.freedom();
        let at = |own: f64| {
            let (left, log_det) = self.explained(common.map(|size| size / own))?;
            let value = log_det + freedom * ((own * own * freedom).ln() - 1.0) + left / (own * own);
            value.is_finite().then_some(value)
        };
        least(&at, &OWN.map(|part| part * own)).map(|(_, deviance)| deviance)
    }

    fn freedom(&self) -> f64 {
        (self.count - self.directions) as f64
    }

    /// Standard deviation of the readings' own noise, in units of what it was taken for.
    pub fn own(&self, size: [f64; 2]) -> Option<f64> {
        Some((self.explained(size)?.0 / self.freedom()).sqrt())
    }
}
