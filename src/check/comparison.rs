//! Readings that are less than poses, against what the drawing predicts.

use crate::calibration::{Postures, Sample};
use crate::identify::run::placed;
use crate::measure::Errors;
use crate::model::{Geometry, Mechanism};
use crate::simulate::draw_deviations;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Machines drawn from the tolerances.
const MACHINES: u64 = 24;
/// Samples that each of them measures.
const LOOKED_AT: usize = 40;
/// The worst of a few machines is not the worst of all.
const MARGIN: f64 = 1.3;

type Part = fn(&Errors) -> Option<f64>;

/// Positions of targets among them.
pub const POSITION: &str = "position";

/// What is compared, whether it is an angle, and where it stands among the errors of a sample.
const PARTS: [(&str, bool, Part); 6] = [
    (POSITION, false, |e| e.position),
    ("rotation", true, |e| e.rotation),
    ("distance", false, |e| e.distance),
    ("height above a plane", false, |e| e.plane),
    ("passive joint (angle)", true, |e| e.joint_angle),
    ("passive joint (length)", false, |e| e.joint_length),
];

/// Errors of one kind.
#[derive(Clone, Debug, PartialEq)]
pub struct Compared {
    /// What was read.
    pub what: &'static str,
    /// Whether it is an angle.
    pub angular: bool,
    /// Name of each sample and its error, rad or m, the worst first.
    pub errors: Vec<(String, f64)>,
    /// The largest error that machines within the tolerances and the noise show, rad or m; what is free counts as drawn.
    pub explained: f64,
}

impl Compared {
    /// The middle error, rad or m.
    pub fn median(&self) -> f64 {
        self.errors.get(self.errors.len() / 2).map_or(0.0, |(_, error)| *error)
    }
}

/// Errors of the samples by kind, the machine's free ends and what is unknown of the instrument placed by them; and the
/// names of the samples whose loops do not close as drawn.
pub fn compared(mechanism: &Mechanism, samples: &[Sample]) -> (Vec<Compared>, Vec<String>) {
    let placed = placed(mechanism, samples).map_or_else(|| mechanism.clone(), |found| found.machine);
    let geometry = placed.nominal();
    let mut postures = Postures::new(&placed);
    let (mut all, mut open) = (Vec::new(), Vec::new());
    for sample in samples {
        match sample.close_all(&placed, &geometry, &mut postures) {
            Ok(()) => {
                let errors = sample.measurement.error(&postures.view(sample, &geometry));
                all.push((sample.name.clone(), errors));
            }
            Err(_) => open.push(sample.name.clone()),
        }
    }
    let explained = explained(&placed, &geometry, samples);
    let kind = |(k, (what, angular, part)): (usize, (&'static str, bool, Part))| {
        let of = all.iter().filter_map(|(name, errors)| Some((name.clone(), part(errors)?)));
        let mut errors: Vec<(String, f64)> = of.collect();
        errors.sort_by(|a, b| b.1.total_cmp(&a.1));
        (!errors.is_empty()).then_some(Compared { what, angular, errors, explained: explained[k] })
    };
    (PARTS.into_iter().enumerate().filter_map(kind).collect(), open)
}

/// Largest error of each of [`PARTS`] between the drawing and what machines within the tolerances would read, with
/// noise, where the samples were taken.
fn explained(mechanism: &Mechanism, nominal: &Geometry, samples: &[Sample]) -> [f64; PARTS.len()] {
    let machines: Vec<Geometry> =
        (0..MACHINES).map(|seed| mechanism.deviated(&draw_deviations(mechanism, seed, 1.0))).collect();
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let mut largest = [0.0_f64; PARTS.len()];
    let (mut drawn, mut true_one) = (Postures::new(mechanism), Postures::new(mechanism));
    for sample in samples.iter().step_by(samples.len().div_ceil(LOOKED_AT).max(1)) {
        if sample.close_all(mechanism, nominal, &mut drawn).is_err() {
            continue;
        }
        for machine in &machines {
            if sample.close_all(mechanism, machine, &mut true_one).is_err() {
                continue;
            }
            let read = sample.measurement.expected(&true_one.view(sample, machine));
            let read = read.perturbed(&mut || StandardNormal.sample(&mut rng));
            let errors = read.error(&drawn.view(sample, nominal));
            for (largest, (_, _, part)) in largest.iter_mut().zip(PARTS) {
                *largest = part(&errors).filter(|e| e.is_finite()).map_or(*largest, |e| largest.max(e));
            }
        }
    }
    largest.map(|error| MARGIN * error)
}
