//! The report of one identification: the result file, and its summary for people.

use super::details::{digits, instrument, largest, other_errors};
use crate::files::noise::NoiseDrawing;
use crate::files::result::RESULT_FORMAT;
use crate::files::summary::{
    ActiveBoundEntry, BeforeAfter, ChiSquare, ConstantResult, Counts, Deviation, LinkResult, PoseErrors,
    SetAsideEntry, SourceEntry, TraceEntry, WeightEntry,
};
use crate::files::{ProblemFile, ResultFile, Units, from_quantity, redraw};
use crate::identify::{self, Fit, Identification, NoiseEstimate};
use crate::model::Prior;
use crate::solve::Identifier;

/// Deviations shown.
const SHOWN: usize = 5;
/// Standard deviations of chi-square beyond which it is remarked on.
const REMARKABLE: f64 = 3.0;

/// Everything that a report is made of.
pub struct Summary<'a> {
    /// The problem.
    pub problem: &'a ProblemFile,
    /// What was found.
    pub found: &'a Identification,
    /// Prediction of the hold-out by nominal and result.
    pub holdout: (Option<Fit>, Option<Fit>),
    /// Number of hold-out postures.
    pub held_out: usize,
    /// Readings outside the ranges that the drawing states, by actuator.
    pub out_of_range: Vec<String>,
    /// Noise, where it was estimated.
    pub noise: Option<NoiseEstimate>,
    /// The identifier.
    pub identifier: &'a dyn Identifier,
    /// Part of the samples held out by choice, and the seed of the choice.
    pub chosen: Option<(f64, u64)>,
}

impl From<identify::Counts> for Counts {
    fn from(counts: identify::Counts) -> Self {
        let identify::Counts { structural, first_order, practical } = counts;
        Self { structural, first_order, practical }
    }
}

fn errors(fit: Option<Fit>, units: Units) -> PoseErrors {
    let Some(fit) = fit else { return PoseErrors::default() };
    PoseErrors {
        position_rms: fit.position.map(|p| p.rms),
        position_max: fit.position.map(|p| p.max),
        rotation_rms: fit.rotation.map(|r| r.rms),
        rotation_max: fit.rotation.map(|r| r.max),
        distance_rms: fit.distance.map(|d| d.rms),
        distance_max: fit.distance.map(|d| d.max),
        plane_rms: fit.plane.map(|p| p.rms),
        plane_max: fit.plane.map(|p| p.max),
        joint_angle_rms: fit.joint_angle.map(|j| j.rms),
        joint_angle_max: fit.joint_angle.map(|j| j.max),
        joint_length_rms: fit.joint_length.map(|j| j.rms),
        joint_length_max: fit.joint_length.map(|j| j.max),
        weighted_rms: Some(fit.weighted_rms),
    }
    .in_units(units)
}

fn before_after(pair: (Option<Fit>, Option<Fit>), units: Units) -> Option<BeforeAfter> {
    (pair.0.is_some() || pair.1.is_some())
        .then(|| BeforeAfter { before: errors(pair.0, units), after: errors(pair.1, units) })
}

