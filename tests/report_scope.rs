//! What results and reports say of identifiers, problems and numbers that are not the usual ones.

mod support;

use gough::files::{DataPlaces, read_problem};
use gough::identify::identify;
use gough::simulate::{close, draw_postures};
use gough::solve::{Stop, registry};
use serde_json::json;
use support::{done, file, gough, json, numbers, write};

#[test]
fn limbwise_has_standard_errors_and_uncertain_poses() {
    let folder = tempfile::tempdir().unwrap();
    let result = folder.path().join("r.json");
    let machine = file("problems/hexapod-6ups.json");
    done("identify {0} --solver limbwise -o {1}", &[&machine, &result]);
    let page = done("report {0} --problem {1}", &[&result, &machine]).stdout;
    assert!(!page.contains("No covariance") && page.contains("limbwise estimates each limb by itself"));
    assert!(page.contains("Intervals are 95 %") && page.contains("<figure id=\"position-above\""));
    // The map's uncertainties are of the size that the result's own covariance gives, by prediction.
    let (found, drawn) =
        (json(&result), read_problem(&machine, &DataPlaces::from_environment(None)).unwrap());
    assert!(found["uncertainty"].is_object());
    let identifier = registry::find("limbwise").unwrap();
    let found =
        identify(&drawn.mechanism, &drawn.data.samples, identifier.as_ref(), &Stop::default()).unwrap();
    let calibrated = found.calibrated();
    let actuators = draw_postures(&drawn.mechanism, &[&found.geometry], 400, 1).unwrap();
    let postures: Vec<_> = (actuators.into_iter())
        .map(|q| {
            let posture = close(&calibrated, &calibrated.nominal(), &q).unwrap();
            (q, posture)
        })
        .collect();
    let link_root = found.link_root().unwrap();
    let covariances = gough::identify::pose_covariances(&calibrated, &postures, &link_root).unwrap();
    let mut sizes: Vec<f64> =
        covariances.iter().map(|c| c.std()[3..].iter().map(|s| s * s).sum::<f64>().sqrt()).collect();
    sizes.sort_by(f64::total_cmp);
    let median = 0.5 * (sizes[199] + sizes[200]);
    let shown: f64 = page.split("Median ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    let unit = page.split("Median ").nth(1).unwrap().split(' ').nth(1).unwrap();
    let metres = shown * if unit == "mm" { 1e-3 } else { 1e-6 };
    assert!((metres / median - 1.0).abs() < 0.01, "{shown} {unit}, {median}");
}

#[test]
fn an_identifier_that_does_not_suit_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let result = folder.path().join("r.json");
    let ran = gough(
        "identify {0} --solver limbwise -o {1}",
        &[&file("problems/kinds/serial-puma560-position.json"), &result],
    );
    assert!(ran.status == 2 && ran.stdout.is_empty() && !result.exists(), "{ran:?}");
    let lines: Vec<&str> = ran.stderr.lines().filter(|line| line.starts_with("error:")).collect();
    assert!(lines.len() == 1 && lines[0].contains("limbwise does not suit this problem"), "{ran:?}");
    assert!(
        ["every sample must be a whole pose", "choose another --solver"]
            .iter()
            .all(|part| lines[0].contains(part)),
        "{ran:?}"
    );
}

#[test]
fn a_weight_of_nothing_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let result = folder.path().join("r.json");
    let scara = file("problems/serial-scara.json");
    let ran = gough("identify {0} --solver conic-huber --set weight=3 -o {1}", &[&scara, &result]);
    assert!(ran.status == 2 && !result.exists(), "{ran:?}");
    assert!(ran.stderr.contains("a weight is set, but no regulariser that it could weigh"), "{ran:?}");
}

#[test]
fn machines_that_no_posture_fits_and_those_of_another_size() {
    let folder = tempfile::tempdir().unwrap();
    let (wrong, result) = (folder.path().join("wrong.json"), folder.path().join("r.json"));
    let mut problem = json(&file("problems/hexapod-6ups.json"));
    problem["units"]["length"] = json!("mm");
    std::fs::write(&wrong, problem.to_string()).unwrap();
    let ran = gough("identify {0} -o {1}", &[&wrong, &result]);
    assert!(ran.stderr.contains("the file says mm, but its lengths look like m"), "{ran:?}");
    let second = folder.path().join("s.json");
    let ran = gough("identify {0} -o {1}", &[&result, &second]);
    assert!(ran.status == 2 && ran.stderr.contains("this is a result (gough-result/1); expected"), "{ran:?}");
    // The tool stands so far off that limbs meet at first, but not with what is made of it.
    problem["units"]["length"] = json!("m");
    problem["mechanism"]["tool"]["position"] = json!([0.0, 0.0, 900.0]);
    std::fs::write(&wrong, problem.to_string()).unwrap();
    let ran = gough("identify {0} -o {1}", &[&wrong, &second]);
    assert!(ran.status == 2 && ran.stdout.is_empty() && !second.exists(), "{ran:?}");
    assert!(ran.stderr.contains("no posture closes with the machine that they gave"), "{ran:?}");
}

