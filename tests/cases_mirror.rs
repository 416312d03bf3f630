//! Fixed points measured by distances from targets that lie almost in one plane: the right side, or a word that it is not
//! known.

mod support;

use gough::files::{DataPlaces, ProblemFile, read_problem};
use gough::identify::identify;
use gough::solve::Stop;
use gough::solve::map::Map;
use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;
use std::path::{Path, PathBuf};
use support::{file, gough, json, write};

/// A point farther than this from where it is stands on the wrong side, m.
const WRONG: f64 = 0.03;

fn case(name: &str) -> PathBuf {
    file(&format!("tests/data/cases/mirror/{name}"))
}

/// Result and warnings of `gough identify`.
fn identified(problem: &Path) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let result = folder.path().join("result.json");
    let ran = gough("identify {0} -o {1}", &[problem, &result]);
    assert!(ran.status == 0, "{ran:?}");
    json(&result)
}

fn place(values: impl Fn(&str) -> f64, point: &str) -> Vector3<f64> {
    let at = |axis: &str| values(&format!("point {point} {axis}"));
    Vector3::new(at("x"), at("y"), at("z"))
}

fn found(result: &Value, name: &str) -> f64 {
    let all = result["instrument"].as_array().unwrap();
    all.iter().find(|constant| constant["name"] == name).unwrap()["value"].as_f64().unwrap()
}

/// Points that stand elsewhere than in truth, and whether a warning names each.
fn wrong(problem: &Value, result: &Value, points: &[&str]) -> Vec<(String, bool)> {
    let warned = |point: &str| {
        let words = format!("plane of its targets point {point} stands");
        result["warnings"].as_array().unwrap().iter().any(|w| w.as_str().unwrap().contains(&words))
    };
    let truth = |name: &str| problem["truth_instrument"][name].as_f64().unwrap();
    let away = |point: &str| (place(|n| found(result, n), point) - place(truth, point)).norm();
    let elsewhere = points.iter().filter(|point| away(point) > WRONG);
    elsewhere.map(|point| ((*point).to_owned(), warned(point))).collect()
}

/// 60 distances of four free points from a SCARA that moves by 2 mm in z: point c at z = -0.3505, chi-square 47.1, as where
/// the points are stated to a centimetre.
#[test]
fn a_point_changes_sides_after_the_machine_is_identified() {
    let free = case("free-point-scara-618-free.json");
    let right = identified(&case("free-point-scara-618-right.json"));
    let result = identified(&free);
    assert!(wrong(&json(&free), &result, &["a", "b", "c", "e"]).is_empty(), "{}", result["instrument"]);
    assert!((found(&result, "point c z") + 0.3505).abs() < 5e-4);
    let chi = |of: &Value| of["chi_square"]["value"].as_f64().unwrap();
    assert!((chi(&result) - 47.1).abs() < 0.1, "{}", result["chi_square"]);
    assert!((chi(&result) - chi(&right)).abs() < 0.05);
    assert!(!result["warnings"].to_string().contains("on which side"), "{}", result["warnings"]);
    // What every estimator says, and what the library says that it did.
    let problem = read(&free);
    let found =
        identify(&problem.mechanism, &problem.data.samples, &Map::default(), &Stop::default()).unwrap();
    assert_eq!(found.sides.changed, ["point c"]);
    assert!(found.sides.undecided.is_empty());
}

/// Four readings a point, of targets nearly in one plane: e.x is 0.015 or 0.433, and the readings do not tell which.
#[test]
fn readings_that_do_not_tell_the_side_say_so() {
    let path = case("bad-arm-5r-distance-free-505.json");
    let result = identified(&path);
    let elsewhere = wrong(&json(&path), &result, &["a", "b", "c", "e"]);
    assert!(elsewhere.iter().all(|(_, warned)| *warned), "{elsewhere:?}");
    let words = result["warnings"].as_array().unwrap().iter().map(|w| w.as_str().unwrap());
    let words: Vec<&str> = words.filter(|w| w.contains("on which side")).collect();
    let [word] = words[..] else { panic!("{words:?}") };
    for part in ["point e", "0.4330", "0.01545", "state its position"] {
        assert!(word.contains(part), "{part}: {word}");
    }
}

