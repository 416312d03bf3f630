//! SO(3) and SE(3) against power series in double-double arithmetic: 1e-14 at zero, near pi and beyond.

mod double_double;

use double_double::{Dd, Mat, ONE, PI, ad, antisymmetric, hat, largest, norm, twist_matrix};
use gough::lie::se3::{self, Twist};
use gough::lie::{Se3, so3};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts;

const TOLERANCE: f64 = 1e-14;
/// Four turns.
/// Angles where series begin: twice the arc tangent of 0.02, the root of 0.002.
const LOGARITHM: f64 = 0.039_994_667_946_301_07;
const COTANGENT: f64 = 0.044_721_359_549_995_8;
const LARGEST: f64 = 8.0 * consts::PI + 0.01;

fn dd<const N: usize>(x: &SVector<f64, N>) -> [Dd; N] {
    std::array::from_fn(|i| Dd::from(x[i]))
}

fn round<const N: usize>(m: &Mat<N>) -> SMatrix<f64, N, N> {
    SMatrix::from_fn(|i, j| m.0[i][j].to_f64())
}

/// Largest entry of `code - reference`, the difference taken before the reference is rounded.
fn error<const N: usize>(code: &SMatrix<f64, N, N>, reference: &Mat<N>) -> f64 {
    largest((0..N * N).map(|k| Dd::from(code[(k / N, k % N)]) - reference.0[k / N][k % N]))
}

fn vector_error<const N: usize>(code: &SVector<f64, N>, reference: [Dd; N]) -> f64 {
    largest((0..N).map(|i| Dd::from(code[i]) - reference[i]))
}

/// Upper-left, lower-left, lower-right.
fn blocks(m: &SMatrix<f64, 6, 6>) -> [Matrix3<f64>; 3] {
    assert_eq!(m.fixed_view::<3, 3>(0, 3).amax(), 0.0);
    [(0, 0), (3, 0), (3, 3)].map(|at| m.fixed_view::<3, 3>(at.0, at.1).into_owned())
}

fn reference_blocks(m: &Mat<6>) -> [Mat<3>; 3] {
    [(0, 0), (3, 0), (3, 3)].map(|at| Mat::from_fn(|i, j| m.0[at.0 + i][at.1 + j]))
}

fn exact(m: &Matrix3<f64>) -> Mat<3> {
    Mat::from_fn(|i, j| Dd::from(m[(i, j)]))
}

fn random_vector(rng: &mut ChaCha8Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0))
}

/// Directions: along each axis, in a plane, close to an axis, anywhere.
fn direction(rng: &mut ChaCha8Rng) -> Vector3<f64> {
    let mut v = random_vector(rng);
    let axis = rng.random_range(0..3);
    match rng.random_range(0..8) {
        0 => v = Vector3::ith(axis, v[axis]),
        1 => v[axis] = 0.0,
        2 => v = v * 1e-7 + Vector3::ith(axis, 1.0),
        _ => {}
    }
    v.normalize()
}

/// Rotation vectors of every size that is special to some formula, and many that are not, up to `largest`.
fn rotation_vectors(seed: u64, largest: f64) -> Vec<Vector3<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut angles = vec![0.0];
    for exponent in [-300, -200, -162, -154, -100, -30, -20, -16, -12, -9, -8, -7, -6, -5, -4, -3, -2, -1] {
        angles.extend([1.0, 3.0, 7.0].map(|m| m * 10.0_f64.powi(exponent)));
    }
    // The switches between series and closed form, and the trace's sign in the logarithm at 90 and 120 degrees.
    for switch in [1e-4, LOGARITHM, COTANGENT, 0.7, consts::FRAC_PI_2, 2.0, 2.0 * consts::FRAC_PI_3, 2.5] {
        angles.extend([-1e-9, -1e-15, 0.0, 1e-15, 1e-9].map(|d| switch * (1.0 + d)));
    }
    for half_turn in 1..=8 {
        let angle = f64::from(half_turn) * consts::PI;
        angles.push(angle);
        for exponent in 3..=15 {
            angles.extend([1.0, -1.0].map(|sign| angle + sign * 10.0_f64.powi(-exponent)));
        }
    }
    angles.retain(|&t| t <= largest);
    for _ in 0..150 {
        angles.push(rng.random_range(0.0..consts::PI.min(largest)));
        angles.push(rng.random_range(0.0..largest));
    }
    angles.iter().flat_map(|t| [direction(&mut rng) * *t, direction(&mut rng) * *t]).collect()
}

/// The same, each with a translation of its own size.
fn twists(seed: u64, largest: f64) -> Vec<Twist> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed + 1);
    let join = |w: &Vector3<f64>| {
        let size = 10.0_f64.powf(rng.random_range(-6.0..3.0));
        se3::join(w, &(direction(&mut rng) * size))
    };
    rotation_vectors(seed, largest).iter().map(join).collect()
}

