//! Grouping of samples by posture, and whitening of what they have in common.

use gough::calibration::ByPosture;
use gough::measure::{ConstantDerivative, Evaluation, LimbDerivative, PostureNoise, Row};
use nalgebra::{DMatrix, DVector};

fn grouped(readings: &[(&[f64], Option<&[f64]>)]) -> Vec<Vec<usize>> {
    let found = ByPosture::of_readings(readings.len(), |i| readings[i]);
    assert_eq!(found.sample_count(), readings.len());
    assert_eq!(found.iter().map(<[usize]>::len).sum::<usize>(), readings.len());
    found.iter().map(<[usize]>::to_vec).collect()
}

#[test]
fn equal_readings_are_one_posture_wherever_they_stand() {
    let (a, b): (&[f64], &[f64]) = (&[0.1, -2.0], &[0.1, 3.0]);
    assert_eq!(
        grouped(&[(b, None), (a, None), (b, None), (a, None), (b, None)]),
        [vec![0, 2, 4], vec![1, 3]]
    );
    assert_eq!(grouped(&[(b, None), (a, None)]), [[0], [1]]);
    assert_eq!(grouped(&[]), Vec::<Vec<usize>>::new());
    // The last bit tells postures apart; the sign of zero does not.
    let next: &[f64] = &[0.1_f64.next_up(), -2.0];
    assert_eq!(grouped(&[(a, None), (next, None)]), [[0], [1]]);
    assert_eq!(grouped(&[(&[0.0], None), (&[-0.0], None)]), [[0, 1]]);
}

#[test]
fn pairs_are_one_posture_only_with_both() {
    let (a, b): (&[f64], &[f64]) = (&[1.0], &[2.0]);
    assert_eq!(
        grouped(&[(a, Some(b)), (a, None), (a, Some(a)), (a, Some(b))]),
        [vec![0, 3], vec![1], vec![2]]
    );
}

#[test]
fn postures_are_told_apart_and_gathered() {
    let (a, b): (&[f64], &[f64]) = (&[1.0], &[2.0]);
    let of = [a, b, a, a, b];
    let found = ByPosture::of_readings(of.len(), |i| (of[i], None));
    assert!(found.has_several());
    assert_eq!(found.apart(), [vec![0, 1], vec![2, 4], vec![3]]);
    assert_eq!(found.samples_of(&[1, 0]), [0, 1, 2, 3, 4]);
    assert_eq!(found.samples_of(&[1, 7]), [1, 4]);
}

#[test]
fn grouping_many_samples_of_one_posture_is_not_quadratic() {
    // A comparison of every pair would not end.
    let same = [0.5; 6];
    let found = ByPosture::of_readings(1_000_000, |_| (&same, None));
    assert_eq!((found.count(), found.sample_count()), (1, 1_000_000));
}

/// Numbers between -1 and 1 without a pattern.
fn number(k: usize) -> f64 {
    (12.9898 * (k as f64 + 1.0)).sin() * 0.99
}

fn rows(count: usize, two: bool) -> Evaluation {
    let six = |k: usize| std::array::from_fn(|i| number(7 * k + i));
    let mut out = Evaluation::default();
    for row in 0..count {
        out.rows.push(Row { r: number(900 + row), by_tool: six(row) });
        if two {
            out.by_second.push(six(100 + row));
        }
        if row % 2 == 0 {
            out.by_limb.push(LimbDerivative { row, limb: 1, by_twist: six(200 + row) });
        }
        if row % 3 == 1 {
            out.by_constant.push(ConstantDerivative { row, constant: 2, value: number(300 + row) });
        }
    }
    out
}

/// All numbers of the rows, a column each: r, by the tool, by the second tool, by the limb, by the constant.
fn dense(of: &Evaluation) -> DMatrix<f64> {
    let mut out = DMatrix::zeros(of.rows.len(), 20);
    for (i, row) in of.rows.iter().enumerate() {
        out[(i, 0)] = row.r;
        (0..6).for_each(|j| out[(i, 1 + j)] = row.by_tool[j]);
        if let Some(by) = of.by_second.get(i) {
            (0..6).for_each(|j| out[(i, 7 + j)] = by[j]);
        }
    }
    of.by_limb.iter().for_each(|by| (0..6).for_each(|j| out[(by.row, 13 + j)] += by.by_twist[j]));
    of.by_constant.iter().for_each(|by| out[(by.row, 19)] += by.value);
    out
}

#[test]
fn whitened_rows_have_the_products_that_the_dense_covariance_gives() {
    let noise = PostureNoise { angle: 2.0, length: 3.0 };
    for (count, two) in [(1, false), (3, false), (9, false), (9, true), (40, true)] {
        let plain = rows(count, two);
        let before = dense(&plain);
        let sigma =
            DVector::from_iterator(12, (0..12).map(|i| if i % 6 < 3 { noise.angle } else { noise.length }));
        let by = before.columns(1, 12) * DMatrix::from_diagonal(&sigma);
        let covariance = DMatrix::identity(count, count) + &by * by.transpose();
        let cholesky = covariance.cholesky().unwrap();
        let wanted = before.transpose() * cholesky.solve(&before);
        let mut whitened = plain;
        let log_det = noise.whiten(&mut whitened);
        let after = dense(&whitened);
        assert!((after.transpose() * &after - &wanted).amax() < 1e-12 * wanted.amax().max(1.0));
        let wanted: f64 = cholesky.l().diagonal().iter().map(|d| 2.0 * d.ln()).sum();
        assert!((log_det - wanted).abs() < 1e-12 * wanted.abs().max(1.0), "{log_det} {wanted}");
    }
}

#[test]
fn nothing_in_common_changes_nothing() {
    let plain = rows(9, true);
    let mut same = plain.clone();
    assert_eq!(PostureNoise::default().whiten(&mut same), 0.0);
    assert_eq!(dense(&same), dense(&plain));
}
