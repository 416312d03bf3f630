//! The laws of SO(3) and SE(3), on random motions and at the angles where formulas fail.

use gough::lie::se3::{self, Twist, ad, adjoint};
use gough::lie::{Se3, so3};
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::PI;

const TOLERANCE: f64 = 1e-14;
const SAMPLES: usize = 300;

fn unit(rng: &mut ChaCha8Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0)).normalize()
}

/// A twist of the angle given, with |v| from 0.1 to 10.
fn twist(rng: &mut ChaCha8Rng, angle: f64) -> Twist {
    let size = 10.0_f64.powf(rng.random_range(-1.0..1.0));
    se3::join(&(unit(rng) * angle), &(unit(rng) * size))
}

fn random_twists(seed: u64, largest: f64) -> impl Iterator<Item = Twist> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..SAMPLES).map(move |_| {
        let angle = rng.random_range(0.0..largest);
        twist(&mut rng, angle)
    })
}

/// Twists of random angle below pi, of tiny angles, and of angles around pi.
fn twists_to_pi(seed: u64) -> Vec<Twist> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut twists: Vec<_> = random_twists(seed + 1, PI).collect();
    for exponent in [-300, -160, -20, -16, -12, -8, -5, -4, -3] {
        twists.push(twist(&mut rng, 10.0_f64.powi(exponent)));
    }
    for exponent in 3..=15 {
        twists.push(twist(&mut rng, PI - 10.0_f64.powi(-exponent)));
    }
    twists.push(twist(&mut rng, 0.0));
    twists.push(twist(&mut rng, PI));
    twists
}

fn motions(seed: u64) -> impl Iterator<Item = Se3> {
    random_twists(seed, 2.0 * PI).map(|xi| se3::exp(&xi))
}

/// Largest size of an entry, NaN if any is NaN (`amax` would pass over it).
fn largest<const R: usize, const C: usize>(m: SMatrix<f64, R, C>) -> f64 {
    m.iter().fold(0.0, |m, x| if x.abs() <= m || m.is_nan() { m } else { x.abs() })
}

/// Asserts equal motions, the positions relative to `length`.
#[track_caller]
fn assert_same(a: &Se3, b: &Se3, length: f64) {
    assert!(largest(a.r - b.r) <= TOLERANCE, "rotations differ by {:e}", largest(a.r - b.r));
    let error = largest(a.p - b.p) / length.max(f64::MIN_POSITIVE);
    assert!(error <= TOLERANCE, "positions differ by {error:e} of {length}");
}

/// Asserts equal matrices relative to `scale`.
#[track_caller]
fn assert_close(a: &Matrix6<f64>, b: &Matrix6<f64>, scale: f64) {
    let error = largest(a - b) / scale;
    assert!(error <= TOLERANCE, "relative error {error:e}");
}

#[test]
fn group_laws() {
    for ((a, b), c) in motions(1).zip(motions(2)).zip(motions(3)) {
        let length = a.p.norm() + b.p.norm() + c.p.norm();
        assert_same(&((a * b) * c), &(a * (b * c)), length);
        assert_eq!(a * Se3::identity(), a);
        assert_eq!(Se3::identity() * a, a);
        assert_same(&(a * a.inverse()), &Se3::identity(), length);
        assert_same(&(a.inverse() * a), &Se3::identity(), length);
        assert_same(&(a * b).inverse(), &(b.inverse() * a.inverse()), length);
    }
}

#[test]
fn rotations_are_orthonormal() {
    for xi in random_twists(4, 8.0 * PI).chain(twists_to_pi(5)) {
        let r = so3::exp(&se3::split(&xi).0);
        assert!(largest(r * r.transpose() - Matrix3::identity()) <= TOLERANCE);
        assert!((r.determinant() - 1.0).abs() <= TOLERANCE);
    }
}

#[test]
fn adjoint_is_a_homomorphism() {
    assert_eq!(adjoint(&Se3::identity()), Matrix6::identity());
    for (a, b) in motions(6).zip(motions(7)) {
        let scale = 1.0 + a.p.norm() + b.p.norm();
        assert_close(&(adjoint(&a) * adjoint(&b)), &adjoint(&(a * b)), scale);
        assert_close(&(adjoint(&a) * adjoint(&a.inverse())), &Matrix6::identity(), scale);
    }
}

