//! Counts that do not contradict each other, directions that are what they are said to be, and the commands.

mod support;

use gough::calibration::{Coordinates, Sample};
use gough::files::{DataPlaces, ProblemFile, read_problem};
use gough::identify::counts::visibility;
use gough::identify::{Analysis, analyze};
use gough::measure::{Evaluation, View};
use gough::model::{Mechanism, Posture};
use gough::problem::Form;
use serde_json::{Value, json};
use std::path::Path;
use support::{GOLDEN, done, file, golden, gough, numbers, problems, write};

fn problem(path: &Path) -> ProblemFile {
    read_problem(path, &DataPlaces { data_dir: None, shared: "no such folder".into() }).unwrap()
}

fn count(found: &Value, key: &str) -> u64 {
    found["counts"][key].as_u64().unwrap()
}

/// shared figures of the model: rank at nominal, and once the machine deviates.
#[test]
fn ranks_at_nominal_and_off_it() {
    let expect = [
        ("hexapod-6ups", 138, 66),
        ("hexapod-6pus", 138, 78),
        ("hexapod-6rus", 150, 90),
        ("tripod-3rps", 60, 39),
        ("tripod-3prs", 60, 42),
        ("tripod-3rrs", 66, 48),
    ];
    for (name, structural, at_nominal) in expect {
        let path = file(&format!("problems/{name}.json"));
        for (line, first_order) in [
            ("analyze {0} --json", at_nominal),
            ("analyze {0} --json --perturb 1 --seed 1", structural),
            ("analyze {0} --json --at truth", structural),
        ] {
            let found: Value = serde_json::from_str(&done(line, &[&path]).stdout).unwrap();
            let got = (count(&found, "structural"), count(&found, "first_order"));
            assert_eq!(got, (structural, first_order), "{name}: {line}");
            let listed = |key: &str| -> u64 {
                let each = |entry: &Value| {
                    let limbs = entry["limbs"].as_array().unwrap().len().max(1) as u64;
                    limbs * entry["directions_each"].as_u64().unwrap()
                };
                found[key].as_array().unwrap().iter().map(each).sum()
            };
            assert_eq!(listed("no_first_order_effect"), structural - first_order, "{name}: {line}");
            assert_eq!(listed("weak"), first_order - count(&found, "practical"), "{name}: {line}");
        }
    }
}

/// However small the noise: what has no effect is not kept.
#[test]
fn counts_descend_at_every_point() {
    let golden = GOLDEN.iter().map(|case| golden(case, "problem.json"));
    for path in problems().into_iter().chain(golden) {
        let drawn = problem(&path);
        let machine = &drawn.mechanism;
        let zero = vec![0.0; machine.component_count()];
        let off = gough::simulate::draw_deviations(machine, 5, 0.5);
        for at in [&zero, &off] {
            for noise in [1.0, 1e-9, 1e-15] {
                let weights =
                    gough::measure::Weights::Isotropic { angle: 2e-5 * noise, length: 1e-5 * noise };
                let exact =
                    |s: &Sample| Sample { measurement: s.measurement.reweighted(weights), ..s.clone() };
                let samples: Vec<Sample> = drawn.data.samples.iter().map(exact).collect();
                let counts = visibility(machine, &samples, at).unwrap().counts;
                let ordered =
                    counts.structural >= counts.first_order && counts.first_order >= counts.practical;
                assert!(ordered && counts.practical > 0, "{}: {counts:?}", drawn.name);
            }
        }
    }
}

/// Change of every posture's readings (standard deviations) where the machine moves by `u`, tolerances, from nominal.
fn changes(machine: &Mechanism, samples: &[Sample], u: &[f64]) -> Vec<f64> {
    let sigma: Vec<f64> =
        Coordinates::new(machine, Form::Complete).limbs.iter().flat_map(|limb| limb.sigma.clone()).collect();
    let d: Vec<f64> = u.iter().zip(&sigma).map(|(u, s)| u * s).collect();
    let (before, after) = (machine.nominal(), machine.deviated(&d));
    let mut posture = Posture::new(machine);
    samples
        .iter()
        .filter_map(|sample| {
            sample.close(machine, &before, &mut posture).ok()?;
            let expected = sample.measurement.expected(&View::of_tool(&posture.tool()));
            let moved = Sample { measurement: expected.clone(), ..sample.clone() };
            moved.close(machine, &after, &mut posture).ok()?;
            let mut out = Evaluation::default();
            expected.evaluate(&View::of_tool(&posture.tool()), &mut out);
            Some(out.square().sqrt())
        })
        .collect()
}