/// `|(t/2) / sin(t/2)|`, the size of `J^-1`: what nearness to a full turn makes of an error.
fn magnification(t: f64) -> f64 {
    if t < 0.1 { 1.0 } else { (0.5 * t / (0.5 * t).sin()).abs().max(1.0) }
}

#[track_caller]
fn check(what: &str, t: f64, error: f64, scale: f64) {
    assert!(error <= TOLERANCE * scale, "{what} at |w| = {t:e}: {:.2e} relative", error / scale);
}

/// `code` against `reference`, whose off-diagonal entries are of the order of the angle when that is small.
#[track_caller]
fn check_rotation_block(what: &str, t: f64, code: &Matrix3<f64>, reference: &Mat<3>, scale: f64) {
    check(what, t, error(code, reference), scale);
    let (code, reference) = (antisymmetric(&exact(code)), antisymmetric(reference));
    let error = largest((0..3).map(|i| code[i] - reference[i]));
    check(what, t, error, scale * t.min(1.0));
}

/// All three blocks, the coupling relative to |v|.
#[track_caller]
fn check_blocks(what: &str, t: f64, code: &SMatrix<f64, 6, 6>, reference: &Mat<6>, v: f64) {
    for ((code, reference), scale) in blocks(code).iter().zip(&reference_blocks(reference)).zip([1.0, v, 1.0])
    {
        check(what, t, error(code, reference), scale);
    }
}

#[test]
fn rotations() {
    for w in rotation_vectors(1, LARGEST) {
        let t = norm(dd(&w)).to_f64();
        let hat = hat(dd(&w));
        check_rotation_block("exp", t, &so3::exp(&w), &hat.exp(t), 1.0);
        let jacobian = hat.left_jacobian(t);
        check_rotation_block("left Jacobian", t, &so3::left_jacobian(&w), &jacobian, 1.0);
        // Near a full turn the inverse has slope (magnification)^2 in t, and |w| is known to rounding only.
        let scale = magnification(t).powi(2);
        check_rotation_block("inverse", t, &so3::left_jacobian_inverse(&w), &jacobian.inverse(), scale);
    }
}

#[test]
fn motions() {
    for xi in twists(2, LARGEST) {
        let (w, v) = se3::split(&xi);
        let t = norm(dd(&w)).to_f64();
        let g = se3::exp(&xi);
        let reference = twist_matrix(dd(&xi)).exp(t);
        check_rotation_block("exp", t, &g.r, &Mat::from_fn(|i, j| reference.0[i][j]), 1.0);
        let p: [Dd; 3] = std::array::from_fn(|i| reference.0[i][3]);
        check("position", t, vector_error(&g.p, p), v.norm());
        if t <= consts::PI {
            check("position by its own size", t, vector_error(&g.p, p), norm(p).to_f64());
        }

        check_blocks("Ad", t, &se3::adjoint(&g), &ad(dd(&xi)).exp(t), v.norm());
    }
}

#[test]
fn left_jacobians_of_motions() {
    for xi in twists(3, LARGEST) {
        let (w, v) = se3::split(&xi);
        let t = norm(dd(&w)).to_f64();
        let jacobian = ad(dd(&xi)).left_jacobian(t);
        let (code, reference) = (blocks(&se3::left_jacobian(&xi)), reference_blocks(&jacobian));
        assert_eq!((code[0], code[0]), (so3::left_jacobian(&w), code[2]));
        check("coupling", t, error(&code[1], &reference[1]), v.norm());
        if t <= consts::PI {
            check("coupling by its own size", t, error(&code[1], &reference[1]), round(&reference[1]).amax());
        }
        assert_eq!(se3::right_jacobian(&-xi), se3::left_jacobian(&xi));

        let (code, reference) =
            (blocks(&se3::left_jacobian_inverse(&xi)), reference_blocks(&jacobian.inverse()));
        assert_eq!((code[0], code[0]), (so3::left_jacobian_inverse(&w), code[2]));
        // One inverse on either side of the coupling, and the slope of either is one order more.
        let scale = v.norm() * magnification(t).powi(3);
        check("inverse, coupling", t, error(&code[1], &reference[1]), scale);
        if t <= consts::PI {
            check("inverse by its own size", t, error(&code[1], &reference[1]), round(&reference[1]).amax());
        }
    }
}

/// `w` less the whole turns that bring it to at most half a turn.
fn principal(w: &Vector3<f64>) -> [Dd; 3] {
    let turn = PI + PI;
    let (mut w, mut t) = (dd(w), norm(dd(w)));
    while (t - PI).to_f64() > 0.0 {
        w = w.map(|x| x * (ONE - turn / t));
        t = norm(w);
    }
    w
}