#[test]
fn adjoint_carries_exponentials_and_brackets() {
    for (g, xi) in motions(8).zip(random_twists(9, 2.0 * PI)) {
        let carried = adjoint(&g) * xi;
        let length = g.p.norm() + xi.norm() + carried.norm();
        assert_same(&(g * se3::exp(&xi) * g.inverse()), &se3::exp(&carried), length);
        let scale = (1.0 + g.p.norm()) * (1.0 + xi.norm()) * (1.0 + g.p.norm());
        assert_close(&(adjoint(&g) * ad(&xi) * adjoint(&g.inverse())), &ad(&carried), scale);
    }
    for (a, b) in random_twists(10, PI).zip(random_twists(11, PI)) {
        assert!(largest(ad(&a) * b + ad(&b) * a) <= TOLERANCE * a.norm() * b.norm());
    }
}

#[test]
fn exponential_is_additive_along_a_twist() {
    for xi in random_twists(12, PI) {
        let length = xi.norm();
        assert_same(&(se3::exp(&(xi * 0.25)) * se3::exp(&(xi * 1.5))), &se3::exp(&(xi * 1.75)), length);
        assert_same(&se3::exp(&-xi), &se3::exp(&xi).inverse(), length);
    }
}

#[test]
fn logarithm_inverts_exponential() {
    for xi in twists_to_pi(13) {
        let (w, v) = se3::split(&xi);
        let g = se3::exp(&xi);
        let (mut w_back, mut v_back) = se3::split(&se3::log(&g));
        // Rounded to f64, R does not tell the two half turns apart.
        if w.norm() > PI - 1e-15 && w_back.dot(&w) < 0.0 {
            w_back = -w_back;
            v_back = so3::left_jacobian_inverse(&w_back) * g.p;
        }
        assert!(largest(w_back - w) <= TOLERANCE * w.norm(), "|w| = {:e}: {w_back} {w}", w.norm());
        assert!(largest(v_back - v) <= TOLERANCE * v.norm(), "|w| = {:e}: {v_back} {v}", w.norm());
    }
}

#[test]
fn exponential_inverts_logarithm() {
    let near_pi = twists_to_pi(14).into_iter().map(|xi| se3::exp(&xi));
    let past_pi = (3..=15).map(|k| {
        let mut rng = ChaCha8Rng::seed_from_u64(k);
        se3::exp(&twist(&mut rng, PI + 10.0_f64.powi(-(k as i32))))
    });
    for g in motions(15).chain(near_pi).chain(past_pi) {
        let xi = se3::log(&g);
        assert!(se3::split(&xi).0.norm() <= PI * (1.0 + 4.0 * f64::EPSILON));
        // log takes the rounding of R for a part of w, and p comes back through J(w) of that w.
        assert_same(&se3::exp(&xi), &g, g.p.norm());
    }
}

/// A product knows its rotation to the rounding of 1, however small the rotation itself.
#[test]
fn logarithm_of_a_product_is_accurate_to_its_condition() {
    for (xi, exponent) in random_twists(16, 2.0).zip((1..=18).cycle()) {
        let small = xi * 10.0_f64.powi(-exponent);
        let product = se3::exp(&xi) * se3::exp(&small) * se3::exp(&-xi);
        let expected = adjoint(&se3::exp(&xi)) * small;
        let (w, v) = se3::split(&(se3::log(&product) - expected));
        let length = se3::split(&xi).1.norm();
        let bound = 8.0 * f64::EPSILON;
        assert!(largest(w) <= bound && largest(v) <= bound * (1.0 + length), "{w} {v} {length}");
    }
}