#[test]
fn weak_directions_move_no_pose_beyond_its_noise_and_strong_ones_do() {
    for name in ["hexapod-6ups", "hexapod-6pus", "tripod-3rps", "tripod-3rrs", "serial-puma560", "tricept"] {
        let drawn = problem(&file(&format!("problems/{name}.json")));
        let (machine, samples) = (&drawn.mechanism, &drawn.data.samples);
        let zero = vec![0.0; machine.component_count()];
        let found: Analysis = analyze(machine, samples, &zero).unwrap();
        let counts = found.counts;
        assert_eq!(found.unseen.len(), counts.structural - counts.first_order, "{name}");
        assert_eq!(found.weak.len(), counts.first_order - counts.practical, "{name}");
        let largest = |u: &[f64]| changes(machine, samples, u).into_iter().fold(0.0, f64::max);
        let mut worst = 0.0_f64;
        for direction in found.unseen.iter().chain(&found.weak) {
            let size = gough::linalg::norm(&direction.deviations);
            assert!((size - 1.0).abs() < 1e-9, "{name}: {size}");
            for sign in [1.0, -1.0] {
                let u: Vec<f64> = direction.deviations.iter().map(|v| sign * v).collect();
                worst = worst.max(largest(&u));
            }
        }
        assert!(worst < 1.0, "{name}: {worst}");
        let seen = visibility(machine, samples, &zero).unwrap();
        let coordinates = Coordinates::new(machine, Form::Minimal);
        let units = Coordinates::new(machine, Form::Complete);
        let sigma: Vec<f64> = units.limbs.iter().flat_map(|limb| limb.sigma.clone()).collect();
        let (mut strong, mut faint) = (0, 0);
        for k in 0..counts.practical {
            let z: Vec<f64> = seen.directions.col(k).iter().copied().collect();
            let d = coordinates.deviations(&z);
            let u: Vec<f64> = d.iter().zip(&sigma).map(|(d, s)| if *s > 0.0 { d / s } else { 0.0 }).collect();
            // Beyond first order a change near the limit may lie on either side of it.
            match largest(&u) {
                change if change > 1.05 => strong += 1,
                change if change < 0.95 => faint += 1,
                _ => {}
            }
        }
        eprintln!("{name}: {counts:?}, {strong} strong, {faint} by many postures; weak up to {worst:.2}");
        assert!(strong <= counts.practical - found.by_many && faint <= found.by_many, "{name}");
        assert!(counts.practical - strong - faint <= 2, "{name}");
    }
}

#[test]
fn postures_that_add_nothing_are_named() {
    let drawn = problem(&file("problems/tripod-3rps.json"));
    let machine = &drawn.mechanism;
    let mut samples: Vec<Sample> = drawn.data.samples.iter().take(20).cloned().collect();
    // A posture that an instrument a thousand times worse measured.
    let poor = gough::measure::Weights::Isotropic { angle: 2e-2, length: 1e-2 };
    let measurement = samples[3].measurement.reweighted(poor);
    samples[3] = Sample { name: "poor".into(), measurement, ..samples[3].clone() };
    let found = analyze(machine, &samples, &vec![0.0; machine.component_count()]).unwrap();
    let idle: Vec<&str> = found.idle().iter().map(|p| p.name.as_str()).collect();
    assert_eq!(idle, ["poor"]);
    // Leverages sum to the effective number of parameters.
    let sum: f64 = found.postures.iter().map(|p| p.leverage).sum();
    let effective: f64 = found.singular_values.iter().map(|s| s * s / (s * s + 1.0)).sum();
    assert!((sum / effective - 1.0).abs() < 1e-9, "{sum} {effective}");
    // Leaving a posture out costs the information that is stated of it.
    let bits = |samples: &[Sample]| -> f64 {
        let seen = visibility(machine, samples, &vec![0.0; machine.component_count()]).unwrap();
        seen.singular_values.iter().map(|s| 0.5 * (s * s + 1.0).log2()).sum()
    };
    let all = bits(&samples);
    for k in [0, 3, 11] {
        let mut rest = samples.clone();
        rest.remove(k);
        let (lost, stated) = (all - bits(&rest), found.postures[k].bits);
        assert!((lost - stated).abs() < 1e-6 * (1.0 + stated), "{lost} {stated}");
    }
}

#[test]
fn the_words_name_joints_and_limbs() {
    let text = done("analyze {0}", &[&file("problems/hexapod-6ups.json")]).stdout;
    for part in [
        "limb6: 23 = 4*5 + 2*1 + 6 - 5 passive",
        "72 combinations have no first-order effect there",
        "in each of limb1, limb2, limb3, limb4, limb5, limb6: rotation of base's first axis about both directions \
         square to its axis (2 directions)",
        "rotation of ball's third axis",
        "postures by what they add to the others",
    ] {
        assert!(text.contains(part), "{part}\n{text}");
    }
    assert!(text.lines().all(|line| line.len() < 800), "{text}");
}

