//! Ways to a closed posture: from a measured pose, or from home along the actuators' path.

use super::mechanism::{Geometry, Mechanism, pose_difference};
use super::posture::{NotClosed, Posture};
use crate::lie::Se3;
use nalgebra::{DMatrix, DVector};

const MAX_ITERATIONS: usize = 60;
/// Relative reduction of the gap below which inverse kinematics stops.
const STALLED: f64 = 1e-10;
/// Shortest part of the way from home that continuation takes in one go.
const SHORTEST_STRIDE: f64 = 1.0 / 1024.0;

/// Passive joint variables (machine order) that bring each limb's tool closest to `pose`, actuators held.
///
/// Levenberg-Marquardt per limb from `passive`; distances in machine sizes. The second value is the largest
/// gap that remains, rad and machine sizes: for a machine near nominal it has the size of its errors.
pub fn passive_at_pose(
    mechanism: &Mechanism,
    geometry: &Geometry,
    actuators: &[f64],
    passive: &[f64],
    pose: &Se3,
) -> (Vec<f64>, f64) {
    let length = mechanism.characteristic_length();
    let (mut actuator, mut joint) = (0, 0);
    let mut solved = Vec::with_capacity(passive.len());
    let mut worst = 0.0_f64;
    for (limb, links) in mechanism.limbs.iter().zip(&geometry.limbs) {
        let m = limb.passive_count();
        let a = &actuators[actuator..actuator + limb.joints.len() - m];
        let mut theta = passive[joint..joint + m].to_vec();
        let gap = limb_at_pose(limb, links, a, &mut theta, pose, length);
        worst = worst.max(gap);
        solved.extend(theta);
        actuator += limb.joints.len() - m;
        joint += m;
    }
    (solved, worst)
}

fn limb_at_pose(
    limb: &super::Limb,
    links: &[Se3],
    actuators: &[f64],
    theta: &mut [f64],
    pose: &Se3,
    length: f64,
) -> f64 {
    let m = theta.len();
    let evaluate = |theta: &[f64]| -> (DVector<f64>, DMatrix<f64>) {
        let (mut a, mut p) = (actuators.iter(), theta.iter());
        let mut at = links[0];
        let mut before = Vec::with_capacity(limb.joints.len());
        for (joint, link) in limb.joints.iter().zip(&links[1..]) {
            let q = if joint.actuated { a.next() } else { p.next() };
            before.push(at);
            at = joint.motion.moved(&at, q.copied().unwrap_or(0.0)) * *link;
        }
        let (w, v) = pose_difference(pose, &at);
        let gap = DVector::from_iterator(6, w.iter().copied().chain(v.iter().map(|v| v / length)));
        let mut jacobian = DMatrix::zeros(6, m);
        let mut column = 0;
        for (joint, g) in limb.joints.iter().zip(&before).filter(|(joint, _)| !joint.actuated) {
            let twist = joint.motion.tool_twist(g, &at.p);
            for i in 0..6 {
                jacobian[(i, column)] = if i < 3 { twist[i] } else { twist[i] / length };
            }
            column += 1;
        }
        (gap, jacobian)
    };
    let (mut gap, mut jacobian) = evaluate(theta);
    let mut damping = 1e-6;
    for _ in 0..MAX_ITERATIONS {
        let mut augmented = DMatrix::zeros(6 + m, m);
        augmented.view_mut((0, 0), (6, m)).copy_from(&jacobian);
        augmented.view_mut((6, 0), (m, m)).fill_diagonal(f64::sqrt(damping));
        let mut target = DVector::zeros(6 + m);
        target.rows_mut(0, 6).copy_from(&gap);
        let qr = augmented.qr();
        let Some(step) = qr.r().solve_upper_triangular(&(qr.q().transpose() * target)) else { break };
        let trial: Vec<f64> = theta.iter().zip(step.iter()).map(|(t, s)| t + s).collect();
        let (next_gap, next_jacobian) = evaluate(&trial);
        if next_gap.norm() < gap.norm() {
            let stalled = gap.norm() - next_gap.norm() <= STALLED * gap.norm();
            theta.copy_from_slice(&trial);
            (gap, jacobian) = (next_gap, next_jacobian);
            damping = (damping * 0.1).max(1e-12);
            if stalled {
                break;
            }
        } else if damping > 1e6 || step.norm() < 1e-14 {
            break;
        } else {
            damping *= 10.0;
        }
    }
    gap.norm()
}

/// Closes the posture by following the straight path of the actuators from home, in strides short enough
/// that the assembly mode of home is kept. `posture` must be closed at home.
pub fn close_from_home(
    mechanism: &Mechanism,
    geometry: &Geometry,
    posture: &mut Posture,
    actuators: &[f64],
) -> Result<(), NotClosed> {
    let mode = posture.mode;
    let mut reached = 0.0;
    let mut stride = 1.0;
    let mut passive = posture.passive(mechanism);
    let mut iterations = 0;
    while reached < 1.0 {
        let to = if reached + stride > 1.0 - 1e-9 { 1.0 } else { reached + stride };
        let at: Vec<f64> = actuators.iter().map(|a| a * to).collect();
        posture.set_joints(mechanism, &at, &passive);
        let closed = posture.close(mechanism, geometry);
        iterations += posture.iterations;
        match closed {
            Ok(()) if posture.mode == mode && near(&passive, &posture.passive(mechanism)) => {
                passive = posture.passive(mechanism);
                reached = to;
                stride *= 2.0;
            }
            outcome if stride <= SHORTEST_STRIDE => {
                return Err(match outcome {
                    Err(why) => why,
                    Ok(()) => NotClosed::OtherMode,
                });
            }
            _ => stride *= 0.5,
        }
    }
    posture.iterations = iterations;
    Ok(())
}

/// Whether one stride moved no passive joint so far that it may have changed branch, rad or m.
fn near(from: &[f64], to: &[f64]) -> bool {
    from.iter().zip(to).all(|(a, b)| (a - b).abs() < 0.5)
}
