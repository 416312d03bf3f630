//! Whether the stated noise is that of the data, by what an identification leaves of them.

use super::judged::sets_of;
use crate::files::ProblemFile;
use crate::identify::verdict::Cause;
use crate::identify::{Judged, identify, judge};
use crate::solve::{Stop, registry};
use std::fmt::Write;

/// Says of which readings the noise is not what is stated; whether there are any.
pub(super) fn stated_noise(problem: &ProblemFile, text: &mut String) -> bool {
    let samples = &problem.data.samples;
    let Some(identifier) = registry::all().into_iter().next() else { return false };
    if !problem.data.has_noise() || problem.require_tolerances().is_err() {
        return false;
    }
    let stop = Stop::default();
    let Ok(found) = identify(&problem.mechanism, samples, identifier.as_ref(), &stop) else { return false };
    let judgement = judge(&Judged {
        found: &found,
        samples,
        sets: &sets_of(problem, samples),
        holdout: &[],
        stated: true,
        identifier: identifier.as_ref(),
        stop: &stop,
    });
    let noise = judgement.causes.iter().find_map(|cause| match cause {
        Cause::Noise(found) => Some(found),
        _ => None,
    });
    if let Some(found) = noise {
        let _ = writeln!(text, "\nsuspicious: {}; correct data.noise", found.sentence());
    }
    noise.is_some()
}