impl Summary<'_> {
    /// The result file.
    pub fn file(&self) -> ResultFile {
        let (found, units) = (self.found, self.problem.units);
        let report = &found.report;
        ResultFile {
            format: RESULT_FORMAT.into(),
            problem: self.problem.name.clone(),
            source: Some(SourceEntry {
                problem_file: self.problem.file.clone(),
                holdout: self.chosen.map(|chosen| chosen.0),
                seed: self.chosen.map(|chosen| chosen.1),
            }),
            solver: report.identifier.into(),
            settings: self.identifier.settings().into_iter().map(|(k, v)| (k.to_owned(), v)).collect(),
            converged: report.outcome.converged(),
            reason: report.outcome.to_string(),
            iterations: found.trace.len(),
            units,
            counts: found.counts().map(Counts::from).unwrap_or_default(),
            fit: before_after(found.fit, units),
            holdout: before_after(self.holdout, units),
            chi_square: found
                .chi_square()
                .map(|(value, degrees_of_freedom)| ChiSquare { value, degrees_of_freedom }),
            noise_estimate: self.noise.map(|noise| NoiseDrawing {
                angle: noise.angle.map(|v| units.from_radians(v)),
                length: noise.length.map(|v| units.from_metres(v)),
                covariance: None,
            }),
            warnings: self.warnings(),
            set_aside: found
                .set_aside
                .iter()
                .map(|s| SetAsideEntry { sample: s.name.clone(), reason: s.reason.to_string() })
                .collect(),
            active_bounds: report
                .active
                .iter()
                .map(|a| ActiveBoundEntry { name: a.name.clone(), limit: a.limit, multiplier: a.multiplier })
                .collect(),
            kkt: report.kkt,
            estimate: Some(report.estimate.into()),
            weights: report
                .weights
                .iter()
                .map(|w| WeightEntry { weight: w.weight, score: w.score })
                .collect(),
            singular_values: found.visibility.as_ref().map(|v| v.singular_values.clone()).unwrap_or_default(),
            trace: found
                .trace
                .iter()
                .map(|t| TraceEntry { cost: t.cost, step: t.step, kept: t.kept })
                .collect(),
            instrument: self.instrument(),
            links: self.links(),
            mechanism: redraw(&found.start, &found.geometry, units),
            versions: [("gough".to_owned(), env!("CARGO_PKG_VERSION").to_owned())].into(),
        }
    }

    fn links(&self) -> Vec<LinkResult> {
        let mut links = Vec::new();
        let names =
            self.found.start.limbs.iter().flat_map(|limb| limb.links.iter().map(|l| (&limb.name, &l.name)));
        for (k, (limb, link)) in names.enumerate() {
            let six = |of: &[f64]| of.get(6 * k..6 * k + 6).and_then(|s| <[f64; 6]>::try_from(s).ok());
            let Some(deviation) = six(&self.found.deviations) else { continue };
            let std = self.found.std.as_deref().and_then(six);
            links.push(LinkResult {
                limb: limb.clone(),
                link: link.clone(),
                deviation: Deviation::of(&deviation, self.problem.units),
                std: std.map(|std| Deviation::of(&std, self.problem.units)),
            });
        }
        links
    }

    /// The instrument's constants as identified.
    pub(super) fn instrument(&self) -> Vec<ConstantResult> {
        let (found, units) = (self.found, self.problem.units);
        let drawn = self.problem.mechanism.instrument.iter().enumerate();
        let first = found.start.link_component_count();
        let constants = drawn.zip(&found.geometry.instrument).map(|((k, constant), value)| {
            let shown = |v: f64| from_quantity(units, constant.quantity, v);
            ConstantResult {
                name: constant.name(),
                nominal: shown(constant.nominal),
                value: shown(*value),
                std: found.std.as_ref().and_then(|std| std.get(first + k)).map(|v| shown(*v)),
            }
        });
        constants.collect()
    }

    /// Deviation components with a stated tolerance: in tolerances, in rad or m, index, axis, and the link's name.
    pub(super) fn components(&self) -> Vec<(f64, f64, usize, usize, String)> {
        let mut components = Vec::new();
        let mut index = 0;
        for limb in &self.found.start.limbs {
            for link in &limb.links {
                for i in 0..6 {
                    let prior = if i < 3 { link.tolerance.angle } else { link.tolerance.length };
                    if let (Prior::Sigma(sigma), Some(&d)) = (prior, self.found.deviations.get(index)) {
                        components.push((d / sigma, d, index, i, format!("{}.{}", limb.name, link.name)));
                    }
                    index += 1;
                }
            }
        }
        components
    }

    /// The largest deviation in tolerances, and its link.
    fn farthest(&self) -> Option<(f64, String)> {
        let all = self.components().into_iter().map(|(ratio, _, _, _, name)| (ratio.abs(), name));
        all.filter(|(ratio, _)| ratio.is_finite()).max_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// What deserves attention.
    pub fn warnings(&self) -> Vec<String> {
        let found = self.found;
        let mut warnings = Vec::new();
        if !found.report.outcome.converged() {
            warnings.push(format!("not converged: {}", found.report.outcome));
        }
        if !found.set_aside.is_empty() {
            let names: Vec<&str> = found.set_aside.iter().map(|s| s.name.as_str()).collect();
            warnings.push(format!("{} postures took no part: {}", names.len(), names.join(", ")));
        }
        let left_out = |name: &str| found.set_aside.iter().any(|s| s.name == name);
        let at_start = found.set_aside_at_start.iter().map(|s| s.name.as_str());
        let taken_back: Vec<&str> = at_start.filter(|name| !left_out(name)).collect();
        if !taken_back.is_empty() {
            warnings.push(format!(
                "{} postures that the nominal machine cannot reach were set aside at first and taken back: {}",
                taken_back.len(),
                taken_back.join(", ")
            ));
        }
        let scored = self.holdout.1.map_or(0, |fit| fit.samples);
        if scored < self.held_out {
            warnings.push(format!(
                "{} of {} hold-out postures do not close with the result and are not scored",
                self.held_out - scored,
                self.held_out
            ));
        }
        if !self.out_of_range.is_empty() {
            warnings.push(format!(
                "readings outside the stated range of {}: are units, home and actuator order right?",
                self.out_of_range.join(", ")
            ));
        }
        if let Some((ratio, name)) = self.farthest().filter(|(ratio, _)| *ratio > FAR_OFF) {
            warnings.push(format!(
                "{name} is {} tolerances off: if that cannot be, check units, home, directions of axes, actuator \
                 order and how rotations are written",
                digits(ratio)
            ));
        }
        if !found.outliers.is_empty() {
            let worst = found.outliers.iter().take(SHOWN);
            let names: Vec<String> =
                worst.map(|o| format!("{} ({} times the noise)", o.name, digits(o.weighted_rms))).collect();
            warnings.push(format!("{} postures stand out: {}", found.outliers.len(), names.join(", ")));
        }
        let bounded = found.start.limbs.iter().flat_map(|limb| &limb.links).any(|link| link.bounds.is_some());
        if bounded && !self.identifier.settings().iter().any(|(key, _)| *key == "bounds") {
            warnings.push(format!(
                "the problem states bounds, which {} does not take: use conic-bounded",
                found.report.identifier
            ));
        }
        for near in &found.near_singular {
            warnings.push(format!(
                "{} is nearly singular: the wrench matrix has singular values {:.2e} to {:.2e}",
                near.name, near.singular_values[0], near.singular_values[5]
            ));
        }
        if !found.other_mode.is_empty() {
            warnings.push(format!(
                "{} postures were measured in another assembly mode than that of home, which predictions follow: {}",
                found.other_mode.len(),
                found.other_mode.join(", ")
            ));
        }
        warnings.extend(self.problem.data.kind_notes().into_iter().map(str::to_owned));
        if let Some(counts) = found.counts()
            && found.rows < counts.structural
        {
            warnings.push(format!(
                "{} readings for {} parameters: what they do not determine stays at nominal; \
                 measure at least {} more",
                found.rows,
                counts.structural,
                counts.structural - found.rows
            ));
        }
        if let (None, Some((value, freedom))) = (self.noise, found.chi_square())
            && found.report.outcome.converged()
            && freedom > 0.0
            && (value - freedom).abs() > REMARKABLE * (2.0 * freedom).sqrt()
        {
            let ratio = (value / freedom).sqrt();
            let why = if ratio > 1.0 {
                "noise understated, outliers, or errors that the model does not have"
            } else {
                "noise overstated"
            };
            warnings.push(format!("residuals are {} times the stated noise: {why}", digits(ratio)));
        }
        for bound in &found.report.active {
            warnings.push(format!(
                "{} is at its bound of {:.3} tolerances (multiplier {:.3e})",
                bound.name, bound.limit, bound.multiplier
            ));
        }
        warnings
    }
}