fn read(path: &Path) -> ProblemFile {
    read_problem(path, &DataPlaces::from_environment(None)).unwrap()
}

/// The problem with its points elsewhere, measured anew; the points are free. Its file is in `folder`.
fn simulated(folder: &Path, base: &str, stroke: Option<f64>, poses: usize, seed: u64) -> PathBuf {
    let mut drawn = json(&case(base));
    let content = drawn.as_object_mut().unwrap();
    let truth = content.remove("truth_instrument").unwrap();
    content.remove("truth");
    drawn["data"].as_object_mut().unwrap().remove("samples");
    drawn["data"].as_object_mut().unwrap().remove("holdout");
    if let Some(stroke) = stroke {
        for joint in drawn["mechanism"]["limbs"][0]["joints"].as_array_mut().unwrap() {
            if joint["type"] == "prismatic" {
                joint["range"] = serde_json::json!([-stroke / 2.0, stroke / 2.0]);
            }
        }
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    for (name, point) in drawn["data"]["instrument"]["points"].as_object_mut().unwrap() {
        let at = place(|n| truth[n].as_f64().unwrap(), name);
        let at = at.map(|v| v + 0.2 * (rng.random::<f64>() - 0.5));
        *point = serde_json::json!({"position": [at.x, at.y, at.z], "tolerance": 1e-3});
    }
    let (drawn, measured) = (write(folder, "drawn.json", &drawn), folder.join("measured.json"));
    let line = format!("simulate {{0}} --poses {poses} --seed {seed} -o {{1}}");
    support::done(&line, &[&drawn, &measured]);
    let mut problem = json(&measured);
    for point in problem["data"]["instrument"]["points"].as_object_mut().unwrap().values_mut() {
        *point = serde_json::json!({"tolerance": "free"});
    }
    write(folder, "free.json", &problem)
}

/// How many points stand on the wrong side, and how many problems say that they do not know; none is wrong without a word.
fn judged(base: &str, stroke: Option<f64>, poses: usize, seed: u64) -> (usize, usize) {
    let folder = tempfile::tempdir().unwrap();
    let problem = simulated(folder.path(), base, stroke, poses, seed);
    let result = folder.path().join("result.json");
    let ran = gough("identify {0} -o {1}", &[&problem, &result]);
    assert!(ran.status < 2, "{ran:?}");
    let result = json(&result);
    let elsewhere = wrong(&json(&problem), &result, &["a", "b", "c", "e"]);
    let said = elsewhere.iter().all(|(_, warned)| *warned);
    assert!(said || result["converged"] == false, "{base}, {stroke:?}, {poses}, {seed}: {elsewhere:?}");
    (elsewhere.len(), usize::from(result["warnings"].to_string().contains("on which side")))
}

fn campaign(each: u64) {
    const SCARA: &str = "free-point-scara-618-free.json";
    const ARM: &str = "bad-arm-5r-distance-free-505.json";
    let poses = |seed: u64| 4 * (3 + seed as usize % 4);
    for stroke in [0.0002, 0.0007, 0.002, 0.01] {
        let all: Vec<_> = (0..each).map(|seed| judged(SCARA, Some(stroke), 60, 700 + seed)).collect();
        println!("SCARA, {stroke} m: wrong and undecided {all:?}");
        // At 0.7 mm one of 20 draws (seed 702) has 17.9 of chi-square between the sides of point c, less than decides: that
        // is said, and the side is right. 2 mm and more tell every side.
        assert!(stroke < 0.0005 || all.iter().all(|(wrong, _)| *wrong == 0));
        assert!(stroke < 0.002 || all.iter().all(|(_, undecided)| *undecided == 0));
    }
    let all: Vec<_> = (0..each).map(|seed| judged(ARM, None, poses(seed), 800 + seed)).collect();
    println!("arms, 3 to 6 readings a point: wrong and undecided {all:?}");
}

#[test]
fn no_point_is_on_the_wrong_side_without_a_word() {
    campaign(4);
}

#[test]
#[ignore = "the whole campaign: half a minute"]
fn no_point_of_a_hundred_problems_is_on_the_wrong_side_without_a_word() {
    campaign(20);
}
