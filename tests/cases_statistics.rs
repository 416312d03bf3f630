//! Verdicts that find the cause: data with one known trouble each.

mod judging;
mod support;

use gough::files::ProblemFile;
use gough::identify::Judgement;
use gough::identify::verdict::{Cause, RowCause, Size};
use judging::{judged, problem};
use support::{file, gough};

fn case(name: &str) -> ProblemFile {
    problem(&format!("tests/data/cases/statistics/{name}.json"))
}

/// The set of each sample, by the sets' order.
fn sets(problem: &ProblemFile) -> Vec<usize> {
    let each = problem.data.parts().iter().enumerate();
    each.flat_map(|(set, data)| vec![set; data.samples.len()]).collect()
}

fn verdict(name: &str) -> Judgement {
    let drawn = case(name);
    judged(&drawn, &drawn.data.samples, &sets(&drawn), &drawn.holdout.samples).1
}

#[test]
fn the_noise_of_one_set_is_said_of_that_set() {
    let found = verdict("mixed-set2-noise-x10");
    let [Cause::Noise(noise)] = found.causes.as_slice() else { panic!("{found:?}") };
    let [part] = noise.parts.as_slice() else { panic!("{noise:?}") };
    assert_eq!(part.name, "the readings of set 2");
    assert!((part.factor / 0.1).ln().abs() < 3.0 * part.error / part.factor && part.error < 0.03, "{part:?}");
    assert!(
        noise
            .others
            .as_ref()
            .is_some_and(|(name, factor)| name.contains("set 1") && (factor - 1.0).abs() < 0.1)
    );
    assert!(found.outliers.is_empty());
}

#[test]
fn the_noise_of_rotations_is_said_of_the_angles() {
    let found = verdict("t5-arm-5r-heavyrot");
    let [Cause::Noise(noise)] = found.causes.as_slice() else { panic!("{found:?}") };
    let [part] = noise.parts.as_slice() else { panic!("{noise:?}") };
    assert!(part.name == "the angles" && (part.factor - 10.0).abs() < 3.0 * part.error, "{part:?}");
    assert!(found.outliers.is_empty(), "{:?}", found.outliers);
}

#[test]
fn the_noise_of_one_axis_is_said_of_that_axis() {
    let found = verdict("t5-arm-5r-noisexyz");
    let [Cause::Noise(noise)] = found.causes.as_slice() else { panic!("{found:?}") };
    let largest = noise.parts.iter().max_by(|a, b| a.factor.total_cmp(&b.factor)).unwrap();
    assert!(
        largest.name == "the positions along z" && (largest.factor - 5.0).abs() < 3.0 * largest.error,
        "{noise:?}"
    );
    assert!(noise.parts.iter().all(|part| part.name.starts_with("the positions along")), "{noise:?}");
    assert!(found.outliers.is_empty(), "{:?}", found.outliers);
}

#[test]
fn neighbours_in_order_are_named_with_what_they_do_to_standard_errors() {
    let found = verdict("t5-arm-5r-ar");
    let [Cause::Order(order)] = found.causes.as_slice() else { panic!("{found:?}") };
    assert!((0.8..0.97).contains(&order.correlation), "{order:?}");
    // The least favourable direction is one that all postures share: sqrt((1 + 0.9) / (1 - 0.9)) = 4.36.
    assert!((2.0..5.0).contains(&order.inflation.1), "{order:?}");
    assert!(order.sentence().contains("sqrt((1 + 0.9") && found.outliers.is_empty(), "{found:?}");
}

#[test]
fn a_drift_is_named() {
    let found = verdict("t5-arm-5r-drift");
    let [Cause::Drift(drift, _)] = found.causes.as_slice() else { panic!("{found:?}") };
    assert!((2.2..4.0).contains(&drift.size) && drift.shift > 0.5, "{drift:?}");
    assert!(found.outliers.is_empty());
}

#[test]
fn wrong_readings_are_named_whoever_identifies() {
    let path = file("tests/data/cases/statistics/t5-delta-3ruu-outact.json");
    let named = |solver: &str| -> Vec<String> {
        let ran = gough(&format!("identify {{0}} --solver {solver}"), &[&path]);
        let line =
            ran.stderr.lines().find(|line| line.contains("stand out")).unwrap_or_else(|| panic!("{ran:?}"));
        if ran.status == 1 {
            assert!(line.contains("--solver conic-huber"), "{line}");
            assert!(!ran.stderr.contains("tolerances off"), "{ran:?}");
        }
        let mut names: Vec<String> = line
            .split("sample ")
            .skip(1)
            .map(|rest| rest.chars().take_while(char::is_ascii_digit).collect())
            .collect();
        names.sort();
        names
    };
    let robust = named("conic-huber");
    assert_eq!(robust.len(), 3);
    assert_eq!(named("minimal"), robust);
    assert_eq!(named("argmin-lm"), robust);
    let found = verdict("t5-delta-3ruu-outact");
    let told = |cause: &RowCause| matches!(cause, RowCause::Reading { .. } | RowCause::Readings);
    assert!(found.outliers.iter().all(|named| told(&named.cause)), "{:?}", found.outliers);
}

