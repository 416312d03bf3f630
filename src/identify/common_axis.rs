//! Base and tool frames of a machine whose tool only ever turns about one direction, as that of a SCARA does.
//!
//! With `R_X` any rotation that turns the predicted direction `a` into the measured one `b`, followed by an unknown
//! turn `phi` about `b`, everything across `b` is linear in `(cos phi, sin phi, q, p_X)`:
//!
//! ```text
//! p_k = Rot(b, phi) R0 g_k + Rot(b, psi_k) q + p_X
//! ```
//!
//! `psi_k` is the tool's turn from the first posture, `q` the offset of the measured point across `b`. Along `b` the
//! offsets of base and tool cannot be told apart; the base takes both.

use super::hand_eye::{Pair, tool_turns};
use crate::lie::{Se3, so3};
use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Unit, Vector3};

/// Most rounds of a factorisation.
const ITERATIONS: usize = 1000;

/// `X` and `Y` of `measured = X g Y`, `turns` the sum of `log(M_j M_i') log(G_j G_i')'` over pairs; `None` where the
/// postures do not determine them.
pub fn placed(pairs: &[Pair], turns: &Matrix3<f64>) -> Option<(Se3, Se3)> {
    let (first, _) = pairs.first()?;
    let svd = turns.try_svd(true, true, f64::EPSILON, ITERATIONS)?;
    let largest = svd.singular_values.imax();
    if svd.singular_values[largest].is_nan() || svd.singular_values[largest] <= 0.0 {
        return None;
    }
    let b = Unit::new_normalize(svd.u?.column(largest).into_owned());
    let a = Unit::new_normalize(svd.v_t?.row(largest).transpose());
    let mut least = Vector3::zeros();
    least[b.iamin()] = 1.0;
    let side = b.cross(&least).normalize();
    let across = [side, b.cross(&side)];
    let from = Rotation3::rotation_between(&a, &b)
        .map_or_else(|| 2.0 * across[0] * across[0].transpose() - Matrix3::identity(), Rotation3::into_inner);
    // Columns cos phi, sin phi, q, p_X; two rows a posture.
    let rows = 2 * pairs.len();
    let (mut all, mut right) = (DMatrix::zeros(rows, 6), DVector::zeros(rows));
    for (k, (g, m)) in pairs.iter().enumerate() {
        let (sin, cos) = so3::log(&(g.r * first.r.transpose())).dot(&a).sin_cos();
        let at = from * g.p;
        let (x, y) = (at.dot(&across[0]), at.dot(&across[1]));
        all.row_mut(2 * k).copy_from_slice(&[x, -y, cos, -sin, 1.0, 0.0]);
        all.row_mut(2 * k + 1).copy_from_slice(&[y, x, sin, cos, 0.0, 1.0]);
        right[2 * k] = m.p.dot(&across[0]);
        right[2 * k + 1] = m.p.dot(&across[1]);
    }
    let solution = solve(&all, &right)?;
    // The nominal geometry is not the true one: the pair is near the unit circle, not on it.
    let (sin, cos) = solution[1].atan2(solution[0]).sin_cos();
    let turned = right - all.columns(0, 2) * DVector::from_vec(vec![cos, sin]);
    let offsets = solve(&all.columns(2, 4).into_owned(), &turned)?;
    let turn = Rotation3::from_axis_angle(&b, sin.atan2(cos)).into_inner();
    let base = turn * from;
    let q = across[0] * offsets[0] + across[1] * offsets[1];
    let along: f64 = pairs.iter().map(|(g, m)| (m.p - base * g.p).dot(&b)).sum();
    let position = across[0] * offsets[2] + across[1] * offsets[3] + *b * (along / pairs.len() as f64);
    let tool = so3::nearest(&tool_turns(pairs, &base))?.rotation;
    let tool_point = first.r.transpose() * from.transpose() * turn.transpose() * q;
    Some((Se3 { r: base, p: position }, Se3 { r: tool, p: tool_point }))
}

/// Least squares; `None` where the columns depend on each other.
fn solve(a: &DMatrix<f64>, b: &DVector<f64>) -> Option<DVector<f64>> {
    let svd = a.clone().try_svd(true, true, f64::EPSILON, ITERATIONS)?;
    let (most, least) = (svd.singular_values.max(), svd.singular_values.min());
    if least.is_nan() || least <= 1e-9 * most { None } else { svd.solve(b, 0.0).ok() }
}

#[cfg(test)]
mod tests {
    use super::placed;
    use crate::lie::{Se3, se3, se3::Twist, so3};
    use nalgebra::{Matrix3, Vector3};

    /// A SCARA's poses, seen from elsewhere with another tool: the two frames give them back exactly.
    #[test]
    fn poses_that_turn_about_one_axis_place_both_ends() {
        let up = Vector3::z();
        let predicted: Vec<Se3> = (0..9)
            .map(|k| {
                let (first, second, third) =
                    (0.3 * f64::from(k) - 1.0, 0.2 * f64::from(k * k % 7), 0.1 * f64::from(k));
                let elbow = so3::exp(&(up * first)) * Vector3::new(0.4, 0.0, 0.0);
                let wrist =
                    so3::exp(&(up * (first + second))) * Vector3::new(0.3, 0.0, 0.01 * f64::from(k % 4));
                Se3 { r: so3::exp(&(up * (first + second + third))), p: elbow + wrist }
            })
            .collect();
        let x = se3::exp(&Twist::from_column_slice(&[0.4, -1.9, 0.7, 1.0, -2.0, 0.5]));
        let y = se3::exp(&Twist::from_column_slice(&[0.8, 0.3, -0.6, 0.05, 0.02, 0.11]));
        let measured: Vec<Se3> = predicted.iter().map(|g| x * *g * y).collect();
        let mut turns = Matrix3::zeros();
        for i in 1..predicted.len() {
            let log = |poses: &[Se3]| so3::log(&(poses[i].r * poses[i - 1].r.transpose()));
            turns += log(&measured) * log(&predicted).transpose();
        }
        let pairs: Vec<(Se3, Se3)> = predicted.iter().copied().zip(measured.iter().copied()).collect();
        let (base, tool) = placed(&pairs, &turns).expect("three links move");
        for (g, m) in predicted.iter().zip(&measured) {
            let there = base * *g * tool;
            assert!((there.p - m.p).norm() < 1e-12 && (there.r - m.r).norm() < 1e-12, "{there:?} {m:?}");
        }
    }

    #[test]
    fn postures_that_do_not_turn_place_nothing() {
        let still = vec![(Se3::identity(), Se3::identity()); 4];
        assert!(placed(&still, &Matrix3::zeros()).is_none());
    }
}
