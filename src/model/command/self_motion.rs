//! The self-motion of a machine with more drives than the pose needs: readings within their ranges that make the same
//! pose.

use super::range::Ranges;
use super::velocity::Velocity;
use super::way::{approach, longest_fraction};
use super::{NO_MOTION, REACHED, active};
use crate::lie::Se3;
use crate::model::mechanism::{Geometry, Mechanism};
use crate::model::posture::{ITERATIONS, Posture};
use nalgebra::{DMatrix, DVector};

/// Most steps along the self-motion.
const STEPS: usize = 60;
/// Most steps to the least excess of one linearised problem.
const INNER_STEPS: usize = 20;
/// Parts of the ranges to stay away from their ends, tried in this order: as poses at the very end of a range are made by
/// readings there, the last one is none.
const MARGINS: [f64; 2] = [1e-3, 0.0];
/// Relative decrease of the excess below which nothing is gained.
const STALLED: f64 = 1e-4;
/// Singular values below this part of the largest move no actuator back into its range.
const NO_EFFECT: f64 = 1e-6;

/// Moves a posture at the pose along its self-motion, towards readings within the ranges: the posture of the least excess
/// on the way.
///
/// The excess `sum (w_i e_i)^2`, `e_i` what actuator `i` lies outside of its range and `w_i` one over its width, is convex
/// in the coordinates `y` of the null space of `F J_a`. Its least is sought there, the posture is moved towards it, and
/// the pose is made again.
pub(super) fn into_ranges(
    mechanism: &Mechanism,
    geometry: &Geometry,
    ranges: &Ranges,
    mut posture: Posture,
    pose: &Se3,
    followed: [bool; 6],
) -> Posture {
    for margin in MARGINS {
        for _ in 0..STEPS {
            if !step(mechanism, geometry, ranges, &mut posture, pose, followed, margin) {
                break;
            }
        }
        if excess(&ranges.inward(&active(mechanism, &posture), 0.0)) == 0.0 {
            break;
        }
    }
    posture
}

fn excess(inward: &[f64]) -> f64 {
    inward.iter().map(|e| e * e).sum()
}

/// One step that brings the readings nearer to their ranges; `false` where there is none.
fn step(
    mechanism: &Mechanism,
    geometry: &Geometry,
    ranges: &Ranges,
    posture: &mut Posture,
    pose: &Se3,
    followed: [bool; 6],
    margin: f64,
) -> bool {
    let actuators = active(mechanism, posture);
    let before = excess(&ranges.inward(&actuators, margin));
    if before == 0.0 {
        return false;
    }
    let velocity = Velocity::of(mechanism, posture);
    let Some(idle) = null_space(velocity.followed(followed)) else { return false };
    let motion = least_excess(ranges, &actuators, &idle, margin);
    let Some(step) = velocity.of_joints(mechanism, posture, &motion) else { return false };
    let mode = posture.mode;
    let mut fraction = longest_fraction(mechanism, posture, &step);
    while fraction > 1e-3 {
        let mut trial = posture.clone();
        trial.q.iter_mut().zip(&step).for_each(|(q, s)| *q += fraction * s);
        if trial.close(mechanism, geometry).is_ok()
            && trial.mode == mode
            && approach(mechanism, geometry, &mut trial, pose, followed, 0.0) <= REACHED
        {
            let after = excess(&ranges.inward(&active(mechanism, &trial), margin));
            if after < before * (1.0 - STALLED * fraction) {
                *posture = trial;
                return true;
            }
        }
        fraction *= 0.5;
    }
    false
}

/// Orthonormal motions of the actuators that leave the tool at rest, by columns; `None` where there are none.
fn null_space(jacobian: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let count = jacobian.ncols();
    // Rows of zeros make the right factor square.
    let rows = jacobian.nrows();
    let square = jacobian.resize_vertically(rows.max(count), 0.0);
    let svd = square.try_svd(false, true, 5.0 * f64::EPSILON, ITERATIONS)?;
    let v_t = svd.v_t?;
    let largest = svd.singular_values.max();
    let idle: Vec<usize> = (0..count).filter(|&i| svd.singular_values[i] <= NO_MOTION * largest).collect();
    (!idle.is_empty()).then(|| v_t.select_rows(&idle).transpose())
}

/// The motion of the actuators, out of the columns of `idle`, that leaves the least excess by linear theory: Newton steps
/// on a convex function of piecewise second degree.
fn least_excess(ranges: &Ranges, actuators: &[f64], idle: &DMatrix<f64>, margin: f64) -> DVector<f64> {
    let weighted = DMatrix::from_fn(idle.nrows(), idle.ncols(), |i, j| idle[(i, j)] / ranges.width(i));
    let moved = |y: &DVector<f64>| -> Vec<f64> {
        let motion = idle * y;
        let at: Vec<f64> = actuators.iter().zip(motion.iter()).map(|(a, m)| a + m).collect();
        ranges.inward(&at, margin)
    };
    let mut y = DVector::zeros(idle.ncols());
    let mut inward = moved(&y);
    for _ in 0..INNER_STEPS {
        let size = excess(&inward);
        let outside: Vec<usize> = (0..inward.len()).filter(|&i| inward[i] != 0.0).collect();
        if outside.is_empty() {
            break;
        }
        let right = DVector::from_iterator(outside.len(), outside.iter().map(|&i| inward[i]));
        let rows = weighted.select_rows(&outside);
        let Some(svd) = rows.try_svd(true, true, 5.0 * f64::EPSILON, ITERATIONS) else { break };
        let Ok(change) = svd.solve(&right, NO_EFFECT * svd.singular_values.max()) else { break };
        let mut fraction = 1.0;
        let better = loop {
            let trial = &y + &change * fraction;
            let next = moved(&trial);
            if excess(&next) < size * (1.0 - STALLED * fraction) {
                break Some((trial, next));
            }
            fraction *= 0.5;
            if fraction < 1e-3 {
                break None;
            }
        };
        match better {
            Some(better) => (y, inward) = better,
            None => break,
        }
    }
    idle * y
}
