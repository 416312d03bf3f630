//! problems/kinds: each is identified from what it measures, and predicts what it did not use to its noise.

mod support;

use std::collections::BTreeMap;
use support::{file, gough, json};

/// Of each problem, its kinds and the error of the hold-out (exact readings) that it stays below, in its noise.
const LEVELS: [(&str, &str, f64); 6] = [
    ("delta-3puu-separation", "separation", 1.0),
    ("hexapod-6ups-distance", "distance", 1.0),
    ("hexapod-6ups-passive", "passive-joint", 1.0),
    ("hexapod-6ups-plane", "plane", 1.0),
    ("serial-puma560-mixed", "position pose", 1.0),
    ("serial-puma560-position", "position", 1.0),
];

#[test]
fn every_kind_has_its_problem_and_stays_at_its_level() {
    let entries = std::fs::read_dir(file("problems/kinds")).unwrap();
    let mut found: Vec<String> = entries.map(|e| support::name(&e.unwrap().path())).collect();
    found.sort();
    assert_eq!(found, LEVELS.map(|(name, _, _)| name));
    let index = std::fs::read_to_string(file("problems/README.md")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let mut after = BTreeMap::new();
    for (name, kinds, level) in LEVELS {
        let path = file(&format!("problems/kinds/{name}.json"));
        assert!(std::fs::metadata(&path).unwrap().len() < 64_000, "{name}");
        let problem = json(&path);
        let data = &problem["data"];
        let sets = data["sets"].as_array().cloned().unwrap_or_else(|| vec![data.clone()]);
        let stated: Vec<&str> = sets.iter().map(|set| set["kind"].as_str().unwrap_or("pose")).collect();
        assert_eq!(stated.join(" "), kinds, "{name}");
        assert!(data["origin"].as_str().is_some_and(|origin| origin.contains("seed")), "{name}");
        assert!(index.contains(&format!("[kinds/{name}](kinds/{name}.json)")), "{name}");
        let out = folder.path().join("result.json");
        let ran = gough("identify {0} -o {1}", &[&path, &out]);
        assert!(ran.status == 0, "{name}: {ran:?}");
        let result = json(&out);
        let of = |when: &str| result["holdout"][when]["weighted_rms"].as_f64().unwrap();
        assert!(of("after") < level && of("before") > 5.0 * of("after"), "{name}: {}", result["holdout"]);
        let test = result["chi_square"]["probability"].as_f64().unwrap();
        assert!(test > 1e-3, "{name}: {}", result["chi_square"]);
        after.insert(name, of("after"));
    }
    eprintln!("hold-out in noise: {after:?}");
}
