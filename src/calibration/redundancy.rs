//! Redundant deviations of a limb whose links may be held in part (docs/theory.md section 4).

use crate::lie::Se3;
use crate::lie::se3::{self, Twist};
use crate::linalg;
use crate::model::Limb;
use faer::Mat;

/// Redundant body twists (complete x k) that leave held components alone, as many as a machine has that deviates.
///
/// Where a link is held in part, parallel or square axes may hide at nominal that its other components matter: only
/// what stays redundant once they deviate is taken, continued to the nominal machine.
pub(super) fn redundancy(limb: &Limb, links: &[Se3], sigma: &[f64]) -> Mat<f64> {
    if sigma.iter().all(|sigma| *sigma > 0.0) {
        return null_matrix(limb, links);
    }
    let (generic, _) = null_coefficients(limb, &apart(links, sigma), sigma, 0);
    let (here, all) = null_coefficients(limb, links, sigma, generic.ncols());
    match here.ncols() > generic.ncols() {
        true => all * (&here * (here.transpose() * generic)),
        false => all * here,
    }
}

/// All redundant body twists at these links that leave held components alone: `count` or, where axes are special,
/// more.
pub(super) fn redundancy_of(limb: &Limb, links: &[Se3], sigma: &[f64], count: usize) -> Mat<f64> {
    if sigma.iter().all(|sigma| *sigma > 0.0) {
        return null_matrix(limb, links);
    }
    let (here, all) = null_coefficients(limb, links, sigma, count);
    all * here
}

fn null_matrix(limb: &Limb, links: &[Se3]) -> Mat<f64> {
    let columns = limb.null_basis(links);
    let mut null = Mat::zeros(6 * links.len(), columns.len());
    for (j, column) in columns.iter().enumerate() {
        null.col_as_slice_mut(j).copy_from_slice(column);
    }
    null
}

/// Combinations of the null basis, `least` or more, that leave the held components, one or more, alone; and the null basis.
fn null_coefficients(limb: &Limb, links: &[Se3], sigma: &[f64], least: usize) -> (Mat<f64>, Mat<f64>) {
    let all = null_matrix(limb, links);
    let held: Vec<usize> = (0..sigma.len()).filter(|&i| sigma[i] == 0.0).collect();
    let at_held = Mat::from_fn(held.len(), all.ncols(), |i, j| all[(held[i], j)]);
    let coefficients = match linalg::svd(at_held.as_ref()) {
        Some(svd) => {
            let largest = svd.s.first().copied().unwrap_or(0.0).max(1.0);
            let rank = svd.s.iter().filter(|v| **v > 1e-9 * largest).count();
            svd.v.get(.., rank.min(all.ncols() - least)..).to_owned()
        }
        None => Mat::zeros(all.ncols(), 0),
    };
    (coefficients, all)
}

/// The links, each deviated by some 0.05 rad and m in every component that is not held, no two alike.
fn apart(links: &[Se3], sigma: &[f64]) -> Vec<Se3> {
    let moved = links.iter().zip(sigma.chunks_exact(6)).enumerate().map(|(j, (link, sigma))| {
        let some = |i: usize| if sigma[i] > 0.0 { 0.05 * (1.0 + (6 * j + i) as f64).sin() } else { 0.0 };
        *link * se3::exp(&Twist::from_fn(|i, _| some(i)))
    });
    moved.collect()
}

/// Rows that complete pivoting picks for the k columns of `a`.
pub(super) fn pivot_rows(a: &Mat<f64>) -> Vec<usize> {
    let mut columns: Vec<Vec<f64>> = a.col_iter().map(|column| column.iter().copied().collect()).collect();
    let mut largest: Vec<f64> = columns.iter().map(|column| largest_entry(column)).collect();
    let mut rows: Vec<usize> = Vec::with_capacity(columns.len());
    loop {
        // The first of those that are equal to rounding.
        let enough = (1.0 - 1e-6) * largest_entry(&largest);
        let Some(at) = largest.iter().position(|v| *v >= enough && *v > 0.0) else { return rows };
        let Some(row) = columns[at].iter().position(|v| v.abs() >= enough) else { return rows };
        let pivot = columns.remove(at);
        largest.remove(at);
        rows.push(row);
        for (column, largest) in columns.iter_mut().zip(&mut largest) {
            if column[row] != 0.0 {
                linalg::subtract(column[row] / pivot[row], &pivot, column);
                // Exactly: a row is picked once.
                column[row] = 0.0;
                *largest = largest_entry(column);
            }
        }
    }
}

fn largest_entry(a: &[f64]) -> f64 {
    a.iter().fold(0.0, |most, v| if v.abs() > most { v.abs() } else { most })
}
