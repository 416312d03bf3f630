//! The report of one identification: its summary for people.

use super::details::{digits, instrument, largest, mounts, other_errors, unused};
use super::wording::counted;
use crate::calibration::SetAside;
use crate::files::ProblemFile;
use crate::identify::{
    CrossValidation, Fit, Identification, Judgement, MeasuredElsewhere, Mounts, NoiseEstimate,
    PostureNoiseEstimate, UndecidedPosture,
};
use crate::model::Prior;
use crate::render;
use crate::solve::Identifier;

/// Everything that a report is made of.
pub struct Summary<'a> {
    /// The problem.
    pub problem: &'a ProblemFile,
    /// What was found.
    pub found: &'a Identification,
    /// Prediction of the hold-out by nominal and result.
    pub holdout: (Option<Fit>, Option<Fit>),
    /// Hold-out postures that do not close with the result.
    pub holdout_set_aside: Vec<SetAside>,
    /// Number of samples whose readings repeat an earlier one's.
    pub repeated: usize,
    /// How many training samples repeat another number by number.
    pub copies: usize,
    /// Samples that are in the hold-out as well as in the training.
    pub shared: Vec<String>,
    /// Samples of weight 0, as the result predicts them; `None` where they do not close.
    pub unused: Vec<(String, Option<Fit>)>,
    /// Readings outside the ranges that the drawing states, by actuator.
    pub out_of_range: Vec<String>,
    /// Noise, where it was estimated.
    pub noise: Option<NoiseEstimate>,
    /// What the tests of the residual say.
    pub judgement: Judgement,
    /// Postures that predictions miss.
    pub elsewhere: Vec<MeasuredElsewhere>,
    /// Postures that were closed in one of two ways.
    pub undecided: Vec<UndecidedPosture>,
    /// What the samples of a posture have in common, where it was estimated.
    pub common: Option<PostureNoiseEstimate>,
    /// Prediction of postures without them, where it was asked for.
    pub cross_validation: Option<CrossValidation>,
    /// Where free ends were found.
    pub mounts: Mounts,
    /// The identifier.
    pub identifier: &'a dyn Identifier,
    /// Part of the samples held out by choice, and the seed of the choice.
    pub chosen: Option<(f64, u64)>,
}

impl Summary<'_> {
    /// Errors before and after; a run that failed and stayed where it began has no after.
    pub(super) fn reached(&self, pair: (Option<Fit>, Option<Fit>)) -> (Option<Fit>, Option<Fit>) {
        let stayed = !self.found.report.outcome.converged() && self.found.fit.0 == self.found.fit.1;
        (pair.0, pair.1.filter(|_| !stayed))
    }

    /// Postures and samples that took part.
    pub(super) fn taking_part(&self) -> (usize, usize) {
        self.found.fit.1.map_or((0, 0), |fit| (fit.postures, fit.samples))
    }

    /// Deviation components with a stated tolerance, beside placement and tool mounting: in tolerances, in rad or m, index, axis, and the link's name.
    pub(super) fn components(&self) -> Vec<(f64, f64, usize, usize, String)> {
        let mut components = Vec::new();
        let mut index = 0;
        let deviations = self.mounts.beside(&self.found.deviations);
        for limb in &self.found.start.limbs {
            for link in &limb.links {
                for i in 0..6 {
                    let prior = if i < 3 { link.tolerance.angle } else { link.tolerance.length };
                    if let (Prior::Sigma(sigma), Some(&d)) = (prior, deviations.get(index)) {
                        components.push((d / sigma, d, index, i, format!("{}.{}", limb.name, link.name)));
                    }
                    index += 1;
                }
            }
        }
        components
    }

    /// The largest deviation in tolerances, and its link.
    pub(super) fn farthest(&self) -> Option<(f64, String)> {
        let all = self.components().into_iter().map(|(ratio, _, _, _, name)| (ratio.abs(), name));
        all.filter(|(ratio, _)| ratio.is_finite()).max_by(|a, b| a.0.total_cmp(&b.0))
    }
}

/// What the samples of a posture have in common, in words and units of the file.
pub(super) fn common_words(of: &Summary<'_>) -> String {
    let units = of.problem.units;
    let noise = of.common.map(|common| common.noise).unwrap_or_default();
    let part = |v: f64, unit: &str| (v > 0.0).then(|| format!("{} {unit}", render::text::digits(v, 2)));
    let parts: Vec<String> = [
        part(units.from_metres(noise.length), units.length_symbol()),
        part(units.from_radians(noise.angle), units.angle_symbol()),
    ]
    .into_iter()
    .flatten()
    .collect();
    format!(
        "the samples of a posture share an error of about {} at the tool point, estimated from them",
        parts.join(" and ")
    )
}

