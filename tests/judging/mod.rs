//! Identified and judged.

use crate::support::file;
use gough::calibration::Sample;
use gough::files::{DataPlaces, ProblemFile, read_problem};
use gough::identify::{Identification, Judged, Judgement, identify, judge};
use gough::solve::{Stop, registry};

pub fn problem(path: &str) -> ProblemFile {
    let places = DataPlaces { data_dir: None, shared: "no such folder".into() };
    read_problem(&file(path), &places).unwrap()
}

pub fn judged(
    problem: &ProblemFile,
    samples: &[Sample],
    sets: &[usize],
    holdout: &[Sample],
) -> (Identification, Judgement) {
    let minimal = registry::find("minimal").unwrap();
    let stop = Stop::default();
    let found = identify(&problem.mechanism, samples, minimal.as_ref(), &stop).unwrap();
    let judgement = judge(&Judged {
        found: &found,
        samples,
        sets,
        holdout,
        stated: true,
        identifier: minimal.as_ref(),
        stop: &stop,
    });
    eprintln!("{}: {:?}", problem.name, judgement.sentence());
    (found, judgement)
}
