//! What an identification costs, and its parts.

#![allow(missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use gough::calibration::{Calibration, Sample};
use gough::files::{DataPlaces, ProblemFile, read_problem};
use gough::identify::identify;
use gough::problem::{Form, Problem};
use gough::simulate::{Plan, simulate};
use gough::solve::{Stop, registry};
use std::hint::black_box;
use std::path::Path;

fn golden(name: &str) -> ProblemFile {
    let path = format!("{}/tests/data/golden/{name}/problem.json", env!("CARGO_MANIFEST_DIR"));
    read_problem(Path::new(&path), &DataPlaces::from_environment(None)).expect("the golden cases can be read")
}

/// Residual and minimal Jacobian of 50 poses of a 6R arm; its whole identification.
fn serial(c: &mut Criterion) {
    let file = golden("serial-6r");
    let nominal = vec![0.0; file.mechanism.component_count()];
    let problem = Calibration::new(&file.mechanism, &file.data.samples, Form::Minimal, &nominal);
    let geometry = file.mechanism.nominal();
    let mut rows = Vec::new();
    c.bench_function("6R: residual and minimal Jacobian, 50 poses", |b| {
        b.iter(|| problem.slice_rows(black_box(&geometry), &mut rows).expect("an arm always closes"));
    });
    let start = vec![0.0; problem.params().len()];
    let minimal = registry::find("minimal").expect("registered");
    c.bench_function("6R: identification, 50 poses", |b| {
        b.iter(|| {
            let problem = Calibration::new(&file.mechanism, &file.data.samples, Form::Minimal, &nominal);
            minimal.identify(&problem, black_box(&start), &Stop::default())
        });
    });
}

/// One 6-UPS posture, closed from the solution of a geometry one hundredth of the tolerances away, with its Jacobian;
/// the identification from 60 postures.
fn hexapod(c: &mut Criterion) {
    let file = golden("hexapod-6ups");
    let minimal = registry::find("minimal").expect("registered");
    let nominal = vec![0.0; file.mechanism.component_count()];
    let one = Calibration::new(&file.mechanism, &file.data.samples[..1], Form::Minimal, &nominal);
    let near: Vec<f64> = (0..nominal.len()).map(|i| 1e-5 * ((i * 37 % 11) as f64 - 5.0) / 5.0).collect();
    let geometry = file.mechanism.deviated(&near);
    let mut rows = Vec::new();
    c.bench_function("6-UPS: closure and minimal Jacobian of a posture", |b| {
        b.iter(|| one.slice_rows(black_box(&geometry), &mut rows).expect("near a closed posture"));
    });
    let problem = Calibration::new(&file.mechanism, &file.data.samples, Form::Minimal, &nominal);
    let start = vec![0.0; problem.params().len()];
    c.bench_function("6-UPS: identification, 60 poses, 138 coordinates", |b| {
        b.iter(|| minimal.identify(&problem, black_box(&start), &Stop::default()));
    });
    c.bench_function("6-UPS: the whole job with scores and counts", |b| {
        b.iter(|| identify(&file.mechanism, &file.data.samples, minimal.as_ref(), &Stop::default()));
    });
}

/// All coordinates at once against limb by limb, 1000 poses.
fn many_poses(c: &mut Criterion) {
    let file = golden("hexapod-6ups");
    let covariance = file.data.noise.expect("stated");
    let plan = Plan { poses: 1000, holdout: 0, seed: 1, noise: 1.0, distance: 1.0 };
    let simulated = simulate(&file.mechanism, &covariance, &plan).expect("the golden workspace closes");
    let samples: Vec<Sample> = simulated
        .samples
        .iter()
        .map(|(actuators, pose)| Sample {
            name: String::new(),
            actuators: actuators.clone(),
            measurement: std::sync::Arc::new(
                gough::measure::Pose::new(*pose, [true; 6], &covariance).expect("positive definite"),
            ),
        })
        .collect();
    let nominal = vec![0.0; file.mechanism.component_count()];
    let problem = Calibration::new(&file.mechanism, &samples, Form::Minimal, &nominal);
    let start = vec![0.0; problem.params().len()];
    let mut group = c.benchmark_group("6-UPS, 1000 poses");
    group.sample_size(10);
    for name in ["minimal", "limbwise"] {
        let identifier = registry::find(name).expect("registered");
        group.bench_function(name, |b| {
            b.iter(|| identifier.identify(&problem, black_box(&start), &Stop::default()));
        });
    }
}

criterion_group!(benches, serial, hexapod, many_poses);
criterion_main!(benches);
