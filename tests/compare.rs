//! `gough compare` as a user meets it: resumed, divided, merged, killed, and wrong.

mod support;

use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};
use support::{COMPARISON_FIGURES, command, done, file, gough, json, ran, write};

/// Lines of a result file without what may differ between two equal runs.
fn lines(path: &Path) -> Vec<String> {
    let text = fs::read_to_string(path).unwrap();
    assert!(text.ends_with('\n'));
    let strip = |line: &str| {
        let mut value: Value = serde_json::from_str(line).unwrap();
        assert_eq!(value["format"], "gough-run/1");
        assert!(value.as_object_mut().unwrap().remove("cost").is_some());
        value.to_string()
    };
    text.lines().map(strip).collect()
}

fn puma() -> PathBuf {
    file("problems/serial-puma560.json")
}

fn scara() -> PathBuf {
    file("problems/serial-scara.json")
}

/// A campaign of 2 problems x 2 noises x 2 starts x 2 seeds x 3 identifiers.
const CAMPAIGN: &str =
    "compare {0} {1} --solvers minimal,map,argmin-lm --seeds 2 --noise 1,0.1 --start 0,5 -o {2}";

#[test]
fn equal_campaigns_give_equal_lines_whatever_the_threads_parts_and_interruptions() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let arguments = |out: &str, more: &str| {
        let line = format!("{CAMPAIGN} {more}");
        let paths = [puma(), scara(), at(out)];
        let words = line.split_whitespace().map(|word| match word {
            "{0}" => paths[0].clone().into_os_string(),
            "{1}" => paths[1].clone().into_os_string(),
            "{2}" => paths[2].clone().into_os_string(),
            word => word.into(),
        });
        words.collect::<Vec<_>>()
    };
    let run = |out: &str, more: &str, threads: &str| {
        let ran = ran(command().args(arguments(out, more)).env("RAYON_NUM_THREADS", threads));
        assert_eq!(ran.status, 0, "{}", ran.stderr);
        ran
    };
    let first = run("a", "", "1");
    let whole = lines(&at("a/runs.jsonl"));
    assert_eq!(whole.len(), 48);
    assert!(first.stdout.contains("| minimal | 16 | 100 % |"), "{}", first.stdout);
    run("b", "", "3");
    assert_eq!(lines(&at("b/runs.jsonl")), whole);

    // In parts, merged in any order.
    run("c", "--shard 1/3", "2");
    run("c", "--shard 2/3", "2");
    run("c", "--shard 3/3", "2");
    let parts: Vec<PathBuf> = (1..=3).map(|k| at(&format!("c/runs-{k}-of-3.jsonl"))).collect();
    let merge = |order: [usize; 3], out: &str| {
        let files = order.map(|k| parts[k].as_path());
        done("compare --merge {0} {1} {2} -o {3}", &[files[0], files[1], files[2], &at(out)]).stdout
    };
    let summary = merge([0, 1, 2], "d");
    assert_eq!(merge([2, 0, 1], "e"), summary);
    assert_eq!(fs::read(at("d/runs.jsonl")).unwrap(), fs::read(at("e/runs.jsonl")).unwrap());
    assert_eq!(fs::read(at("d/index.html")).unwrap(), fs::read(at("e/index.html")).unwrap());
    let sorted = |mut lines: Vec<String>| {
        lines.sort();
        lines
    };
    assert_eq!(sorted(lines(&at("d/runs.jsonl"))), sorted(whole.clone()));

    // A torn last line is made again, and nothing else.
    let text = fs::read_to_string(at("a/runs.jsonl")).unwrap();
    fs::write(at("a/runs.jsonl"), &text[..text.len() - 40]).unwrap();
    let resumed = run("a", "", "2");
    assert!(resumed.stderr.contains("47 of 48 runs are there already"), "{}", resumed.stderr);
    assert_eq!(lines(&at("a/runs.jsonl")), whole);
    let again = fs::read_to_string(at("a/runs.jsonl")).unwrap();
    assert_eq!(again.lines().take(47).collect::<Vec<_>>(), text.lines().take(47).collect::<Vec<_>>());

    // Everything that is shown is there, and what is drawn is drawn.
    for name in ["summary.md", "runs.csv", "by-problem.csv", "claims.csv", "by-accuracy.csv", "index.html"] {
        assert!(fs::metadata(at("a").join(name)).unwrap().len() > 100, "{name}");
    }
    let page = fs::read_to_string(at("a/index.html")).unwrap();
    for figure in COMPARISON_FIGURES {
        assert!(
            fs::read_to_string(at("a").join(format!("{figure}.svg"))).unwrap().contains("<svg"),
            "{figure}"
        );
        assert!(page.contains(&format!("<figure id=\"{figure}\"")), "{figure}");
    }
    assert!(
        !page.contains("http://")
            || page.matches("http://").count() == page.matches("http://www.w3.org").count()
    );
}

