//! The commands as a user meets them.

mod support;

use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use support::{apart, command, done, errors, file, gough, json, poses, ran, units, write};

/// A 6-UPS machine of one's own: the example in other units' worth of size, 1.4 times as large and 1.2 times as high.
fn own_machine(folder: &Path) -> PathBuf {
    let mut problem = json(&file("problems/hexapod-6ups.json"));
    let resize = |point: &mut Value| {
        for (value, factor) in point.as_array_mut().unwrap().iter_mut().zip([1.4, 1.4, 1.2]) {
            *value = json!(value.as_f64().unwrap() * factor);
        }
    };
    problem["name"] = json!("my-hexapod");
    resize(&mut problem["mechanism"]["tool"]["position"]);
    for limb in problem["mechanism"]["limbs"].as_array_mut().unwrap() {
        let foot = limb["joints"][0]["point"].clone();
        for joint in limb["joints"].as_array_mut().unwrap() {
            resize(&mut joint["point"]);
        }
        // The leg still points from its foot to its ball.
        let ends = [&limb["joints"][0]["point"], &limb["joints"][2]["point"]].map(support::numbers);
        let axis: Vec<f64> = ends[1].iter().zip(&ends[0]).map(|(ball, foot)| ball - foot).collect();
        limb["joints"][1]["axis"] = json!(axis);
        assert_ne!(limb["joints"][0]["point"], foot);
    }
    problem["data"] = json!({"noise": {"angle": 2e-5, "length": 1e-5}});
    problem.as_object_mut().unwrap().remove("truth");
    write(folder, "mine.json", &problem)
}

#[test]
fn from_a_drawing_of_ones_own_to_a_calibrated_machine() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let mine = own_machine(folder.path());

    // What would 60 random poses reveal? Nothing has been measured yet.
    let ran = done("analyze {0}", &[&mine]);
    assert!(ran.stdout.contains("random postures (the problem has no samples)"), "{}", ran.stdout);
    assert!(ran.stdout.contains("138  structural") && ran.stdout.contains("limb6: 23 = 4*5 + 2*1 + 6 - 5"));

    let ran = done("simulate {0} --poses 40 --seed 7 -o {1}", &[&mine, &at("measured.json")]);
    assert!(ran.stdout.is_empty());
    let measured = json(&at("measured.json"));
    assert_eq!(measured["name"], "my-hexapod");
    assert_eq!(measured["data"]["samples"].as_array().unwrap().len(), 40);
    assert!(measured["data"]["origin"].as_str().unwrap().contains("--poses 40"));
    assert!(measured["data"]["origin"].as_str().unwrap().contains("--seed 7"));

    let ran = done("identify {0} -o {1}", &[&at("measured.json"), &at("result.json")]);
    for part in
        ["my-hexapod: 6 limbs, 30 angular and 6 prismatic joints, 6 actuated", "40 postures", "hold-out"]
    {
        assert!(ran.stdout.contains(part), "{}", ran.stdout);
    }
    let largest =
        ran.stdout.lines().filter(|line| line.contains(" +- ") && line.contains("tolerances")).count();
    assert_eq!(largest, 5, "{}", ran.stdout);
    let result = json(&at("result.json"));
    assert_eq!((&result["format"], &result["converged"]), (&json!("gough-result/1"), &json!(true)));
    let holdout = &result["holdout"];
    let rms = |when: &str| holdout[when]["position_rms"].as_f64().unwrap();
    assert!(rms("before") > 5e-4 && rms("after") < 2e-5, "{holdout}");

    // The result is a model: its predictions are those that the report scored.
    let readings =
        write(folder.path(), "holdout.json", &json!({"samples": measured["data"]["holdout"]["samples"]}));
    let paths: &[&Path] = &[&at("result.json"), &readings, &at("poses.json"), &at("poses.csv")];
    done("predict {0} --actuators {1} -o {2}", paths);
    done("predict {0} --actuators {1} -o {3}", paths);
    let predicted = poses(&json(&at("poses.json")), (1.0, 1.0));
    let found = errors(&predicted, &poses(&measured["data"]["holdout"], (1.0, 1.0)));
    assert!((found.position_rms / rms("after") - 1.0).abs() < 1e-9);
    let rotation = holdout["after"]["rotation_rms"].as_f64().unwrap();
    assert!((found.rotation_rms / rotation - 1.0).abs() < 1e-9);
    let table = std::fs::read_to_string(at("poses.csv")).unwrap();
    assert!(
        table.starts_with("limb1.leg,limb2.leg,limb3.leg,limb4.leg,limb5.leg,limb6.leg,x,y,z,rx,ry,rz\n")
    );
    assert_eq!(table.lines().count(), 41);
    // Poses are readings again.
    let ran = done("predict {0} --actuators {3}", paths);
    let again = poses(&serde_json::from_str(&ran.stdout).unwrap(), (1.0, 1.0));
    assert!(again.iter().zip(&predicted).all(|(a, b)| apart(a, b) == (0.0, 0.0)));
}

