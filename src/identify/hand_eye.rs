//! Base `X` and tool `Y` of `measured = X g Y` in closed form (Park & Martin, IEEE Trans. Robotics and Automation 10(5),
//! 1994): the rotation of `X` from relative rotations, then that of `Y`, then both displacements by linear least squares.

use crate::lie::{Se3, so3};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// A predicted pose and the one that was measured there.
pub type Pair = (Se3, Se3);

/// Relative turn, rad, beyond which its sign is not sure: almost pi.
const SURE: f64 = 2.8;

/// `sum log(M_j M_i') log(G_j G_i')'`, to which the rotation of `X` is nearest; pairs a third of the set apart differ by
/// more than neighbours do.
pub fn relative_turns(pairs: &[Pair]) -> Matrix3<f64> {
    let n = pairs.len();
    let mut sum = Matrix3::zeros();
    for stride in [1, (n / 3).max(1)] {
        for i in 0..n {
            let ((gi, mi), (gj, mj)) = (&pairs[i], &pairs[(i + stride) % n]);
            let from = so3::log(&(gj.r * gi.r.transpose()));
            let to = so3::log(&(mj.r * mi.r.transpose()));
            if from.norm() < SURE && to.norm() < SURE {
                sum += to * from.transpose();
            }
        }
    }
    sum
}

/// `sum M G'`, to which the rotation of `X` is nearest where the tool is as drawn.
pub fn turns(pairs: &[Pair]) -> Matrix3<f64> {
    pairs.iter().map(|(g, m)| m.r * g.r.transpose()).sum()
}

/// `sum G' X' M`, to which the rotation of `Y` is nearest, the rotation of `X` given.
pub fn tool_turns(pairs: &[Pair], base: &Matrix3<f64>) -> Matrix3<f64> {
    pairs.iter().map(|(g, m)| g.r.transpose() * base.transpose() * m.r).sum()
}

/// Displacements of `X` and `Y`, zero where they are not `free` (base, tool), the rotation of `X` given:
/// `m.p - X g.p = X g.r p_Y + p_X`. A row `pull` times `p_Y` stands beside each posture's, so that what the postures do not
/// tell stays as drawn; `None` where nothing determines them.
pub fn shifts(
    pairs: &[Pair],
    base: &Matrix3<f64>,
    free: (bool, bool),
    pull: f64,
) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let count = pairs.len().max(1) as f64;
    let left = |(g, m): &Pair| m.p - base * g.p;
    // About the means the displacement of a free base drops out.
    let (a0, b0) = match free.0 {
        true => (
            pairs.iter().map(|(g, _)| base * g.r).sum::<Matrix3<f64>>() / count,
            pairs.iter().map(left).sum::<Vector3<f64>>() / count,
        ),
        false => (Matrix3::zeros(), Vector3::zeros()),
    };
    let mut tool = Vector3::zeros();
    if free.1 {
        let rows = 3 * pairs.len() + 3;
        let (mut a, mut b) = (DMatrix::zeros(rows, 3), DVector::zeros(rows));
        for (k, pair) in pairs.iter().enumerate() {
            a.fixed_view_mut::<3, 3>(3 * k, 0).copy_from(&(base * pair.0.r - a0));
            b.fixed_rows_mut::<3>(3 * k).copy_from(&(left(pair) - b0));
        }
        a.fixed_view_mut::<3, 3>(rows - 3, 0).copy_from(&(Matrix3::identity() * (pull * count.sqrt())));
        let qr = a.qr();
        qr.q_tr_mul(&mut b);
        let solved = qr.r().solve_upper_triangular(&b.rows(0, 3).into_owned())?;
        tool = Vector3::new(solved[0], solved[1], solved[2]);
    }
    let place = if free.0 { b0 - a0 * tool } else { Vector3::zeros() };
    Some((place, tool))
}
