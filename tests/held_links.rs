//! The structural count where links are held: the rank that machines which respect them can reach.

mod support;

use faer::Mat;
use gough::calibration::{Calibration, Coordinates, Sample};
use gough::files::{DataPlaces, read_problem};
use gough::linalg;
use gough::measure::Weights;
use gough::model::{Mechanism, Prior};
use gough::problem::{Form, Problem};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use support::*;

/// Serial and parallel machines of all kinds of joints.
const MACHINES: [&str; 12] = [
    "serial-puma560",
    "serial-kuka-lbr",
    "serial-scara",
    "serial-scara-screw",
    "serial-stanford",
    "hexapod-6ups",
    "hexapod-6pus",
    "hexapod-6rus",
    "hexapod-ballscrew",
    "tripod-3rps",
    "tripod-3prs",
    "tricept",
];

/// Singular values of the un-whitened Jacobian, all components in rad and machine sizes, at a machine that deviates by a
/// tenth wherever it may, or by less where most of the postures do not close there.
fn values_at_random(machine: &Mechanism, samples: &[Sample], random: &mut ChaCha8Rng) -> Vec<f64> {
    let sizes = [0.1, 0.05, 0.02, 0.01];
    let found = sizes.iter().find_map(|size| values_at(machine, samples, *size, &mut random.clone()));
    found.unwrap_or_else(|| panic!("most postures do not close"))
}

fn values_at(
    machine: &Mechanism,
    samples: &[Sample],
    size: f64,
    random: &mut ChaCha8Rng,
) -> Option<Vec<f64>> {
    let length = machine.characteristic_length();
    let mut at = Vec::new();
    let mut scales = Vec::new();
    for link in machine.limbs.iter().flat_map(|limb| &limb.links) {
        for (prior, unit) in [(link.tolerance.angle, 1.0), (link.tolerance.length, length)] {
            for _ in 0..3 {
                let deviation = size * unit * random.random_range(-1.0..1.0);
                at.push(if prior == Prior::Held { 0.0 } else { deviation });
                if prior != Prior::Held {
                    scales.push(unit);
                }
            }
        }
    }
    let unit = |s: &Sample| Sample { measurement: s.measurement.reweighted(Weights::Unit), ..s.clone() };
    let samples: Vec<Sample> = samples.iter().map(unit).collect();
    let problem = Calibration::new(machine, &samples, Form::Plain, &at);
    // A limb of a hexapod has one row a posture.
    if 4 * problem.sample_count() < 3 * samples.len() {
        return None;
    }
    let mut jac: Mat<f64> = problem.compress(&problem.coordinates().nearest(&at)).unwrap().jac;
    for (j, scale) in scales.iter().enumerate() {
        jac.as_mut().col_mut(j).iter_mut().for_each(|v| *v *= scale);
    }
    linalg::singular_values(jac.as_ref())
}

/// Counts of `patterns` random patterns of held links on every machine, against numerical rank.
fn compare(patterns: usize) {
    let mut undecided = 0;
    for (k, name) in MACHINES.iter().enumerate() {
        let path = file(&format!("problems/{name}.json"));
        let problem = read_problem(&path, &DataPlaces::from_environment(None)).unwrap();
        let mut random = ChaCha8Rng::seed_from_u64(k as u64);
        for pattern in 0..patterns {
            let mut machine = problem.mechanism.clone();
            let share = random.random_range(0.1..0.9);
            for link in machine.limbs.iter_mut().flat_map(|limb| &mut limb.links) {
                for prior in [&mut link.tolerance.angle, &mut link.tolerance.length] {
                    if random.random_bool(share) {
                        *prior = Prior::Held;
                    }
                }
            }
            if Coordinates::new(&machine, Form::Plain).count() == 0 {
                continue;
            }
            let count = Coordinates::new(&machine, Form::Minimal).structural_count(&machine);
            let values = values_at_random(&machine, &problem.data.samples, &mut random);
            // Without a gap of three decades at the count or elsewhere numbers do not decide.
            let rank = values.iter().filter(|v| **v > 1e-11 * values[0]).count();
            let gap = values.get(rank).map_or(f64::INFINITY, |next| values[rank - 1] / next);
            if gap < 1e3 {
                undecided += 1;
                continue;
            }
            assert_eq!(count, rank, "{name}, pattern {pattern}: {values:?}");
        }
    }
    assert!(undecided * 20 <= patterns * MACHINES.len(), "{undecided} not decided");
}

#[test]
fn counts_are_ranks() {
    compare(25);
}

/// Perfect universal and ball joints (no tolerance between their axes): counts are what deviated machines reach, and
/// nothing is promised that cannot appear.
#[test]
fn perfect_joints() {
    for (name, structural) in [("hexapod-6ups", 48), ("tripod-3rps", 33)] {
        let path = file(&format!("tests/data/cases/counts/ideal-joints-{name}.json"));
        let ran = done("analyze {0} --poses 80 --perturb 30 --seed 2 --json", &[&path]);
        let found: serde_json::Value = serde_json::from_str(&ran.stdout).unwrap();
        let count = |key: &str| found["counts"][key].as_u64().unwrap();
        assert_eq!((count("structural"), count("first_order")), (structural, structural), "{name}");
        assert_eq!(found["singular_values"].as_array().unwrap().len(), structural as usize);
        assert_eq!(found["no_first_order_effect"].as_array().unwrap().len(), 0);
        let sums = found["structural"].as_array().unwrap();
        assert_eq!(sums.iter().map(|sum| sum["count"].as_u64().unwrap()).sum::<u64>(), structural);
        // At the drawing some have no effect: as many are told in words, and none of them is one that never appears.
        let ran = done("analyze {0} --poses 80 --seed 2 --json", &[&path]);
        let nominal: serde_json::Value = serde_json::from_str(&ran.stdout).unwrap();
        let hidden = structural - nominal["counts"]["first_order"].as_u64().unwrap();
        let told: u64 = (nominal["no_first_order_effect"].as_array().unwrap().iter())
            .map(|entry| {
                entry["directions_each"].as_u64().unwrap()
                    * entry["limbs"].as_array().unwrap().len().max(1) as u64
            })
            .sum();
        assert_eq!(told, hidden, "{name}: {nominal}");
    }
}
