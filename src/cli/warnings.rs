//! What deserves attention in a result.

use super::details::{SHOWN, digits};
use super::summary::Summary;
use crate::identify::Verdict;

/// Tolerances beyond which a deviation is remarked on.
const FAR_OFF: f64 = 10.0;

impl Summary<'_> {
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
        if let Some(test) = self.test
            && self.noise.is_none()
            && found.report.outcome.converged()
            && test.verdict != Verdict::Explained
        {
            warnings.push(test.sentence());
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