#[test]
fn lengths_and_angles_are_told_apart() {
    let found = verdict("n_noise_um");
    let [Cause::Noise(noise)] = found.causes.as_slice() else { panic!("{found:?}") };
    let [part] = noise.parts.as_slice() else { panic!("{noise:?}") };
    // 15 um written as 15 mm.
    assert!(part.name == "the lengths" && (part.factor / 1e-3).ln().abs() < 0.3, "{part:?}");
    assert!((0.004..0.015).contains(&part.ratio), "{part:?}");
    let (name, angles) = noise.others.as_ref().unwrap();
    assert!(name == "the angles" && (angles - 1.0).abs() < 0.15, "{noise:?}");
}

/// A gross pose drags a hexapod far off: what it does to deviations is not said of the tolerances.
#[test]
fn one_gross_pose_on_a_hexapod_is_the_cause() {
    let folder = tempfile::tempdir().unwrap();
    let drawn = folder.path().join("h.json");
    let from = file("problems/hexapod-6ups.json");
    support::done("simulate {0} --poses 40 --seed 3 -o {1}", &[&from, &drawn]);
    for (part, component, off) in [("position", 0, 1e-3), ("rotation", 0, 0.3)] {
        let mut value = support::json(&drawn);
        let wrong = &mut value["data"]["samples"][7]["pose"][part][component];
        *wrong = serde_json::json!(wrong.as_f64().unwrap() + off);
        let ran = gough("identify {0}", &[&support::write(folder.path(), "w.json", &value)]);
        // Whether the machine that bends to a gross turn is found before the iteration limit does not matter.
        assert!(ran.stderr.contains("1 posture stands out") && ran.stderr.contains("sample 8 ("), "{ran:?}");
        assert!(ran.stderr.contains("without it chi-square is 164"), "{ran:?}");
        assert!(!ran.stderr.contains("tolerances off") && !ran.stderr.contains("write {"), "{ran:?}");
    }
}

/// A screw that moves farther than it reads turns and advances so, and how far is told of both together.
#[test]
fn the_scale_of_a_screw_is_that_of_its_turn_and_its_advance() {
    let folder = tempfile::tempdir().unwrap();
    let drawn = folder.path().join("s.json");
    let from = file("problems/serial-scara-screw.json");
    support::done("simulate {0} --poses 60 --seed 5 -o {1}", &[&from, &drawn]);
    let mut drawn = problem(drawn.to_str().unwrap());
    for sample in &mut drawn.data.samples {
        sample.actuators[2] /= 1.0 + 1e-4;
    }
    let (_, found) = judged(&drawn, &drawn.data.samples, &sets(&drawn), &drawn.holdout.samples);
    let scale = found.causes.iter().find_map(|cause| match cause {
        Cause::Model(model) if model.or.is_empty() => {
            model.scale.filter(|_| model.joint.as_deref() == Some("arm.quill"))
        }
        _ => None,
    });
    assert!(scale.is_some_and(|scale| (scale - 1.0001).abs() < 1e-6), "{:?}", found.causes);
}

/// Measurements of other people, which are found through `GOUGH_SHARED`.
#[test]
fn a_probability_of_two_thousandths_is_doubtful() {
    let shared = std::env::var("GOUGH_SHARED").unwrap_or_else(|_| "../shared".into());
    let path = std::path::Path::new(&shared).join("cases/statistics/a3e8fe5c.json");
    if !path.exists() {
        eprintln!("ignored: {} is absent", path.display());
        return;
    }
    let ran = gough("identify {0}", &[&path]);
    assert!(
        ran.stdout.contains("(probability 0.002") && ran.stdout.contains("): doubtful"),
        "{}",
        ran.stdout
    );
}

/// The verdict on the size alone has a middle.
#[test]
fn sizes_have_a_middle() {
    use gough::identify::ChiSquareTest;
    let size = |value: f64| ChiSquareTest::new(value, 100.0).unwrap().size();
    assert_eq!(
        [60.0, 100.0, 124.0, 125.0, 149.0, 150.0].map(size),
        [Size::Small, Size::Explained, Size::Explained, Size::Doubtful, Size::Doubtful, Size::Large]
    );
}
