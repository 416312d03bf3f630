//! `gough report` as a user meets it, and the numbers behind its figures.

mod support;

use gough::files::{DataPlaces, read_problem};
use gough::identify::Covariance;
use gough::identify::spread::pose_spreads;
use gough::identify::{identify, residuals::residuals, score::score};
use gough::simulate::close;
use gough::solve::{Stop, registry};
use serde_json::json;
use support::{done, file, gough, json, write};

const SECTIONS: [&str; 7] = [
    "summary",
    "convergence",
    "residuals",
    "what-the-data-can-see",
    "link-deviations",
    "predicted-poses",
    "the-machine",
];

fn parsed(text: &str) -> roxmltree::Document<'_> {
    let options = roxmltree::ParsingOptions { allow_dtd: true, ..Default::default() };
    roxmltree::Document::parse_with_options(text, options).unwrap()
}

/// Names of the sections, and number of figures.
fn contents(page: &str) -> (Vec<String>, usize) {
    let document = parsed(page);
    let sections = document.descendants().filter(|node| node.has_tag_name("section"));
    let figures = document.descendants().filter(|node| node.attribute("class") == Some("figure")).count();
    (sections.filter_map(|node| node.attribute("id")).map(str::to_owned).collect(), figures)
}

#[test]
fn a_page_has_every_section_the_same_bytes_on_any_number_of_threads_and_says_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let (problem, result) = (folder.path().join("p.json"), folder.path().join("r.json"));
    std::fs::copy(file("problems/serial-puma560.json"), &problem).unwrap();
    done("identify {0} --holdout 0.25 --seed 3 -o {1}", &[&problem, &result]);
    let page = done("report {0}", &[&result]).stdout;
    let (sections, figures) = contents(&page);
    assert_eq!(sections, SECTIONS);
    assert_eq!(figures, 15);
    assert!(!page.contains("Attention: the problem file") && !page.contains("Needs the problem"));
    for threads in ["1", "3"] {
        let mut command = support::command();
        command.env("RAYON_NUM_THREADS", threads).arg("report").arg(&result);
        assert_eq!(support::ran(&mut command).stdout, page);
    }
    // The problem moved away: what needs it says so, the rest stands.
    let moved = folder.path().join("moved.json");
    std::fs::rename(&problem, &moved).unwrap();
    let without = done("report {0}", &[&result]).stdout;
    assert_eq!(contents(&without).0, SECTIONS);
    assert!(
        contents(&without).1 == 6 && without.matches("p.json; give the problem with --problem").count() == 4
    );
    assert_eq!(done("report {0} --problem {1}", &[&result, &moved]).stdout, page);
    // Data that have changed since are not drawn as if they belonged to the result without saying so.
    let mut other = json(&moved);
    other["data"]["samples"][0]["pose"]["position"][0] = json!(0.123);
    let other = write(folder.path(), "other.json", &other);
    assert!(
        done("report {0} --problem {1}", &[&result, &other]).stdout.contains("Attention: the problem file")
    );
}

#[test]
fn what_cannot_be_reported_is_refused_in_one_message() {
    let folder = tempfile::tempdir().unwrap();
    let result = folder.path().join("r.json");
    let puma = file("problems/serial-puma560.json");
    done("identify {0} -o {1}", &[&puma, &result]);
    let other = file("problems/serial-stanford.json");
    let page = folder.path().join("page.html");
    for (line, paths, words) in [
        (
            "report {0} --problem {1} -o {2}",
            [&result, &other, &page],
            vec!["--problem", "serial-stanford.json", "another machine"],
        ),
        (
            "report {1} -o {2}",
            [&result, &other, &page],
            vec!["serial-stanford.json", "format", "gough-result/1"],
        ),
        ("report {2}", [&result, &other, &page], vec!["page.html"]),
    ] {
        let ran = gough(line, &paths.map(|path| path.as_path()));
        assert_eq!(ran.status, 2, "{line}: {}", ran.stderr);
        assert!(words.iter().all(|word| ran.stderr.contains(word)), "{line}: {}", ran.stderr);
        assert!(!page.exists() && ran.stderr.matches("error:").count() == 1);
    }
}

/// A diverged run has no covariance, perhaps no finite numbers; it is reported all the same.
#[test]
fn a_run_that_diverged_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let result = folder.path().join("r.json");
    let ran = gough("identify {0} --solver textbook -o {1}", &[&file("problems/hexapod-6ups.json"), &result]);
    assert_eq!(ran.status, 1);
    let page = done("report {0}", &[&result]).stdout;
    assert_eq!(contents(&page).0, SECTIONS);
    assert!(page.contains("The identifier did not converge."));
}