#[test]
fn analysis_for_people_and_for_programs() {
    let problem = file("problems/tripod-3rps.json");
    let found: Value = serde_json::from_str(&done("analyze {0} --json", &[&problem]).stdout).unwrap();
    let keys: Vec<&String> = found.as_object().unwrap().keys().collect();
    assert_eq!(keys, ["counts", "observability", "singular_values"]);
    let counts = &found["counts"];
    assert_eq!(counts["structural"], 60);
    let values = support::numbers(&found["singular_values"]);
    assert_eq!(values.len(), 60);
    let practical = values.iter().filter(|s| **s > 1.0).count();
    assert_eq!(counts["practical"], practical);
    let indices = &found["observability"];
    assert_eq!(indices["directions"], practical);
    let smallest = values.iter().copied().filter(|s| *s > 1.0).fold(f64::INFINITY, f64::min);
    assert_eq!(indices["o3"].as_f64().unwrap(), smallest);
    let text = done("analyze {0}", &[&problem]).stdout;
    assert!(
        text.contains(&format!("observability over the {practical} values above 1 (60 poses)")),
        "{text}"
    );
    for (count, word) in
        [("structural", "structural"), ("first_order", "first order"), ("practical", "practical")]
    {
        assert!(text.contains(&format!("{:>5}  {word}", counts[count].as_u64().unwrap())), "{text}");
    }
}

#[test]
fn solvers_are_listed_and_run() {
    let listed = done("solvers", &[]).stdout;
    let names: Vec<&str> = listed.lines().map(|line| line.split_whitespace().next().unwrap()).collect();
    assert_eq!(names[0], "minimal");
    assert!(names.contains(&"textbook") && names.len() >= 3);
    assert!(listed.lines().all(|line| line.len() > 20 && line.contains("  ")));
    let folder = tempfile::tempdir().unwrap();
    for name in names {
        let out = folder.path().join(format!("{name}.json"));
        let problem = file("tests/data/golden/serial-6r/problem.json");
        let ran = ran(command().args(["identify", "--solver", name, "-o"]).arg(&out).arg(problem));
        let result = json(&out);
        assert_eq!(result["solver"], name);
        assert_eq!(ran.status, i32::from(result["converged"] == false), "{name}: {}", result["reason"]);
    }
}

