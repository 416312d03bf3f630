//! Whether what the file states of noise and tolerances is what the data show, by what an identification leaves of them.

use super::details::digits;
use super::judged::{outlier, sets_of};
use super::tolerances::{is_absurd, restated, sentence};
use crate::calibration::Sample;
use crate::files::{ProblemFile, Units};
use crate::identify::posture_noise::sharing;
use crate::identify::verdict::{Cause, Judgement, Size};
use crate::identify::{
    Identification, Judged, PostureNoiseEstimate, ToleranceVerdict, identify, identify_sharing, judge,
};
use crate::measure::PostureNoise;
use crate::solve::{Stop, registry};
use std::cell::Cell;
use std::fmt::Write;

/// Noise, in units of what is stated, above which it is none.
const MOST: f64 = 20.0;
/// Postures named.
const NAMED: usize = 5;

/// What an identification makes of the data as they are.
pub(super) struct Stated {
    /// What of the file the data contradict, one sentence each without its stop.
    wrong: Vec<String>,
    /// What is no mistake and worth a word.
    notes: Vec<String>,
    /// Whether with these the data are explained, so that no mistake need be sought.
    pub explains: bool,
    said: Cell<bool>,
}

/// An identification, what it was made from, and what is thought of it.
struct Tried {
    found: Identification,
    common: Option<PostureNoiseEstimate>,
    judgement: Judgement,
}

impl Tried {
    fn of(problem: &ProblemFile, samples: &[Sample]) -> Option<Self> {
        let identifier = registry::all().into_iter().next()?;
        let stop = Stop::default();
        let from = |samples: &[Sample]| {
            identify(&problem.mechanism, samples, identifier.as_ref(), &stop).map(|found| (found, None))
        };
        let (found, _, common) = identify_sharing(samples, from).ok()?;
        let weighed = common.map_or_else(|| samples.to_vec(), |common| sharing(samples, common.noise));
        let judgement = judge(&Judged {
            found: &found,
            samples: &weighed,
            sets: &sets_of(problem, &weighed),
            holdout: &[],
            stated: true,
            identifier: identifier.as_ref(),
            stop: &stop,
        });
        Some(Self { found, common, judgement })
    }

    /// Whether noise, tolerances as they would be restated, and postures that stand out are all that is wrong.
    fn explains(&self, problem: &ProblemFile) -> bool {
        let known = |cause: &Cause| match cause {
            Cause::Noise(found) => found.parts.iter().all(|part| part.factor <= MOST),
            Cause::PostureNoise(found) => found.part.factor <= MOST,
            Cause::Outliers(found) => found.without.is_some_and(|test| test.size() != Size::Large),
            _ => false,
        };
        let judgement = &self.judgement;
        let large = judgement.total.is_none_or(|total| total.size() == Size::Large);
        // An estimate that ended nowhere explains nothing, unless a few postures led it astray.
        let ended = self.found.report.outcome.converged()
            || judgement.causes.iter().any(|cause| matches!(cause, Cause::Outliers(_)));
        let absurd = self.too_small().is_some_and(|factor| is_absurd(problem, factor));
        ended && !absurd && judgement.causes.iter().all(known) && !(large && judgement.causes.is_empty())
    }

    /// The factor that the tolerances lack; `None` where postures that stand out may be what deviations come from.
    fn too_small(&self) -> Option<f64> {
        let test = self.found.tolerance_test.as_ref().filter(|_| !self.judgement.is_spoiled())?;
        let factor = if test.in_force != 1.0 { test.in_force } else { test.factor };
        (test.verdict == ToleranceVerdict::TooSmall).then_some(factor)
    }

    fn wrong(&self, problem: &ProblemFile) -> Vec<String> {
        let mut wrong = Vec::new();
        if let (Some(test), Some(factor)) = (&self.found.tolerance_test, self.too_small())
            && self.found.report.outcome.converged()
            && !is_absurd(problem, factor)
        {
            wrong.push(format!(
                "{}; tolerances look too small: {}",
                sentence(test),
                restated(problem, factor)
            ));
        }
        for cause in &self.judgement.causes {
            match cause {
                Cause::Noise(found) => wrong.push(format!("{}; correct data.noise", found.sentence())),
                Cause::PostureNoise(found) => {
                    let size = shown(found.supported, problem.units);
                    wrong.push(format!(
                        "{}; the data support {size}: correct data.posture_noise",
                        found.sentence()
                    ));
                }
                Cause::Outliers(found) if found.without.is_some() => {
                    let shown = self.judgement.outliers.iter().take(NAMED);
                    let names: Vec<String> = shown.map(|named| outlier(named, problem.units)).collect();
                    wrong.push(format!("{}: {}", cause.sentence(), names.join(", ")));
                }
                _ => {}
            }
        }
        wrong
    }
}

impl Stated {
    /// Of a problem that states noise and tolerances; `None` where it does not, or nothing could be identified.
    pub fn of(problem: &ProblemFile) -> Option<Self> {
        if !problem.data.has_noise() || problem.require_tolerances().is_err() {
            return None;
        }
        let samples = &problem.data.samples;
        let tried = Tried::of(problem, samples)?;
        let mut notes = Vec::new();
        if let Some(common) = tried.common {
            let size = shown(common.noise, problem.units);
            notes.push(format!(
                "the samples of a posture have errors of {size} in common, which data.posture_noise would state; \
                 identify estimates it"
            ));
        }
        Some(Self {
            wrong: tried.wrong(problem),
            notes,
            explains: tried.explains(problem),
            said: Cell::new(false),
        })
    }

    /// Writes once what the data contradict; whether that is anything.
    pub fn say(&self, text: &mut String) -> bool {
        if self.said.replace(true) {
            return !self.wrong.is_empty();
        }
        for note in &self.notes {
            let _ = writeln!(text, "\n{note}");
        }
        for wrong in &self.wrong {
            let _ = writeln!(text, "\nsuspicious: {wrong}");
        }
        !self.wrong.is_empty()
    }
}

/// The size of what samples share, in units of the file.
fn shown(noise: PostureNoise, units: Units) -> String {
    let length = format!("{} {}", digits(units.from_metres(noise.length)), units.length_symbol());
    let angle = format!("{} {}", digits(units.from_radians(noise.angle)), units.angle_symbol());
    match (noise.length == 0.0, noise.angle == 0.0) {
        (false, true) => length,
        (true, false) => angle,
        (false, false) => format!("{length} and {angle}"),
        (true, true) => "none".to_owned(),
    }
}