#[test]
fn a_page_without_standard_errors_speaks_of_no_intervals() {
    let folder = tempfile::tempdir().unwrap();
    let result = folder.path().join("r.json");
    let machine = file("problems/serial-scara.json");
    done("identify {0} --solver conic-huber -o {1}", &[&machine, &result]);
    assert!(json(&result)["links"][0]["std"].is_null());
    let page = done("report {0} --problem {1}", &[&result, &machine]).stdout;
    assert!(!page.contains("95 %") && page.contains("The result has no standard errors"));
}

#[test]
fn a_problem_of_another_machine_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let result = folder.path().join("r.json");
    let machine = file("problems/hexapod-6ups.json");
    done("identify {0} -o {1}", &[&machine, &result]);
    // The same names and another geometry.
    let mut other = json(&machine);
    let point = &mut other["mechanism"]["limbs"][1]["joints"][0]["point"];
    let mut moved = numbers(point);
    moved[0] += 0.01;
    *point = json!(moved);
    let refused = |other: &serde_json::Value, words: &str| {
        let path = write(folder.path(), "other.json", other);
        let ran = gough("report {0} --problem {1}", &[&result, &path]);
        assert!(ran.status == 2 && ran.stdout.is_empty() && ran.stderr.contains(words), "{ran:?}");
    };
    refused(&other, "other.json: it draws another machine than that of the result");
    // The same machine, another campaign.
    let mut other = json(&machine);
    other["name"] = json!("campaign 2");
    other["data"]["samples"].as_array_mut().unwrap().truncate(20);
    refused(&other, "it is called campaign 2 and gives other errors than the result");
    let mut fewer = json(&machine);
    fewer["mechanism"]["limbs"].as_array_mut().unwrap().truncate(5);
    for sample in fewer["data"]["samples"].as_array_mut().unwrap() {
        sample["actuators"].as_array_mut().unwrap().truncate(5);
    }
    let path = write(folder.path(), "fewer.json", &fewer);
    assert_eq!(gough("report {0} --problem {1}", &[&result, &path]).status, 2);
}

/// A component that neither data nor tolerances move is written as zero, not as what rounding left.
#[test]
fn components_without_error_are_zero() {
    let folder = tempfile::tempdir().unwrap();
    let result = folder.path().join("r.json");
    let (example, measured) = (file("examples/my-hexapod.json"), folder.path().join("m.json"));
    done("simulate {0} --poses 40 --seed 1 -o {1}", &[&example, &measured]);
    done("identify {0} -o {1}", &[&measured, &result]);
    let mut zeros = 0;
    for link in json(&result)["links"].as_array().unwrap() {
        for (part, tolerance) in [("rotation", 0.05), ("translation", 0.5)] {
            let pairs = numbers(&link["deviation"][part]).into_iter().zip(numbers(&link["std"][part]));
            for (deviation, std) in pairs {
                zeros += usize::from(deviation == 0.0 && std == 0.0);
                assert!((deviation == 0.0) == (std == 0.0), "{link}");
                assert!(std == 0.0 || std > 1e-9 * tolerance, "{link}");
            }
        }
    }
    assert!(zeros > 0);
}

#[test]
fn out_of_reach_is_said_in_units_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let far = write(
        folder.path(),
        "far.json",
        &json!({"samples": [{"pose": {"position": [0.0, 0.0, 100.0], "rotation": [0.5, 0.0, 0.0]}}]}),
    );
    let ran = gough("command {0} --poses {1}", &[&file("problems/kinds/delta-3puu-separation.json"), &far]);
    assert!(
        ran.status == 2 && ran.stderr.contains("out of reach") && ran.stderr.contains(" mm away"),
        "{ran:?}"
    );
}

#[test]
fn sets_are_counted_in_words() {
    let ran = gough("simulate {0} --poses 10,4 --seed 1 -o -", &[&file("examples/my-hexapod.json")]);
    assert!(
        ran.status == 2 && ran.stderr.contains("--poses: 2 numbers for 1 set; give one number\n"),
        "{ran:?}"
    );
}
