//! The benchmark set: every problem says why it is there, and its reference outcome is what comes out.

mod support;

use gough::files::{BenchmarkDrawing, DataPlaces, ProblemFile, read_problem};
use gough::identify::{identify, score};
use gough::solve::{Stop, registry};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use support::{file, problems, write};

fn stress() -> Vec<PathBuf> {
    let entries = std::fs::read_dir(file("problems/stress")).unwrap().map(|entry| entry.unwrap().path());
    let mut paths: Vec<PathBuf> = entries.collect();
    paths.sort();
    paths
}

fn read(path: &Path) -> (ProblemFile, BenchmarkDrawing) {
    let places = DataPlaces { data_dir: None, shared: "no such folder".into() };
    let problem = read_problem(path, &places).unwrap_or_else(|why| panic!("{why}"));
    let benchmark = problem.drawing.benchmark.clone();
    (problem, benchmark.unwrap_or_else(|| panic!("{}: no purpose", path.display())))
}

#[test]
fn every_problem_has_a_purpose_and_a_place_in_the_index() {
    let index = std::fs::read_to_string(file("problems/README.md")).unwrap();
    let mut stresses = Vec::new();
    for path in problems().iter().chain(&stress()) {
        let (problem, benchmark) = read(path);
        assert!(benchmark.purpose.len() > 30 && benchmark.purpose.ends_with('.'), "{}", problem.name);
        assert!(index.contains(&benchmark.purpose), "{}", problem.name);
        assert_eq!(problem.name, support::name(path));
        stresses.extend(benchmark.stresses);
    }
    for wanted in [
        "dimension",
        "condition",
        "lower mobility",
        "near-singular postures",
        "outliers",
        "sparse truth",
        "tight bounds",
        "few poses",
        "bad start",
        "large noise",
        "position only",
    ] {
        assert!(stresses.iter().any(|stress| stress == wanted), "nothing stresses {wanted}");
    }
}

#[test]
fn references_are_what_comes_out() {
    let paths: Vec<PathBuf> = problems().into_iter().chain(stress()).collect();
    assert!(paths.len() >= 30);
    paths.par_iter().for_each(|path| {
        let (problem, benchmark) = read(path);
        let reference = benchmark.reference.unwrap_or_else(|| panic!("{}: no reference", problem.name));
        let identifier = registry::find(&reference.solver).unwrap();
        let samples = &problem.data.samples;
        let found = identify(&problem.mechanism, samples, identifier.as_ref(), &Stop::default()).unwrap();
        let fit = score::score(&found.start, &found.geometry, &problem.holdout.samples).unwrap();
        let near = |what: &str, found: f64, wanted: f64| {
            let name = &problem.name;
            assert!(
                (found - wanted).abs() <= 0.02 * wanted,
                "{name}: {what} {found} where {wanted} is stated"
            );
        };
        near("position", problem.units.from_metres(fit.position.unwrap().rms), reference.position_rms);
        if let Some(rotation) = reference.rotation_rms {
            near("rotation", problem.units.from_radians(fit.rotation.unwrap().rms), rotation);
        }
        assert_eq!(found.counts().unwrap().practical, reference.practical, "{}", problem.name);
    });
}

/// A recipe that makes no sense is refused with its place.
#[test]
fn recipes_are_checked() {
    let folder = tempfile::tempdir().unwrap();
    let path = problems().into_iter().find(|path| support::name(path) == "serial-puma560").unwrap();
    for (key, value) in [
        ("poses", serde_json::json!(0)),
        ("distance", serde_json::json!(-1)),
        ("outliers", serde_json::json!({"share": 1.5, "factor": 3})),
        ("sparse", serde_json::json!(1)),
    ] {
        let mut problem = support::json(&path);
        problem["benchmark"][key] = value;
        let spoiled = write(folder.path(), "m.json", &problem);
        let ran = support::gough("compare {0} --solvers minimal --seeds 1", &[&spoiled]);
        assert!(
            ran.status == 2 && ran.stderr.contains("benchmark") && ran.stderr.contains(key),
            "{key}: {ran:?}"
        );
    }
}