#[test]
fn exact_half_turns() {
    for i in 0..3 {
        let axis = Vector3::ith(i, 1.0);
        let r = axis * axis.transpose() * 2.0 - Matrix3::identity();
        assert_eq!(so3::log(&r).abs(), axis * PI);
    }
    let mut rng = ChaCha8Rng::seed_from_u64(17);
    for _ in 0..SAMPLES {
        let axis = unit(&mut rng);
        // Symmetric to the last bit, so that nothing but the symmetric part can give the axis.
        let r = axis * axis.transpose() * 2.0 - Matrix3::identity();
        assert_eq!(r, r.transpose());
        let w = so3::log(&r);
        assert!(largest(w * axis.dot(&w).signum() - axis * PI) <= TOLERANCE * PI);
    }
}

#[test]
fn jacobians_and_their_inverses() {
    let tiny = twists_to_pi(18);
    for xi in random_twists(19, 1.5 * PI).chain(tiny) {
        let (a, inverse) = (se3::left_jacobian(&xi), se3::left_jacobian_inverse(&xi));
        // |J^-1| is at most 3.4 up to 1.5 pi, and the coupling has it on both sides.
        let scale = (1.0 + se3::split(&xi).1.norm()) * 3.4;
        assert_close(&(a * inverse), &Matrix6::identity(), scale);
        assert_close(&(inverse * a), &Matrix6::identity(), scale);
    }
    for xi in random_twists(20, 8.0 * PI).chain(twists_to_pi(21)) {
        let scale = 1.0 + se3::split(&xi).1.norm();
        let a = se3::left_jacobian(&xi);
        assert_close(&(adjoint(&se3::exp(&-xi)) * a), &se3::left_jacobian(&-xi), scale);
        assert_close(&(adjoint(&se3::exp(&xi)) * se3::right_jacobian(&xi)), &a, scale);
        // A and ad commute, and A ad = Ad(exp) - I: the defining property without a series.
        let difference = adjoint(&se3::exp(&xi)) - Matrix6::identity();
        assert_close(&(a * ad(&xi)), &difference, scale * (1.0 + se3::split(&xi).0.norm()));
    }
}

#[test]
fn left_jacobian_against_finite_differences() {
    let step = 1e-5;
    for xi in random_twists(22, 3.0 * PI) {
        let (a, inverse) = (se3::left_jacobian(&xi), se3::exp(&xi).inverse());
        for k in 0..6 {
            let mut forward = xi;
            forward[k] += step;
            let mut backward = xi;
            backward[k] -= step;
            let to = |xi: &Twist| se3::log(&(se3::exp(xi) * inverse));
            let difference = (to(&forward) - to(&backward)) / (2.0 * step);
            // Truncation h^2 / 6 and rounding eps / h, about 2e-11 each.
            assert!(largest(difference - a.column(k)) <= 2e-10 * (1.0 + xi.norm()));
        }
    }
}

#[test]
fn non_finite_input_gives_non_finite_output() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for k in 0..6 {
            let mut xi = Twist::repeat(0.1);
            xi[k] = bad;
            assert!(!se3::exp(&xi).is_finite());
            let _ = (se3::left_jacobian(&xi), se3::left_jacobian_inverse(&xi));
        }
        // One motion for each branch of the logarithm.
        for (i, size) in (0..12).flat_map(|i| [(i, 0.1), (i, 1.5)]) {
            let mut g = se3::exp(&Twist::repeat(size));
            *(if i < 9 { &mut g.r[i] } else { &mut g.p[i - 9] }) = bad;
            assert!(!g.is_finite());
            assert!(se3::log(&g).iter().any(|x| !x.is_finite()), "{g:?}");
        }
        assert!(so3::log(&Matrix3::repeat(bad)).iter().any(|x| !x.is_finite()));
    }
}

#[test]
fn twist_parts() {
    let (w, v) = (Vector3::new(0.1, 0.2, 0.3), Vector3::new(4.0, 5.0, 6.0));
    assert_eq!(se3::split(&se3::join(&w, &v)), (w, v));
    assert_eq!(so3::hat(&w) * v, w.cross(&v));
    assert_eq!(Se3::from_rotation_vector(v, &w), Se3 { r: so3::exp(&w), p: v });
    assert_eq!(se3::exp(&Twist::zeros()), Se3::identity());
    assert_eq!(se3::log(&Se3::identity()), Twist::zeros());
    assert!(Se3::identity().is_finite());
}