/// Killed at some moments while lines are written, and taken up again, a campaign ends as one that was left alone.
#[cfg(unix)]
#[test]
fn killed_and_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, killed) = (folder.path().join("whole"), folder.path().join("killed"));
    let line = "compare {0} --solvers minimal,map --seeds 150 -o {1}";
    assert_eq!(gough(line, &[&puma(), &whole]).status, 0);
    let results = killed.join("runs.jsonl");
    let size = || fs::metadata(&results).map_or(0, |data| data.len());
    let mut kills = 0;
    for round in 0..4 {
        let before = size();
        let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_gough"))
            .args(["compare", puma().to_str().unwrap(), "--solvers", "minimal,map", "--seeds", "150", "-o"])
            .arg(&killed)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let start = Instant::now();
        while size() <= before + 1000 * round && child.try_wait().unwrap().is_none() {
            assert!(start.elapsed() < Duration::from_secs(15));
            std::thread::yield_now();
        }
        kills += usize::from(child.try_wait().unwrap().is_none());
        // SIGKILL.
        child.kill().unwrap();
        child.wait().unwrap();
    }
    assert!(kills > 0 && size() > 0);
    assert_eq!(gough(line, &[&puma(), &killed]).status, 0);
    assert_eq!(lines(&results), lines(&whole.join("runs.jsonl")));
}

#[test]
fn refusals_name_the_place() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let refused = |line: &str, paths: &[&Path], parts: &[&str]| {
        let ran = gough(line, paths);
        assert!(ran.status == 2 && ran.stdout.is_empty(), "{line}: {ran:?}");
        assert_eq!(ran.stderr.matches("error: ").count(), 1, "{line}: {}", ran.stderr);
        parts.iter().for_each(|part| assert!(ran.stderr.contains(part), "{line}: {}", ran.stderr));
    };
    let puma = puma();
    for shard in ["0/3", "4/3", "1/0"] {
        refused(&format!("compare {{0}} --shard {shard}"), &[&puma], &[shard, "there is no such part"]);
    }
    refused("compare {0} --shard 1", &[&puma], &["write it as k/n"]);
    refused("compare {0} --solvers minimal,newton", &[&puma], &["unknown solver 'newton'", "minimal"]);
    refused("compare {0} --solvers map,map", &[&puma], &["map is named twice"]);
    refused("compare {0} --set map.weight", &[&puma], &["SOLVER.KEY=VALUE"]);
    refused(
        "compare {0} --solvers minimal --set map.weight=2",
        &[&puma],
        &["map is not among the --solvers"],
    );
    refused("compare {0} --set map.wait=2", &[&puma], &["no setting 'wait'", "weight"]);
    refused("compare {0} --noise 0", &[&puma], &["--noise 0", "above 0"]);
    refused("compare {0} --start -1", &[&puma], &["--start -1"]);
    refused("compare {0} --own-data --noise 2", &[&puma], &["--own-data"]);
    refused("compare {0} {0}", &[&puma], &["both called serial-puma560"]);
    let mut problem = json(&puma);
    problem["data"] = Value::Null;
    problem.as_object_mut().unwrap().remove("data");
    let bare = write(folder.path(), "bare.json", &problem);
    refused("compare {0}", &[&bare], &["bare.json", "data.noise is not stated"]);
    refused("compare {0} --own-data", &[&bare], &["bare.json", "no measured poses"]);

    // An unreadable line in the middle is named, by resumption and by merging alike.
    assert_eq!(gough("compare {0} --solvers minimal --seeds 2 -o {1}", &[&puma, &out]).status, 0);
    let results = out.join("runs.jsonl");
    let text = fs::read_to_string(&results).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    let spoiled =
        |second: &str| fs::write(&results, format!("{}\n{second}\n{}\n", lines[0], lines[1])).unwrap();
    for second in ["{\"format\": 1}", "nonsense", &lines[1][..50]] {
        spoiled(second);
        refused("compare {0} --solvers minimal --seeds 2 -o {1}", &[&puma, &out], &["runs.jsonl: line 2"]);
        refused("compare --merge {0}", &[&results], &["runs.jsonl: line 2"]);
    }
    spoiled(&lines[1].replace("gough-run/1", "gough-run/9"));
    refused("compare --merge {0}", &[&results], &["runs.jsonl: line 2", "gough-run/9"]);
    // One run, two results.
    spoiled(&lines[1].replace("\"effort\":{\"iterations\":", "\"effort\":{\"iterations\":1"));
    refused("compare --merge {0}", &[&results], &["runs.jsonl: line 3", "another result of the same run"]);
    // Results that do not belong together.
    spoiled(&lines[1].replace("\"name\":\"default\"", "\"name\":\"tight\""));
    refused("compare --merge {0}", &[&results], &["the tolerance is", "default", "tight"]);
    spoiled(&lines[1].replace("\"clarabel\":\"", "\"clarabel\":\"9."));
    refused("compare --merge {0}", &[&results], &["the set of numerical crates is", "clarabel 9.", "argmin"]);
    let key = lines[1].find(",\"dependencies\":{").unwrap();
    let end = key + lines[1][key..].find('}').unwrap() + 1;
    spoiled(&format!("{}{}", &lines[1][..key], &lines[1][end..]));
    refused("compare --merge {0}", &[&results], &["the set of numerical crates is", "not noted"]);
}