#[test]
fn a_fraction_is_held_out_by_seed() {
    let folder = tempfile::tempdir().unwrap();
    let problem = file("tests/data/golden/serial-6r/problem.json");
    let out = |name: &str| folder.path().join(name);
    let run = |seed: &str, name: &str| {
        let line = format!("identify {{0}} --holdout 0.25 --seed {seed} -o {{1}}");
        let text = done(&line, &[&problem, &out(name)]).stdout;
        (text, std::fs::read(out(name)).unwrap())
    };
    let (a, b, c) = (run("3", "a.json"), run("3", "b.json"), run("4", "c.json"));
    assert_eq!(a, b);
    assert_ne!(a.1, c.1);
    let count = json(&problem)["data"]["samples"].as_array().unwrap().len();
    let left = count - (0.25 * count as f64).round() as usize;
    assert!(a.0.contains(&format!("{left} postures, {} readings", 6 * left)), "{}", a.0);
    let result = json(&out("a.json"));
    let rms = |when: &str| result["holdout"][when]["position_rms"].as_f64().unwrap();
    assert!(rms("before") > 20.0 * rms("after"), "{}", result["holdout"]);
    // All of them train without it.
    assert!(done("identify {0}", &[&problem]).stdout.contains(&format!("\n{count} postures")));
}

#[test]
fn json_on_standard_output_and_the_summary_beside_it() {
    let problem = file("problems/tricept.json");
    let ran = gough("identify {0} -o -", &[&problem]);
    assert_eq!(ran.status, 0);
    let result: Value = serde_json::from_str(&ran.stdout).unwrap();
    assert_eq!(result["problem"], "tricept");
    assert!(ran.stderr.starts_with("tricept: ") && ran.stderr.contains("hold-out"), "{}", ran.stderr);
    assert_eq!(done("identify {0}", &[&problem]).stdout, ran.stderr);
}

/// Bytes do not depend on the number of threads, nor on the run.
#[test]
fn one_thread_or_two() {
    let folder = tempfile::tempdir().unwrap();
    let mut problem = json(&file("problems/hexapod-6ups.json"));
    // More postures than one thread takes at a time.
    problem["data"].as_object_mut().unwrap().remove("samples");
    let problem = write(folder.path(), "many.json", &problem);
    let many = folder.path().join("measured.json");
    done("simulate {0} --poses 300 --seed 5 -o {1}", &[&problem, &many]);
    let outputs: Vec<[Vec<u8>; 3]> = ["1", "2", "2"]
        .iter()
        .map(|threads| {
            let result = folder.path().join("result.json");
            let run = |arguments: &[&str], paths: &[&Path]| {
                let mut command = command();
                command.env("RAYON_NUM_THREADS", threads).args(arguments).args(paths);
                ran(&mut command).stdout.into_bytes()
            };
            let text = run(&["identify", "-o"], &[&result, &many]);
            let analysis = run(&["analyze", "--json"], &[&many]);
            [text, std::fs::read(&result).unwrap(), analysis]
        })
        .collect();
    assert!(outputs[0].iter().all(|bytes| !bytes.is_empty()));
    assert!(outputs.iter().all(|other| *other == outputs[0]));
}

/// Numbers of a problem in mm and degrees come back in mm and degrees.
#[test]
fn results_are_in_units_of_the_problem() {
    let folder = tempfile::tempdir().unwrap();
    let (problem, out) = (file("problems/hexapod-640.json"), folder.path().join("result.json"));
    let text = done("identify {0} -o {1}", &[&problem, &out]).stdout;
    assert!(text.contains("rms/mm") && text.contains("rms/deg"), "{text}");
    let (result, stated) = (json(&out), json(&problem));
    assert_eq!(result["units"], stated["units"]);
    assert_eq!(units(&result), (1e-3, 1f64.to_radians()));
    // From tolerances of half a millimetre, to about the noise of 15 micrometres.
    let rms = |when: &str| result["holdout"][when]["position_rms"].as_f64().unwrap();
    assert!(rms("before") > 0.5 && rms("after") < 0.03, "{}", result["holdout"]);
    let (found, drawn) = (&result["mechanism"]["tool"]["position"], &stated["mechanism"]["tool"]["position"]);
    let pairs = support::numbers(found).into_iter().zip(support::numbers(drawn));
    assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 5.0));
}

#[test]
fn help_and_version() {
    for line in ["--help", "identify --help", "--version"] {
        assert!(!done(line, &[]).stdout.is_empty());
    }
    assert!(done("--version", &[]).stdout.contains(env!("CARGO_PKG_VERSION")));
}
