//! The damped Gauss-Newton step and the two measures of a stationary point, on the compressed Jacobian.

use crate::linalg::{self, norm};
use crate::problem::Compressed;
use faer::Mat;

/// Damping below which the unpivoted QR of the augmented matrix could meet a diagonal that it treats as zero.
///
/// faer stops at diagonals of about `16 m eps` of the column; `sqrt(1e-22)` stays clear of that up to
/// m = 2800 augmented rows, and double precision cannot tell a smaller damping from none.
pub const LEAST_DAMPING: f64 = 1e-22;

/// Most trials of the damping for one radius; Hebden's iteration takes two or three.
const HEBDEN: usize = 30;

/// `argmin |J dx + r|^2 + damping |D dx|^2` and what the linear model promises of it.
#[derive(Clone, Debug)]
pub struct DampedStep {
    /// The step, n.
    pub dx: Vec<f64>,
    /// Reduction of `|J dx + r|^2 / 2` by the step, nonnegative by construction.
    pub predicted: f64,
    /// `|D dx|`.
    pub length: f64,
    /// Relative change of `length` per unit of damping, `-d ln(length) / d damping`.
    pub slope: f64,
    /// The damping.
    pub damping: f64,
    /// Whether the damping is the least possible.
    pub undamped: bool,
}

/// Column norms of the Jacobian, n.
pub fn column_norms(jac: &Mat<f64>) -> Vec<f64> {
    (0..jac.ncols()).map(|j| jac.col(j).norm_l2()).collect()
}

/// Raises `scale` to the column norms seen, 1 for columns that were zero so far (Moré 1978, section 6).
pub fn raise_scale(scale: &mut Vec<f64>, jac: &Mat<f64>) {
    let norms = column_norms(jac);
    if scale.is_empty() {
        *scale = norms.iter().map(|&c| if c > 0.0 { c } else { 1.0 }).collect();
    } else {
        for (s, c) in scale.iter_mut().zip(norms) {
            *s = s.max(c);
        }
    }
}

/// The step for one damping, by QR of `[J r; sqrt(damping) D 0]`; `None` where it is not finite.
pub fn damped_step(here: &Compressed, scale: &[f64], damping: f64) -> Option<DampedStep> {
    let (k, n) = (here.jac.nrows(), here.jac.ncols());
    // The least damping counts by columns, which a scale of ones does not know.
    let least = column_norms(&here.jac).iter().zip(scale).fold(1.0f64, |a, (c, d)| a.max(c / d)).powi(2);
    let least = LEAST_DAMPING * if least.is_finite() { least } else { 1.0 };
    let (damping, undamped) = (damping.max(least), damping <= least);
    let root = damping.sqrt();
    let mut augmented = Mat::zeros(k + n, n + 1);
    augmented.as_mut().submatrix_mut(0, 0, k, n).copy_from(&here.jac);
    for (i, &r) in here.r.iter().enumerate() {
        augmented[(i, n)] = r;
    }
    for (j, &d) in scale.iter().enumerate() {
        augmented[(k + j, j)] = root * d;
    }
    if !augmented.is_all_finite() {
        return None;
    }
    let factor = linalg::upper_factor(augmented.as_mut());
    let mut dx: Vec<f64> = (0..n).map(|i| -factor[(i, n)]).collect();
    linalg::solve_upper(&factor, &mut dx)?;
    let along = norm(&linalg::mul(here.jac.as_ref(), &dx));
    let scaled: Vec<f64> = dx.iter().zip(scale).map(|(x, d)| x * d).collect();
    let length = norm(&scaled);
    // w = R^-T D^2 dx / |D dx|, then d|D dx|/d damping = -|D dx| |w|^2 (Moré 1978, section 5).
    let mut w: Vec<f64> =
        scaled.iter().zip(scale).map(|(x, d)| x * d / length.max(f64::MIN_POSITIVE)).collect();
    linalg::solve_upper_transpose(&factor, &mut w)?;
    let slope = w.iter().map(|v| v * v).sum();
    // |r|^2 - |J dx + r|^2 = |J dx|^2 + 2 damping |D dx|^2 at the minimiser: no cancellation (Moré 1978, (4.4)).
    Some(DampedStep {
        dx,
        predicted: 0.5 * along * along + (root * length).powi(2),
        length,
        slope,
        damping,
        undamped,
    })
}

/// The damped step whose length `|D dx|` is `radius` to 10 %, or the least damped one where that is shorter.
///
/// Hebden's iteration (Moré 1978, section 5) from the damping `guess`, safeguarded by a bracket; `None` where no
/// step is finite.
pub fn step_within(here: &Compressed, scale: &[f64], radius: f64, guess: f64) -> Option<DampedStep> {
    let free = damped_step(here, scale, LEAST_DAMPING);
    if let Some(step) = &free
        && step.length <= 1.1 * radius
    {
        return free;
    }
    let mut low = LEAST_DAMPING;
    let mut high = f64::MAX;
    let mut damping = guess.clamp(10.0 * LEAST_DAMPING, 1e30);
    let mut best = None;
    for _ in 0..HEBDEN {
        let Some(step) = damped_step(here, scale, damping) else {
            low = damping;
            damping *= 100.0;
            continue;
        };
        let excess = step.length / radius - 1.0;
        if excess.abs() <= 0.1 {
            return Some(step);
        }
        if excess > 0.0 {
            low = low.max(damping);
        } else {
            high = high.min(damping);
        }
        let next = damping + excess / step.slope;
        damping = if next > low && next < high {
            next
        } else if high < f64::MAX {
            (low * high).sqrt()
        } else {
            damping * 10.0
        };
        best = Some(step);
    }
    best
}

/// Largest cosine between the full residual and a column of the Jacobian: 0 at a stationary point.
pub fn gradient_cosine(here: &Compressed) -> f64 {
    let full = (2.0 * here.cost).sqrt();
    if full == 0.0 {
        return 0.0;
    }
    linalg::mul_transpose(here.jac.as_ref(), &here.r)
        .iter()
        .zip(column_norms(&here.jac))
        .map(|(g, c)| if c > 0.0 { (g / c / full).abs() } else { 0.0 })
        .fold(0.0, f64::max)
}
