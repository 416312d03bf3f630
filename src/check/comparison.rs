//! Readings that are less than poses, against what the drawing predicts.

use crate::calibration::{Postures, Sample};
use crate::identify::run::placed;
use crate::measure::Errors;
use crate::model::Mechanism;

/// Errors of one kind.
#[derive(Clone, Debug, PartialEq)]
pub struct Compared {
    /// What was read.
    pub what: &'static str,
    /// Whether it is an angle.
    pub angular: bool,
    /// Name of each sample and its error, rad or m, the worst first.
    pub errors: Vec<(String, f64)>,
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
    type Part = fn(&Errors) -> Option<f64>;
    let parts: [(&'static str, bool, Part); 6] = [
        ("position", false, |e| e.position),
        ("rotation", true, |e| e.rotation),
        ("distance", false, |e| e.distance),
        ("height above a plane", false, |e| e.plane),
        ("passive joint (angle)", true, |e| e.joint_angle),
        ("passive joint (length)", false, |e| e.joint_length),
    ];
    let placed = placed(mechanism, samples).unwrap_or_else(|| mechanism.clone());
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
    let kind = |(what, angular, part): (&'static str, bool, Part)| {
        let of = all.iter().filter_map(|(name, errors)| Some((name.clone(), part(errors)?)));
        let mut errors: Vec<(String, f64)> = of.collect();
        errors.sort_by(|a, b| b.1.total_cmp(&a.1));
        (!errors.is_empty()).then_some(Compared { what, angular, errors })
    };
    (parts.into_iter().filter_map(kind).collect(), open)
}
