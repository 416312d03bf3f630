//! Triangular factors and what follows from them, against their definitions.

use faer::Mat;
use gough::linalg::{complement, inverse_norm, upper_factor};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn numbers(seed: u64, rows: usize, columns: usize) -> Mat<f64> {
    let mut draw = ChaCha8Rng::seed_from_u64(seed);
    Mat::from_fn(rows, columns, |_, _| draw.random_range(-1.0..1.0))
}

fn largest(a: &Mat<f64>) -> f64 {
    a.col_iter().flat_map(|column| column.iter()).fold(0.0, |most, v| most.max(v.abs()))
}

/// `R'R = A'A`, on both sides of the number of columns from which blocks are used.
#[test]
fn factors_have_the_gram_matrix_of_their_rows() {
    let shapes = [(1, 1), (5, 1), (1, 5), (2, 2), (3, 2), (7, 7), (8, 9), (40, 31), (301, 31), (20, 63)];
    for (m, n) in shapes.into_iter().chain([(300, 64), (64, 64), (30, 70), (0, 3)]) {
        let a = numbers((m * 100 + n) as u64, m, n);
        let r = upper_factor(a.clone().as_mut());
        assert_eq!((r.nrows(), r.ncols()), (m.min(n), n));
        for j in 0..n {
            assert!((j + 1..r.nrows()).all(|i| r[(i, j)] == 0.0), "{m} x {n}: not triangular");
        }
        let apart = largest(&(r.transpose() * &r - a.transpose() * &a));
        assert!(apart <= 1e-15 * (m as f64 + 10.0), "{m} x {n}: {apart:e}");
    }
}

/// Columns of zeros, equal columns, and numbers whose squares overflow or vanish.
#[test]
fn factors_of_difficult_columns() {
    for scale in [1e-290, 1e-200, 1e-150, 1.0, 1e150, 1e200, 1e300] {
        let mut a = numbers(3, 12, 5);
        a.col_mut(1).fill(0.0);
        for i in 0..12 {
            a[(i, 3)] = a[(i, 2)];
        }
        let expected = a.transpose() * &a;
        let scaled = Mat::from_fn(12, 5, |i, j| scale * a[(i, j)]);
        let r = upper_factor(scaled.clone().as_mut());
        let r = Mat::from_fn(5, 5, |i, j| r[(i, j)] / scale);
        let apart = largest(&(r.transpose() * &r - expected));
        assert!(apart <= 1e-14, "{scale:e}: {apart:e}");
        assert!(r[(3, 3)].abs() <= 1e-15, "{scale:e}: equal columns leave nothing");
    }
}

/// As rows are streamed: columns that are longer than the part in use.
#[test]
fn factors_of_a_part_of_the_rows() {
    let whole = numbers(11, 50, 9);
    let mut filled = whole.clone();
    let r = upper_factor(filled.as_mut().subrows_mut(0, 20));
    let part = whole.get(..20, ..).to_owned();
    let apart = largest(&(r.transpose() * &r - part.transpose() * &part));
    assert!(apart <= 1e-14, "{apart:e}");
    assert_eq!(filled.get(20.., ..), whole.get(20.., ..), "the others are left alone");
    let mut spoiled = part.clone();
    spoiled[(7, 2)] = f64::NAN;
    let r = upper_factor(spoiled.as_mut());
    assert!((0..3).any(|i| !r[(i, 2)].is_finite()), "what is not a number stays so");
}

#[test]
fn complements_are_orthonormal_and_orthogonal() {
    for (n, k) in [(1, 0), (4, 1), (42, 12), (42, 19), (7, 7), (90, 70)] {
        let a = numbers(k as u64 + 7, n, k);
        let basis = complement(a.as_ref()).expect("finite");
        assert_eq!((basis.nrows(), basis.ncols()), (n, n - k));
        let one = largest(&(basis.transpose() * &basis - Mat::<f64>::identity(n - k, n - k)));
        assert!(one <= 1e-14, "{n} {k}: {one:e}");
        let across = largest(&(a.transpose() * &basis));
        assert!(across <= 1e-14, "{n} {k}: {across:e}");
    }
    assert!(complement(Mat::from_fn(2, 1, |_, _| f64::NAN).as_ref()).is_none());
}

/// By the singular values: `|R^-1|_F^2` is the sum of their inverse squares.
#[test]
fn inverse_norms_are_those_of_the_singular_values() {
    for n in [1, 2, 5, 31] {
        let a = numbers(n as u64 + 50, n + 3, n);
        let sum: f64 = a.singular_values().expect("finite").iter().map(|s| s.powi(-2)).sum();
        let factor = upper_factor(a.clone().as_mut());
        let norm = inverse_norm(&factor, n);
        assert!((norm - sum.sqrt()).abs() <= 1e-12 * norm, "{n}: {norm} is {}", sum.sqrt());
    }
    let mut singular = Mat::from_fn(2, 2, |i, j| if i == 0 { 1.0 + j as f64 } else { 0.0 });
    assert_eq!(inverse_norm(&singular, 2), f64::INFINITY);
    singular[(1, 1)] = f64::INFINITY;
    assert_eq!(inverse_norm(&singular, 2), f64::INFINITY);
}