/// The curve from which a weight was chosen, and errors of what was measured, whatever it was.
#[test]
fn the_choice_of_a_weight_and_every_kind_of_error_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let (problem, result) = (folder.path().join("p.json"), folder.path().join("r.json"));
    for (rule, words) in [("cv", "error of samples left out"), ("discrepancy", "discrepancy principle")] {
        let line = format!("identify {{0}} --solver conic-ridge --set weight={rule} -o {{1}}");
        assert_eq!(gough(&line, &[&file("problems/serial-scara.json"), &result]).status, 0);
        let page = done("report {0}", &[&result]).stdout;
        assert!(page.contains("<figure id=\"weight\"") && page.contains(words), "{rule}");
    }
    for (kind, name) in [("separation", "distance"), ("passive-joint", "joint angle")] {
        let simulate = format!("simulate {{0}} --poses 40 --seed 1 --kind {kind} -o {{1}}");
        done(&simulate, &[&file("problems/tripod-3rps.json"), &problem]);
        assert_eq!(gough("identify {0} -o {1}", &[&problem, &result]).status, 0);
        let (page, found) = (done("report {0}", &[&result]).stdout, json(&result));
        let key = format!("{}_rms", name.replace(' ', "_"));
        let rms = found["holdout"]["after"][key].as_f64().unwrap();
        assert!(
            page.contains(&format!("The {name} error on readings that took no part went from")),
            "{kind}"
        );
        assert!(
            page.contains(&format!("data-value=\"{rms:e}\"")) && !page.contains("position rms"),
            "{kind}"
        );
    }
}

/// Residuals are those that the scores count, component by component.
#[test]
fn residuals_agree_with_the_scores() {
    let problem =
        read_problem(&file("problems/tripod-3rps.json"), &DataPlaces::from_environment(None)).unwrap();
    let (machine, samples) = (&problem.mechanism, &problem.data.samples);
    let nominal = machine.nominal();
    let found = residuals(machine, &nominal, samples);
    let fit = score(machine, &nominal, samples).unwrap();
    let (mut square, mut position, mut count) = (0.0, 0.0, 0.0);
    for residual in found.iter().flatten() {
        let [.., x, y, z] = residual.components.map(Option::unwrap);
        let error = residual.error.position.unwrap();
        assert!((x.hypot(y).hypot(z) - error).abs() < 1e-12 * error);
        square += residual.weighted_rms().powi(2);
        position += error * error;
        count += 1.0;
    }
    assert_eq!(count as usize, fit.samples);
    let relative = |a: f64, b: f64| (a / b - 1.0).abs();
    assert!(relative(f64::sqrt(square / count), fit.weighted_rms) < 1e-12);
    assert!(relative(f64::sqrt(position / count), fit.position.unwrap().rms) < 1e-12);
}

/// Uncertainty of predicted poses against central differences of the forward kinematics along every column of the
/// covariance's root.
#[test]
fn pose_uncertainty_agrees_with_differences() {
    for (name, posture) in [("serial-puma560", 3), ("tripod-3rps", 5)] {
        let path = file(&format!("problems/{name}.json"));
        let problem = read_problem(&path, &DataPlaces::from_environment(None)).unwrap();
        let samples = &problem.data.samples;
        let identifier = registry::find("minimal").unwrap();
        let found = identify(&problem.mechanism, samples, identifier.as_ref(), &Stop::default()).unwrap();
        let machine = &found.start;
        let at = found.geometry.deviations_from(&machine.nominal());
        let seen = found.visibility.as_ref().unwrap();
        let root = Covariance::joint(found.report.estimate, seen).unwrap().root;
        let actuators = &samples[posture].actuators;
        let spread = pose_spreads(machine, &at, &root, std::slice::from_ref(actuators)).unwrap()[0];
        let coordinates = gough::calibration::Coordinates::new(machine, gough::problem::Form::Minimal);
        let tool = |d: &[f64]| close(machine, &machine.deviated(d), actuators).unwrap().tool();
        let h = 1e-3;
        let (mut rotation, mut position) = (0.0, 0.0);
        for k in 0..root.ncols() {
            let column: Vec<f64> = root.col(k).iter().map(|v| h * v).collect();
            let d = coordinates.deviations(&column);
            let moved = |sign: f64| tool(&at.iter().zip(&d).map(|(a, d)| a + sign * d).collect::<Vec<_>>());
            let (angle, length) = gough::model::mechanism::pose_difference(&moved(1.0), &moved(-1.0));
            rotation += (angle.norm() / (2.0 * h)).powi(2);
            position += (length.norm() / (2.0 * h)).powi(2);
        }
        let relative = |a: f64, b: f64| (a / b - 1.0).abs();
        assert!(
            relative(spread.position, f64::sqrt(position)) < 1e-4,
            "{name}: {spread:?} {}",
            position.sqrt()
        );
        assert!(
            relative(spread.rotation, f64::sqrt(rotation)) < 1e-4,
            "{name}: {spread:?} {}",
            rotation.sqrt()
        );
    }
}
