//! Profiles, intervals and regions against numbers worked out by hand.

use gough::calibration::representative::representative;
use gough::compare::profile::{Descent, data, evaluations_to, performance};
use gough::files::{DataPlaces, read_problem};
use gough::model::Mechanism;
use gough::simulate::{close, draw_deviations};
use gough::statistics::{middle, quantile, wilson};

const NEVER: f64 = f64::INFINITY;

/// Three problems, two solvers: times 1 and 2, 4 and 2, 3 and failure. Ratios of the first: 1, 2, 1; of the second: 2, 1
/// and never.
#[test]
fn performance_profile_of_dolan_and_more() {
    let profiles = performance(&[vec![1.0, 2.0], vec![4.0, 2.0], vec![3.0, NEVER]]);
    assert_eq!(profiles[0].steps, [(1.0, 2.0 / 3.0), (2.0, 1.0)]);
    assert_eq!(profiles[1].steps, [(1.0, 1.0 / 3.0), (2.0, 2.0 / 3.0)]);
    assert_eq!((profiles[1].at(0.5), profiles[1].at(1.9), profiles[1].at(1e9)), (0.0, 1.0 / 3.0, 2.0 / 3.0));
    // A problem that nobody solves still counts; equal costs, zero too, are both best.
    let profiles = performance(&[vec![NEVER, NEVER], vec![0.0, 0.0]]);
    assert_eq!(profiles[0].steps, [(1.0, 0.5)]);
    assert_eq!(profiles[1].steps, [(1.0, 0.5)]);
}

/// From 101 to 1 at best, a tenth of the way is 11, a hundredth 2: the first is there after 3 and 5 evaluations, the
/// second, which stays at 6, after 2 and never.
#[test]
fn data_profile_of_more_and_wild() {
    let first = Descent { falls: vec![(1.0, 101.0), (3.0, 9.0), (5.0, 1.0)] };
    let second = Descent { falls: vec![(1.0, 101.0), (2.0, 6.0)] };
    let runs = [first.clone(), second.clone()];
    assert_eq!(evaluations_to(&runs, 0.1), [3.0, 2.0]);
    assert_eq!(evaluations_to(&runs, 0.01), [5.0, NEVER]);
    let lost = Descent { falls: Vec::new() };
    let profiles = data(&[runs.to_vec(), vec![lost, second]], 0.1);
    assert_eq!(profiles[0].steps, [(3.0, 0.5)]);
    // On the second problem it is alone: from 101 to its own best of 6.
    assert_eq!(profiles[1].steps, [(2.0, 1.0)]);
}

/// Wilson's interval of 8 in 10 and of 0 in 10, as in Brown, Cai and DasGupta's formula, worked out with 40 digits.
#[test]
fn rates_and_medians() {
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} {b}");
    let z2 = 1.959963984540054_f64.powi(2);
    let (low, high) = wilson(8, 10);
    near(low, 0.490162471536642);
    near(high, 0.943317848545625);
    let (low, high) = wilson(0, 10);
    assert_eq!(low, 0.0);
    near(high, z2 / (10.0 + z2));
    assert_eq!(wilson(0, 0), (0.0, 1.0));
    assert_eq!(quantile(&[1.0, 2.0, 4.0, 8.0], 0.5), Some(3.0));
    assert_eq!(quantile(&[], 0.5), None);
    let of = middle([NEVER, 1.0, 3.0, 2.0, NEVER]).unwrap();
    assert_eq!((of.low, of.median, of.high), (2.0, 3.0, NEVER));
    assert!(middle([f64::NAN]).is_none());
}

/// A machine and its representative predict the same poses, although their deviations differ by whole tolerances; and
/// the representative of a representative is itself.
#[test]
fn the_representative_is_the_same_machine() {
    let places = DataPlaces { data_dir: None, shared: "no such folder".into() };
    for name in ["serial-puma560", "tripod-3rps", "serial-scara-screw", "hexapod-6ups"] {
        let problem = read_problem(format!("problems/{name}.json").as_ref(), &places).unwrap();
        let machine: &Mechanism = &problem.mechanism;
        let truth = machine.deviated(&draw_deviations(machine, 3, 1.0));
        let z = representative(machine, &truth);
        let coordinates = gough::calibration::Coordinates::new(machine, gough::problem::Form::Minimal);
        let same = machine.deviated(&coordinates.deviations(&z));
        let complete = gough::calibration::Coordinates::new(machine, gough::problem::Form::Complete);
        let size = |machine: &gough::model::Geometry, nominal| {
            complete.nearest(&machine.deviations_from(nominal)).iter().map(|u| u * u).sum::<f64>()
        };
        let nominal = machine.nominal();
        let (all, least) = (size(&truth, &nominal), size(&same, &nominal));
        assert!(least < 0.9 * all, "{name}: {least} of {all}");
        for sample in problem.data.samples.iter().take(10) {
            let [a, b] = [&truth, &same].map(|g| close(machine, g, &sample.actuators).unwrap().tool());
            assert!(
                (a.p - b.p).norm() < 1e-12 && (a.r - b.r).norm() < 1e-12,
                "{name}: {}",
                (a.p - b.p).norm()
            );
        }
        let again = representative(machine, &same);
        let apart = again.iter().zip(&z).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-9, "{name}: {apart}");
    }
}
