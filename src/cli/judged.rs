//! What the tests of the residual say, in words and for the result file.

use super::details::{SHOWN, digits};
use super::summary::Summary;
use super::wording::counted;
use crate::calibration::Sample;
use crate::files::summary::{CauseEntry, ChiSquare, GroupEntry};
use crate::files::{DataSet, ProblemFile, Units};
use crate::identify::verdict::{Cause, NamedOutlier, RowCause, chi_square};
use std::collections::HashMap;

/// Identifier that weighs postures less that stand out.
const ROBUST: &str = "conic-huber";

/// The set of each of these samples of a problem; empty where there is one set.
pub(super) fn sets_of(problem: &ProblemFile, samples: &[Sample]) -> Vec<usize> {
    let all: &[DataSet] = &problem.data.sets;
    let names: HashMap<&str, usize> = all
        .iter()
        .enumerate()
        .flat_map(|(set, data)| data.samples.iter().map(move |sample| (sample.name.as_str(), set)))
        .collect();
    samples.iter().map(|sample| names.get(sample.name.as_str()).copied().unwrap_or(0)).collect()
}

impl Summary<'_> {
    /// The line about the residual; nothing where nothing was tested.
    pub(super) fn residual_line(&self) -> String {
        if self.noise.is_some() {
            return "\nresidual    it defines the noise here, so that there is nothing to test it against\n"
                .into();
        }
        let (Some(test), Some(sentence)) = (self.judgement.total, self.judgement.sentence()) else {
            return String::new();
        };
        format!(
            "\nresidual    chi-square {} for {} degrees of freedom (probability {}): {sentence}\n",
            digits(test.value),
            digits(test.degrees_of_freedom),
            chi_square::probability(test.probability),
        )
    }

    /// The tests for the result file.
    pub(super) fn chi_square(&self) -> Option<ChiSquare> {
        let (value, degrees_of_freedom) = self.found.chi_square()?;
        let judgement = &self.judgement;
        let group = |test: &crate::identify::verdict::GroupTest| GroupEntry {
            name: test.name.clone(),
            value: test.value,
            degrees_of_freedom: test.degrees_of_freedom,
        };
        let cause = |cause: &Cause| CauseEntry { kind: cause.kind().into(), text: cause.sentence() };
        Some(ChiSquare {
            value,
            degrees_of_freedom,
            probability: judgement.total.map(|test| test.probability),
            verdict: judgement.total.and_then(|_| judgement.sentence()),
            birge_ratio: judgement.birge_ratio(),
            groups: if judgement.total.is_some() {
                judgement.groups.iter().map(group).collect()
            } else {
                Vec::new()
            },
            causes: judgement.causes.iter().map(cause).collect(),
            holdout: judgement.holdout.filter(|_| self.noise.is_none()).map(|test| GroupEntry {
                name: "hold-out".into(),
                value: test.value,
                degrees_of_freedom: test.degrees_of_freedom,
            }),
        })
    }

    /// Whether postures that stand out led the identifier astray, so that what it found means nothing.
    pub(super) fn is_led_astray(&self) -> bool {
        !self.found.report.outcome.converged() && !self.judgement.outliers.is_empty()
    }

    /// What the tests say, as far as it deserves attention.
    pub(super) fn judgement_warnings(&self) -> Vec<String> {
        let judgement = &self.judgement;
        let mut warnings = Vec::new();
        if !judgement.outliers.is_empty() {
            let worst = judgement.outliers.iter().take(SHOWN);
            let names: Vec<String> = worst.map(|named| outlier(named, self.problem.units)).collect();
            let count = judgement.outliers.len();
            let (postures, verb) =
                (counted(count, "posture"), if count == 1 { "stands out" } else { "stand out" });
            let astray = match (self.is_led_astray(), self.found.report.identifier) {
                (false, _) => String::new(),
                (true, identifier) => format!(
                    " and {} {identifier} astray; correct or remove {}, or use --solver {ROBUST}, which weighs {} less",
                    if count == 1 { "leads" } else { "lead" },
                    if count == 1 { "it" } else { "them" },
                    if count == 1 { "it" } else { "them" },
                ),
            };
            let without = judgement.causes.iter().find_map(|cause| match cause {
                Cause::Outliers(found) => found.without,
                _ => None,
            });
            let without = without.map_or(String::new(), |test| {
                format!(
                    "; without {} chi-square is {} for {} degrees of freedom (probability {})",
                    if count == 1 { "it" } else { "them" },
                    digits(test.value),
                    digits(test.degrees_of_freedom),
                    chi_square::probability(test.probability)
                )
            });
            warnings.push(format!("{postures} {verb}{astray}: {}{without}", names.join(", ")));
        }
        let only_outliers = matches!(judgement.causes.as_slice(), [Cause::Outliers(_)]);
        if self.noise.is_none() && judgement.total.is_some() && self.found.report.outcome.converged() {
            warnings.extend(judgement.sentence().filter(|_| !judgement.is_clean() && !only_outliers));
            if let Some(ratio) = judgement.birge_ratio() {
                warnings.push(format!(
                    "standard errors suppose the stated noise: as things are they are too small; scaled_std of the \
                     result has them for {ratio:.3} times that noise"
                ));
            }
        } else {
            let causes = judgement.causes.iter().filter(|cause| !matches!(cause, Cause::Outliers(_)));
            warnings.extend(causes.filter(|_| self.noise.is_some()).map(Cause::sentence));
        }
        let far =
            judgement.holdout.filter(|test| test.contradicts() && self.found.report.outcome.converged());
        warnings.extend(far.map(|test| test.sentence()));
        warnings
    }
}

/// A posture that stands out, and what explains it, in units of the file.
pub(super) fn outlier(named: &NamedOutlier, units: Units) -> String {
    let NamedOutlier { outlier, cause } = named;
    let why = match cause {
        RowCause::Reading { joint, angular, amount } => {
            let shown = match angular {
                true => format!("{} {}", digits(units.from_radians(*amount)), units.angle_symbol()),
                false => format!("{} {}", digits(units.from_metres(*amount)), units.length_symbol()),
            };
            format!("; a reading of {joint} wrong by {shown} explains it")
        }
        RowCause::Readings => "; wrong readings of actuators explain it".into(),
        RowCause::Measured => "; no readings of the actuators explain what was measured".into(),
        RowCause::Unknown => String::new(),
    };
    format!("{} ({} times the noise{why})", outlier.name, digits(outlier.weighted_rms))
}
