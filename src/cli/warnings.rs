//! What deserves attention after an identification, in words.

use super::details::{SHOWN, digits};
use super::elsewhere::{cure, undecided_words, words};
use super::summary::Summary;
use super::wording::{counted, listed};
use crate::files::{LengthUnit, ProblemFile};
use crate::identify::UndecidedSide;
use crate::identify::elsewhere::home_as_measured;
use crate::identify::run::NearSingular;
use crate::identify::untold::untold_words;
use crate::model::Prior;
use crate::model::far::far_points;
use crate::solve::{ActiveBound, Outcome};
use nalgebra::Vector3;

/// Tolerances beyond which a deviation is remarked on.
const FAR_OFF: f64 = 10.0;
/// Tolerances, in rad or machine sizes, beyond which they are loose.
const LOOSE: f64 = 0.03;

/// Sizes of machines that people build, m.
const SIZES: std::ops::Range<f64> = 0.003..60.0;

/// What to say of a machine of a size that nobody builds, as with mm in a file that says m.
pub fn doubtful_size(problem: &ProblemFile) -> Option<String> {
    let size = problem.mechanism.characteristic_length();
    let (stated, other) = match problem.units.length {
        LengthUnit::Metre => ("m", "mm"),
        LengthUnit::Millimetre => ("mm", "m"),
    };
    (!SIZES.contains(&size)).then(|| {
        format!(
            "the machine as drawn has a size of {size:.3} m: the file says {stated}, but its lengths look like {other}; \
             correct units.length"
        )
    })
}

/// What a tolerance of angle means at a point that is drawn far out along its axis, and where the point belongs.
pub fn far_drawn(problem: &ProblemFile) -> Option<String> {
    let far = far_points(&problem.mechanism);
    let units = problem.units;
    let length = |metres: f64| digits(units.from_metres(metres));
    let first = far.first()?;
    let places: Vec<String> = (far.iter())
        .map(|far| {
            let [x, y, z] = [far.foot.x, far.foot.y, far.foot.z].map(length);
            format!("{} to [{x}, {y}, {z}]", far.joint)
        })
        .collect();
    Some(format!(
        "the point of {} is drawn {} {} out along its axis: a tolerance of angle there moves the machine by that lever; \
         slide points along their axes to near the machine, which changes no motion: {}",
        first.joint,
        length(first.out),
        units.length_symbol(),
        listed(&places)
    ))
}