/// Tolerances beyond which a deviation is remarked on.
const FAR_OFF: f64 = 10.0;

/// The summary for people.
pub fn summary(of: &Summary<'_>) -> String {
    let (found, problem) = (of.found, of.problem);
    let (length, angle) = (problem.units.length_symbol(), problem.units.angle_symbol());
    let mechanism = &problem.mechanism;
    let (r, p) = mechanism.joint_counts();
    let taking_part = found.fit.1.map_or(0, |fit| fit.samples);
    let mut text = format!(
        "{}: {} limbs, {r} angular and {p} prismatic joints, {} actuated\n{} postures, {} readings; {}: {} after {} iterations\n\n",
        problem.name,
        mechanism.limbs.len(),
        mechanism.actuator_count(),
        taking_part,
        found.rows,
        found.report.identifier,
        found.report.outcome,
        found.trace.len(),
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
    for (name, when, fit) in [
        ("training", before, found.fit.0),
        ("", after, found.fit.1),
        ("hold-out", before, of.holdout.0),
        ("", after, of.holdout.1),
    ] {
        let Some(fit) = fit else { continue };
        text.push_str(&format!(
            "{:10} {:9} {:>12} {:>12} {:>12} {:>12} {:>9}\n",
            name,
            when,
            metres(fit.position.map(|p| p.rms)),
            metres(fit.position.map(|p| p.max)),
            radians(fit.rotation.map(|r| r.rms)),
            radians(fit.rotation.map(|r| r.max)),
            digits(fit.weighted_rms),
        ));
    }
    text.push_str(&other_errors(of));
    text.push_str(&instrument(of));
    text.push_str(&largest(of));
    text
}