/// The summary for people.
pub fn summary(of: &Summary<'_>) -> String {
    let (found, problem) = (of.found, of.problem);
    let (length, angle) = (problem.units.length_symbol(), problem.units.angle_symbol());
    let mechanism = &problem.mechanism;
    let (r, p) = mechanism.joint_counts();
    let (postures, samples) = of.taking_part();
    let counts = match postures == samples {
        true => counted(postures, "posture"),
        false => format!("{}, {}", counted(postures, "posture"), counted(samples, "sample")),
    };
    let mut text = format!(
        "{}: {}, {r} angular and {p} prismatic joints, {} actuated\n{}, {}; {}: {} ({})\n\n",
        problem.name,
        counted(mechanism.limbs.len(), "limb"),
        mechanism.actuator_count(),
        counts,
        counted(found.rows, "reading"),
        found.report.identifier,
        found.report.outcome,
        counted(found.trace.len(), "iteration"),
    );
    if let Some(counts) = found.counts() {
        let nominal = found.nominal.as_ref().map_or(counts, |v| v.counts);
        text.push_str(&format!(
            "parameters  structural {}, first order {} at nominal and {} at the solution, practical {}\n",
            counts.structural, nominal.first_order, counts.first_order, counts.practical
        ));
    }
    if let Some(noise) = of.noise {
        let shown = |value: Option<f64>, unit: &str| value.map(|v| format!("{} {unit}", digits(v)));
        let parts = [
            shown(noise.angle.map(|v| problem.units.from_radians(v)), angle),
            shown(noise.length.map(|v| problem.units.from_metres(v)), length),
        ];
        let parts: Vec<String> = parts.into_iter().flatten().collect();
        text.push_str(&format!(
            "noise       none stated; estimated from the residual: {}\n",
            parts.join(", ")
        ));
    }
    if let Some(common) = of.common {
        text.push_str(&format!(
            "postures    {}; by chance alone with probability {}\n",
            common_words(of),
            digits(common.probability)
        ));
    }
    text.push_str(&format!(
        "\n{:20} {:>12} {:>12} {:>12} {:>12} {:>9}\n",
        "error",
        format!("rms/{length}"),
        format!("max/{length}"),
        format!("rms/{angle}"),
        format!("max/{angle}"),
        "in noise"
    ));
    let metres = |v: Option<f64>| v.map_or("-".into(), |v| digits(problem.units.from_metres(v)));
    let radians = |v: Option<f64>| v.map_or("-".into(), |v| digits(problem.units.from_radians(v)));
    let (before, after) = ("before", "after");
    let line = |name: &str, when: &str, fit: Fit| {
        format!(
            "{:10} {:9} {:>12} {:>12} {:>12} {:>12} {:>9}\n",
            name,
            when,
            metres(fit.position.map(|p| p.rms)),
            metres(fit.position.map(|p| p.max)),
            radians(fit.rotation.map(|r| r.rms)),
            radians(fit.rotation.map(|r| r.max)),
            digits(fit.weighted_rms),
        )
    };
    let none = |when: &str| format!("{0:10} {when:9}{1:>13}{1:>13}{1:>13}{1:>13}{1:>10}\n", "", "-");
    for (name, pair) in [("training", of.reached(found.fit)), ("hold-out", of.reached(of.holdout))] {
        if pair.0.or(pair.1).is_some() {
            text.push_str(&pair.0.map_or_else(|| none(before), |fit| line(name, before, fit)));
            text.push_str(&pair.1.map_or_else(|| none(after), |fit| line("", after, fit)));
        }
    }
    if let Some(cross) = of.cross_validation {
        text.push_str(&line("left out", after, cross.fit));
    }
    if let Some(cross) = of.cross_validation {
        text.push_str(&format!(
            "left out: each posture predicted without it, {} folds{}\n",
            cross.folds,
            match cross.refitted {
                0 => ", by the influence matrix".to_owned(),
                again if again == cross.folds => ", identified again for each".to_owned(),
                again => format!(", {again} of them identified again, the others by the influence matrix"),
            }
        ));
    }
    text.push_str(&of.residual_line());
    text.push_str(&super::tolerances::line(of));
    text.push_str(&mounts(of));
    text.push_str(&unused(of));
    text.push_str(&other_errors(of));
    text.push_str(&instrument(of));
    text.push_str(&largest(of));
    text
}