/// The versions in a line are those that cargo says it builds this package with.
#[test]
fn versions_of_dependencies() {
    let folder = tempfile::tempdir().unwrap();
    done("compare {0} --solvers minimal --seeds 1 -o {1}", &[&puma(), folder.path()]);
    let line: Value = serde_json::from_str(&lines(&folder.path().join("runs.jsonl"))[0]).unwrap();
    let noted = line["run"]["dependencies"].as_object().unwrap();
    assert_eq!(noted.keys().collect::<Vec<_>>(), ["argmin", "clarabel", "faer", "nalgebra"]);

    let cargo = std::env::var_os("CARGO").unwrap_or("cargo".into());
    // Crates of other platforms need not be there.
    let rustc = std::process::Command::new("rustc").arg("-vV").output().unwrap();
    let about = String::from_utf8(rustc.stdout).unwrap();
    let host = about.lines().find_map(|line| line.strip_prefix("host: ")).unwrap();
    let metadata = std::process::Command::new(cargo)
        .args(["metadata", "--locked", "--offline", "--format-version", "1", "--filter-platform", host])
        .arg("--manifest-path")
        .arg(file("Cargo.toml"))
        .output()
        .unwrap();
    assert!(metadata.status.success(), "{}", String::from_utf8_lossy(&metadata.stderr));
    let metadata: Value = serde_json::from_slice(&metadata.stdout).unwrap();
    let resolve = &metadata["resolve"];
    let own = resolve["nodes"].as_array().unwrap().iter().find(|n| n["id"] == resolve["root"]).unwrap();
    for (name, version) in noted {
        let built = own["deps"].as_array().unwrap().iter().find(|d| d["name"] == name.as_str()).unwrap();
        let package = metadata["packages"].as_array().unwrap().iter().find(|p| p["id"] == built["pkg"]);
        assert_eq!(&package.unwrap()["version"], version, "{name}");
    }
}

/// Measured data without a truth are scored on their hold-out, and without that on their fit; both are said.
#[test]
fn without_a_truth() {
    let folder = tempfile::tempdir().unwrap();
    let mut problem = json(&puma());
    problem.as_object_mut().unwrap().remove("truth");
    let held_out = write(folder.path(), "held-out.json", &problem);
    problem["name"] = "no-hold-out".into();
    problem["data"].as_object_mut().unwrap().remove("holdout");
    let fitted = write(folder.path(), "fitted.json", &problem);
    let out = folder.path().join("out");
    let line = "compare {0} {1} --own-data --solvers minimal,textbook --seeds 3 -o {2}";
    let ran = gough(line, &[&held_out, &fitted, &out]);
    assert_eq!(ran.status, 0, "{}", ran.stderr);
    for part in [
        "serial-puma560: the true machine is not known: scored on the hold-out alone",
        "scored on its fit alone",
    ] {
        assert!(ran.stdout.contains(part), "{}", ran.stdout);
    }
    // Data are what they are: one run each, whatever the seeds.
    let lines = lines(&out.join("runs.jsonl"));
    assert_eq!(lines.len(), 4);
    for line in &lines {
        let line: Value = serde_json::from_str(line).unwrap();
        assert!(line["score"]["ratio"].is_null() && line["score"]["consistency"].is_null());
        assert_eq!(line["verified"]["success"], true, "{line}");
        assert_eq!(
            line["score"]["after"]["position"].is_null(),
            line["run"]["problem"]["name"] == "no-hold-out"
        );
    }
}