#[test]
fn planned_postures_are_analysed_and_not_identified_from() {
    let folder = tempfile::tempdir().unwrap();
    let mut drawn = support::json(&file("problems/tripod-3rps.json"));
    let measured: Value =
        serde_json::from_str(&done("analyze {0} --json", &[&file("problems/tripod-3rps.json")]).stdout)
            .unwrap();
    for sample in drawn["data"]["samples"].as_array_mut().unwrap() {
        sample.as_object_mut().unwrap().remove("pose");
    }
    let planned = write(folder.path(), "planned.json", &drawn);
    let text = done("analyze {0}", &[&planned]).stdout;
    assert!(text.contains("60 planned postures, 360 readings"), "{text}");
    let found: Value = serde_json::from_str(&done("analyze {0} --json", &[&planned]).stdout).unwrap();
    assert_eq!(found["counts"], measured["counts"]);
    let values = numbers(&found["singular_values"]).into_iter().zip(numbers(&measured["singular_values"]));
    assert!(values.take(39).all(|(a, b)| (a / b - 1.0).abs() < 1e-6));
    let ran = gough("identify {0}", &[&planned]);
    assert!(ran.status == 2 && ran.stderr.contains("sample 1") && ran.stderr.contains("planned"), "{ran:?}");
    // Readings alone in a table.
    let names = ["q1", "q2", "q3"].join(",");
    let rows: Vec<String> = drawn["data"]["samples"]
        .as_array()
        .unwrap()
        .iter()
        .map(|s| numbers(&s["actuators"]).iter().map(f64::to_string).collect::<Vec<_>>().join(","))
        .collect();
    std::fs::write(folder.path().join("plan.csv"), format!("{names}\n{}\n", rows.join("\n"))).unwrap();
    drawn["data"].as_object_mut().unwrap().remove("samples");
    drawn["data"]["file"] = json!("plan.csv");
    let table = write(folder.path(), "table.json", &drawn);
    let again: Value = serde_json::from_str(&done("analyze {0} --json", &[&table]).stdout).unwrap();
    assert_eq!(again["singular_values"], found["singular_values"]);
}

#[test]
fn uncertainty_from_the_command_line() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    // In millimetres and degrees.
    let drawn = file("problems/hexapod-640.json");
    let text = done("identify {0} --cross-validate 6 --seed 2 -o {1}", &[&drawn, &at("result.json")]).stdout;
    assert!(text.contains("left out") && text.contains("6 folds"), "{text}");
    assert!(text.contains("chi-square") && text.contains("error: "), "{text}");
    let result = support::json(&at("result.json"));
    assert_eq!(result["cross_validation"]["folds"], 6);
    assert!(result["chi_square"]["verdict"].as_str().unwrap().contains("noise"));
    let shares = result["links"].as_array().unwrap().iter().flat_map(|link| {
        [numbers(&link["prior_share"]["rotation"]), numbers(&link["prior_share"]["translation"])].concat()
    });
    let shares: Vec<f64> = shares.collect();
    assert!(shares.iter().all(|share| (0.0..=1.0 + 1e-9).contains(share)));
    assert!(shares.iter().any(|share| *share > 0.9) && shares.iter().any(|share| *share < 0.1));
    let readings = write(
        folder.path(),
        "readings.json",
        &json!({"samples": support::json(&drawn)["data"]["samples"].as_array().unwrap()[..4]}),
    );
    let paths: &[&Path] = &[&at("result.json"), &readings, &at("poses.json"), &at("poses.csv"), &drawn];
    done("predict {0} --actuators {1} --uncertainty -o {2}", paths);
    done("predict {0} --actuators {1} --uncertainty -o {3}", paths);
    let poses = support::json(&at("poses.json"));
    let noise = &support::json(&drawn)["data"]["noise"];
    for sample in poses["samples"].as_array().unwrap() {
        for (key, noise_key) in [("position", "length"), ("rotation", "angle")] {
            let (std, noise) = (numbers(&sample["std"][key]), noise[noise_key].as_f64().unwrap());
            // Forty-odd poses know each predicted one better than a single measurement does.
            assert!(std.iter().all(|s| *s > 0.05 * noise && *s < noise), "{key}: {std:?} {noise}");
        }
        let covariance: Vec<Vec<f64>> =
            sample["covariance"].as_array().unwrap().iter().map(numbers).collect();
        let std = [numbers(&sample["std"]["rotation"]), numbers(&sample["std"]["position"])].concat();
        assert!((0..6).all(|i| (covariance[i][i].sqrt() / std[i] - 1.0).abs() < 1e-9));
    }
    let table = std::fs::read_to_string(at("poses.csv")).unwrap();
    assert!(table.lines().next().unwrap().ends_with("x,y,z,rx,ry,rz,sx,sy,sz,srx,sry,srz"));
    done("predict {0} --actuators {3}", paths);
    let ran = gough("predict {4} --actuators {1} --uncertainty", paths);
    assert!(ran.status == 2 && ran.stderr.contains("states none"), "{ran:?}");
    for line in ["identify {4} --cross-validate 1", "identify {4} --cross-validate many"] {
        let ran = gough(line, paths);
        assert!(ran.status == 2 && ran.stderr.contains("--cross-validate"), "{ran:?}");
    }
    for (line, word) in [("analyze {4} --perturb -1", "--perturb"), ("analyze {4} --at moon", "moon")] {
        let ran = gough(line, paths);
        assert!(ran.status == 2 && ran.stderr.contains(word), "{ran:?}");
    }
}