impl Summary<'_> {
    /// What deserves attention.
    pub fn warnings(&self) -> Vec<String> {
        let found = self.found;
        let mut warnings = Vec::new();
        let (_, samples) = self.taking_part();
        if !found.report.outcome.converged() {
            let hint = match found.report.outcome {
                _ if self.is_led_astray() => "",
                Outcome::OutOfIterations if self.is_loose() => {
                    "; tolerances far looser than the machine, or \"free\" links limb by limb, leave valleys that \
                     take many steps: state what is known"
                }
                Outcome::OutOfIterations => {
                    "; look for postures that stand out, and for mistakes of units, home and actuator order (gough check)"
                }
                _ => "",
            };
            warnings.push(format!("not converged: {}{hint}", found.report.outcome));
        }
        if !found.set_aside.is_empty() {
            let names: Vec<&str> = found.set_aside.iter().map(|s| s.name.as_str()).collect();
            let postures = counted(names.len(), self.word());
            warnings.push(format!("{postures} took no part: {}", names.join(", ")));
        }
        let left_out = |name: &str| found.set_aside.iter().any(|s| s.name == name);
        let at_start = found.set_aside_at_start.iter().map(|s| s.name.as_str());
        let taken_back: Vec<&str> = at_start.filter(|name| !left_out(name)).collect();
        if !taken_back.is_empty() {
            warnings.push(format!(
                "{} that the nominal machine cannot reach {} set aside at first and taken back: {}",
                counted(taken_back.len(), self.word()),
                if taken_back.len() == 1 { "was" } else { "were" },
                taken_back.join(", ")
            ));
        }
        if !self.holdout_set_aside.is_empty() {
            let names: Vec<&str> = self.holdout_set_aside.iter().map(|s| s.name.as_str()).collect();
            warnings.push(format!(
                "hold-out: {} not scored, whose loops do not close with the result: {}",
                counted(names.len(), self.word()),
                listed(&names)
            ));
        }
        if self.copies > 0 {
            warnings.push(format!(
                "{} repeat another of the same readings number by number, as it is or rounded: they are copies, which count as independent \
                 readings here and make standard errors too small; remove them",
                counted(self.copies, "sample")
            ));
        }
        if 2 * self.repeated > samples {
            warnings.push(format!(
                "{} of {} repeat the readings of another: they tell of the noise, not of the machine; measure other postures",
                self.repeated,
                counted(samples, "sample"),
            ));
        }
        if !self.shared.is_empty() {
            warnings.push(format!(
                "{} of the training stand in the hold-out, too, which then proves nothing of them: {}",
                counted(self.shared.len(), "sample"),
                listed(&self.shared)
            ));
        }
        warnings.extend(untold_words(&found.untold));
        let far = far_drawn(self.problem);
        if let Some(doubt) = doubtful_size(self.problem).filter(|_| far.is_none()) {
            warnings.push(doubt);
        }
        warnings.extend(far);
        if !self.out_of_range.is_empty() {
            warnings.push(format!(
                "readings outside the stated range of {}: are units, home and actuator order right?",
                self.out_of_range.join(", ")
            ));
        }
        // In tolerances that the deviations themselves do not contradict.
        let supported = found.tolerance_test.map_or(1.0, |test| test.in_force);
        let misled = self.is_led_astray() || self.judgement.is_spoiled();
        if let Some((ratio, name)) =
            self.farthest().filter(|(ratio, _)| *ratio > FAR_OFF * supported && !misled)
        {
            warnings.push(format!(
                "{name} is {} tolerances off: if that cannot be, check units, home, directions of axes, actuator \
                 order and how rotations are written (gough check)",
                digits(ratio)
            ));
        }
        warnings.extend(self.judgement_warnings());
        let bounded = found.start.limbs.iter().flat_map(|limb| &limb.links).any(|link| link.bounds.is_some());
        if bounded && !self.identifier.settings().iter().any(|(key, _)| *key == "bounds") {
            warnings.push(format!(
                "the problem states bounds, which {} does not take: use conic-bounded",
                found.report.identifier
            ));
        }
        let regularity = |near: &NearSingular| near.singular_values[5] / near.singular_values[0];
        let mut near: Vec<&NearSingular> = found.near_singular.iter().collect();
        near.sort_by(|a, b| regularity(a).total_cmp(&regularity(b)));
        if !near.is_empty() && !self.is_led_astray() {
            let worst = near.iter().take(SHOWN);
            let names: Vec<String> = worst
                .map(|n| format!("{} ({:.2e} to {:.2e})", n.name, n.singular_values[0], n.singular_values[5]))
                .collect();
            let what = if near.len() > 1 { "nearly singular, the worst" } else { "nearly singular" };
            warnings.push(format!(
                "{} {what} by the singular values of the wrench matrix: {}",
                counted(near.len(), self.word()),
                names.join(", ")
            ));
        }
        if !self.elsewhere.is_empty() && !self.is_led_astray() {
            let (of, units) = (found.taking.len(), self.problem.units);
            let mut text = words(&self.elsewhere, of, self.word(), units);
            if self.elsewhere.len() == of {
                text.push_str(&cure(home_as_measured(&found.start, &found.geometry, &found.taking), units));
            }
            warnings.push(text);
        }
        warnings.extend(self.undecided.iter().map(undecided_words));
        warnings.extend(found.sides.undecided.iter().map(|side| self.undecided(side)));
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
        warnings.extend(super::tolerances::warning(self));
        let mut active: Vec<&ActiveBound> = found.report.active.iter().collect();
        active.sort_by(|a, b| b.multiplier.total_cmp(&a.multiplier).then_with(|| a.name.cmp(&b.name)));
        for bound in active.iter().take(SHOWN) {
            warnings.push(format!(
                "{} is at its bound of {:.3} tolerances (multiplier {:.3e})",
                bound.name, bound.limit, bound.multiplier
            ));
        }
        if active.len() > SHOWN {
            let links: Vec<String> = (found.start.limbs.iter())
                .flat_map(|limb| limb.links.iter().map(|link| format!("{}.{}", limb.name, link.name)))
                .collect();
            let of_links = active.iter().skip(SHOWN).all(|bound| links.contains(&bound.name));
            let what = if of_links { "further link" } else { "further component" };
            let more = counted(active.len() - SHOWN, what);
            warnings.push(format!("{more} at their bounds, with smaller multipliers: see active_bounds"));
        }
        warnings
    }

    /// That a fixed point may stand on either side of the plane of its targets.
    fn undecided(&self, side: &UndecidedSide) -> String {
        let units = self.problem.units;
        let place = |p: &Vector3<f64>| {
            let shown: Vec<String> = p.iter().map(|v| digits(units.from_metres(*v))).collect();
            format!("[{}]", shown.join(", "))
        };
        format!(
            "the readings do not tell on which side of the plane of its targets {} stands: here at {}, or at {} {}, where \
             chi-square with deviations in tolerances is {} larger; its standard errors hold for this side only; measure \
             it from postures out of that plane, or state its position and tolerance",
            side.point,
            place(&side.here),
            place(&side.there),
            units.length_symbol(),
            digits(side.difference),
        )
    }

    /// What samples that are named one by one are called: where each is a posture of its own, a posture.
    fn word(&self) -> &'static str {
        let (postures, samples) = self.taking_part();
        if postures == samples { "posture" } else { "sample" }
    }

    /// Whether links are free, or their tolerances large beside the machine.
    fn is_loose(&self) -> bool {
        let size = self.found.start.characteristic_length();
        let loose = |prior: Prior, size: f64| match prior {
            Prior::Free => true,
            Prior::Sigma(sigma) => sigma > LOOSE * size,
            Prior::Held => false,
        };
        let mut links = self.found.start.limbs.iter().flat_map(|limb| &limb.links);
        links.any(|link| loose(link.tolerance.angle, 1.0) || loose(link.tolerance.length, size))
    }
}