#[test]
fn logarithms() {
    for xi in twists(4, LARGEST) {
        let (given, _) = se3::split(&xi);
        let t = norm(dd(&given)).to_f64();
        let reference = twist_matrix(dd(&xi)).exp(t);
        let rounded = round(&reference);
        let g = Se3 {
            r: rounded.fixed_view::<3, 3>(0, 0).into_owned(),
            p: rounded.fixed_view::<3, 1>(0, 3).into_owned(),
        };
        let (code_w, code_v) = se3::split(&se3::log(&g));
        assert_eq!(code_w, so3::log(&g.r));
        assert!(code_w.norm() <= consts::PI * (1.0 + 4.0 * f64::EPSILON));

        // Rounding moves the entries of R by at most 2^-54, the small ones near the identity by less in
        // proportion. So no digit of a small `w` is lost, and near a half turn, where `log` has condition pi / 2,
        // only this is: within the rounding of the half turn R does not tell which of w and -w it came from.
        let mut w = principal(&given);
        let to_half_turn = (PI - norm(w)).to_f64();
        if to_half_turn < 4e-16 && code_w.dot(&Vector3::from(w.map(Dd::to_f64))) < 0.0 {
            let full_turn_less = ONE - (PI + PI) / norm(w);
            w = w.map(|x| x * full_turn_less);
        }
        check("log", t, vector_error(&code_w, w), norm(w).to_f64());
        let v = hat(w).left_jacobian(consts::PI).inverse().apply(std::array::from_fn(|i| reference.0[i][3]));
        check("log, translation", t, vector_error(&code_v, v), norm(v).to_f64());
    }
}

#[test]
fn closed_forms_35_and_38() {
    let n = |x: f64| Dd::from(x);
    for xi in twists(5, 2.5 * consts::PI) {
        let (w, v) = se3::split(&xi);
        let t = norm(dd(&w));
        if t.to_f64() < 0.05 {
            continue; // cancels beyond the digits at hand
        }
        let (s, c) = t.sin_cos();
        let (t2, t3) = (t * t, t * t * t);
        let b = [
            (n(3.0) * s - t * c) / (n(2.0) * t),
            (n(4.0) - n(4.0) * c - t * s) / (n(2.0) * t2),
            (s - t * c) / (n(2.0) * t3),
            (n(2.0) - n(2.0) * c - t * s) / (n(2.0) * t2 * t2),
        ];
        let c = [
            (n(4.0) - t * s - n(4.0) * c) / (n(2.0) * t2),
            (n(4.0) * t - n(5.0) * s + t * c) / (n(2.0) * t3),
            (n(2.0) - t * s - n(2.0) * c) / (n(2.0) * t2 * t2),
            (n(2.0) * t - n(3.0) * s + t * c) / (n(2.0) * t2 * t3),
        ];
        let z = ad(dd(&xi));
        let polynomial = |coefficients: [Dd; 4]| {
            let start = (Mat::identity(), Mat::identity());
            let step = |(sum, power): (Mat<6>, Mat<6>), a: Dd| (sum + (power * z).scale(a), power * z);
            coefficients.into_iter().fold(start, step).0
        };
        let codes = [se3::adjoint(&se3::exp(&xi)), se3::left_jacobian(&xi)];
        for (code, reference) in codes.iter().zip([polynomial(b), polynomial(c)]) {
            check_blocks("closed form", t.to_f64(), code, &reference, v.norm());
        }
    }
}

#[test]
fn left_jacobian_is_the_derivative_of_the_exponential() {
    // Central differences in double-double: truncation near 1e-22, rounding near 1e-20.
    let step = 2.0_f64.powi(-36);
    for xi in twists(6, LARGEST).into_iter().step_by(5) {
        let (w, v) = se3::split(&xi);
        let t = norm(dd(&w)).to_f64();
        let moved = |k: usize, h: f64| {
            let mut xi = dd(&xi);
            xi[k] = xi[k] + Dd::from(h);
            twist_matrix(xi).exp(t)
        };
        let inverse = twist_matrix(dd(&-xi)).exp(t);
        let (mut left, mut right) = (Mat::<6>::identity(), Mat::<6>::identity());
        for k in 0..6 {
            let derivative = (moved(k, step) + moved(k, -step).scale(-ONE)).scale(ONE / Dd::from(2.0 * step));
            for (jacobian, d) in [(&mut left, derivative * inverse), (&mut right, inverse * derivative)] {
                for (i, dw) in antisymmetric(&d).into_iter().enumerate() {
                    jacobian.0[i][k] = dw;
                    jacobian.0[3 + i][k] = d.0[i][3];
                }
            }
        }
        for (code, reference) in [(se3::left_jacobian(&xi), left), (se3::right_jacobian(&xi), right)] {
            check_blocks("derivative", t, &code, &reference, v.norm());
        }
    }
}
