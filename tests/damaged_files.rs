//! Files of noise, damaged files, and files that cannot be written: an error, fast, and never a panic.

mod spoiled;
mod support;

use gough::files::problem::{parse_model, parse_problem};
use gough::files::{Output, read_actuators, read_problem};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};
use spoiled::{assert_message, hexapod, places};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

const TABLE: &str = "q1,q2,q3,q4,q5,q6,x,y,z,rx,ry,rz\n0,0,0,0,0,0,0,0,0.9,0,0,0\n1,1,1,1,1,1,,,,0,0,0\n";

#[test]
fn damaged_files_never_panic() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let texts = [
        fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/golden/serial-6r/problem.json"))
            .unwrap(),
        hexapod().to_string().into_bytes(),
    ];
    for text in texts {
        for round in 0..1500 {
            let mut damaged = text.clone();
            if round % 3 == 0 {
                damaged.truncate(rng.random_range(0..text.len()));
            }
            for _ in 0..rng.random_range(0..4) {
                if !damaged.is_empty() {
                    let at = rng.random_range(0..damaged.len());
                    damaged[at] = if rng.random() {
                        rng.random()
                    } else {
                        b"0123456789-eE.,[]{}\""[rng.random_range(0..20)]
                    };
                }
            }
            if let Err(error) = parse_problem(Path::new("m.json"), &damaged, &places()) {
                assert!(error.to_string().starts_with("m.json"), "{error}");
            }
            let _ = parse_model(Path::new("m.json"), &damaged);
        }
    }
    let text = TABLE.as_bytes();
    for _ in 0..300 {
        let mut damaged = text.to_vec();
        for _ in 0..3 {
            let at = rng.random_range(0..damaged.len());
            damaged[at] = rng.random();
        }
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("d.csv"), damaged).unwrap();
        let mut problem = hexapod();
        problem["data"] = json!({"file": "d.csv"});
        let path = folder.path().join("m.json");
        let _ = parse_problem(&path, problem.to_string().as_bytes(), &places());
    }
}

/// Blanks around a name do not belong to it; what is not UTF-8 is said.
#[test]
fn blanks_around_names_and_other_encodings() {
    let folder = tempfile::tempdir().unwrap();
    let mut problem = support::json(&support::file("problems/serial-scara.json"));
    problem["mechanism"]["limbs"][0]["joints"][0]["name"] = json!("  sh 1 ");
    problem["mechanism"]["limbs"][0]["name"] = json!(" my arm ");
    let samples = problem["data"]["samples"].as_array().unwrap().clone();
    let mut table = "my arm.sh 1,my arm.elbow,my arm.quill,my arm.wrist,x,y,z,rx,ry,rz\n".to_owned();
    for sample in samples.iter().take(20) {
        let lists = [&sample["actuators"], &sample["pose"]["position"], &sample["pose"]["rotation"]];
        let cells = lists.into_iter().flat_map(|list| list.as_array().unwrap()).map(Value::to_string);
        table += &(cells.collect::<Vec<_>>().join(",") + "\n");
    }
    fs::write(folder.path().join("t.csv"), &table).unwrap();
    problem["data"] = json!({"noise": problem["data"]["noise"], "file": "t.csv"});
    let (path, out) = (support::write(folder.path(), "p.json", &problem), folder.path().join("r.json"));
    support::done("identify {0} -o {1}", &[&path, &out]);
    assert_eq!(support::json(&out)["links"][0]["link"], "sh 1");
    let latin =
        |text: &str| text.replace("sh 1", "gr\u{f6}\u{df}e").chars().map(|c| c as u8).collect::<Vec<u8>>();
    fs::write(folder.path().join("t.csv"), latin(&table)).unwrap();
    let ran = support::gough("identify {0}", &[&path]);
    assert!(
        ran.status == 2 && ran.stderr.contains("t.csv: not a CSV table: it is not UTF-8 text (line 1)"),
        "{ran:?}"
    );
    fs::write(&path, latin(&problem.to_string())).unwrap();
    let ran = support::gough("identify {0}", &[&path]);
    assert!(ran.status == 2 && ran.stderr.contains("it is not UTF-8 text (line 1 column"), "{ran:?}");
}

#[test]
fn a_hundred_megabytes_of_garbage_are_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("garbage.json");
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut noise = vec![0_u8; 1 << 20];
    rng.fill(noise.as_mut_slice());
    for beginning in [&b"\x7fELF"[..], b"{", b"{\"format\": \"gough-problem/1\", \"name\": \"", b"a,b,c\n"] {
        let mut garbage = beginning.to_vec();
        (0..100).for_each(|_| garbage.extend_from_slice(&noise));
        fs::write(&path, garbage).unwrap();
        let model = parse_model(Path::new("m.json"), hexapod().to_string().as_bytes()).unwrap();
        let begin = Instant::now();
        let error = read_problem(&path, &places()).unwrap_err().to_string();
        assert_message(&error, &["garbage.json", "not JSON"]);
        assert!(read_actuators(&path, &model).is_err());
        fs::rename(&path, folder.path().join("d.csv")).unwrap();
        assert!(read_actuators(&folder.path().join("d.csv"), &model).is_err());
        assert!(begin.elapsed() < Duration::from_secs(3), "{:?}", begin.elapsed());
    }
}

#[test]
fn outputs_that_cannot_be_written() {
    let folder = tempfile::tempdir().unwrap();
    let file = |path: PathBuf| Output::named(Some(&path));
    let refused = |output: &Output, part: &str| {
        assert_message(&output.check().unwrap_err().to_string(), &["cannot be written", part]);
        assert!(output.write(b"text").is_err());
    };
    refused(&file(folder.path().join("no/such/r.json")), "there is no folder");
    refused(&file(folder.path().to_owned()), "it is a folder");
    let kept = folder.path().join("kept.json");
    fs::write(&kept, "old").unwrap();
    let mut permissions = fs::metadata(&kept).unwrap().permissions();
    permissions.set_readonly(true);
    fs::set_permissions(&kept, permissions).unwrap();
    refused(&file(kept.clone()), "read-only");
    assert_eq!(fs::read_to_string(&kept).unwrap(), "old");
    let output = file(folder.path().join("r.json"));
    output.check().unwrap();
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    output.write(b"first").unwrap();
    output.write(b"second").unwrap();
    assert_eq!(fs::read_to_string(folder.path().join("r.json")).unwrap(), "second");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    assert_eq!(Output::named(Some(Path::new("-"))), Output::Stdout);
}
