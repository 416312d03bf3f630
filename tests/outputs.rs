//! Outputs never destroy inputs, and names of a file do no harm where they are shown.

mod support;

use serde_json::{Value, json};
use std::fs;
use std::path::PathBuf;
use support::*;

/// A folder with a problem whose data are a table, its result, and readings and poses to work with.
struct Workshop {
    folder: tempfile::TempDir,
}

impl Workshop {
    fn new() -> Self {
        let workshop = Self { folder: tempfile::tempdir().unwrap() };
        let mut problem = json(&file("problems/serial-puma560.json"));
        let samples = problem["data"]["samples"].as_array().unwrap().clone();
        let mut table = "arm.j1,arm.j2,arm.j3,arm.j4,arm.j5,arm.j6,x,y,z,rx,ry,rz\n".to_owned();
        let names = gough_actuators(&problem);
        table = table.replace("arm.j1,arm.j2,arm.j3,arm.j4,arm.j5,arm.j6", &names.join(","));
        for sample in &samples {
            let pose = &sample["pose"];
            let row = [&sample["actuators"], &pose["position"], &pose["rotation"]]
                .map(|v| numbers(v).iter().map(|v| format!("{v:?}")).collect::<Vec<_>>().join(","));
            table.push_str(&row.join(","));
            table.push('\n');
        }
        fs::write(workshop.at("table.csv"), table).unwrap();
        let data = problem["data"].as_object_mut().unwrap();
        data.remove("samples");
        data.remove("holdout");
        data.insert("file".into(), "table.csv".into());
        write(workshop.folder.path(), "p.json", &problem);
        done("identify {0} -o {1}", &[&workshop.at("p.json"), &workshop.at("r.json")]);
        let readings = json!({ "samples": [{ "actuators": samples[0]["actuators"] }] });
        write(workshop.folder.path(), "readings.json", &readings);
        let wanted = json!({ "samples": [{ "pose": samples[0]["pose"] }] });
        write(workshop.folder.path(), "wanted.json", &wanted);
        let arm = [
            "<robot name=\"a\"><link name=\"a\"/><link name=\"b\"/>",
            "<joint name=\"j\" type=\"revolute\"><parent link=\"a\"/><child link=\"b\"/><axis xyz=\"0 0 1\"/>",
            "<limit lower=\"-1\" upper=\"1\"/></joint></robot>",
        ];
        fs::write(workshop.at("arm.urdf"), arm.concat()).unwrap();
        fs::write(workshop.at("dh.csv"), "theta,d,a,alpha\n0,1,0,1.5\n0,0.2,0.3,0\n").unwrap();
        workshop
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

fn gough_actuators(problem: &Value) -> Vec<String> {
    let limb = &problem["mechanism"]["limbs"][0];
    let joints = limb["joints"].as_array().unwrap();
    joints
        .iter()
        .map(|j| format!("{}.{}", limb["name"].as_str().unwrap(), j["name"].as_str().unwrap()))
        .collect()
}

/// Every command, with every file that it reads as its output.
const RUNS: [(&str, &[&str]); 14] = [
    ("identify p.json", &["p.json", "table.csv"]),
    ("identify p.json --holdout 0.2", &["table.csv"]),
    ("predict r.json --actuators readings.json", &["r.json", "readings.json"]),
    ("predict p.json --actuators readings.json", &["p.json"]),
    ("command r.json --poses wanted.json", &["r.json", "wanted.json"]),
    ("plan p.json --poses 8 --random 40", &["p.json", "table.csv"]),
    ("plan p.json --poses 8 --random 40 --at r.json", &["r.json"]),
    ("report r.json --problem p.json", &["r.json", "p.json", "table.csv"]),
    ("simulate p.json --poses 8 --seed 1", &["p.json", "table.csv"]),
    ("export r.json --format csv", &["r.json"]),
    ("export p.json --format dh --convention standard", &["p.json"]),
    ("import urdf arm.urdf --base a --tool b", &["arm.urdf"]),
    ("import dh dh.csv --convention standard --length m --angle rad", &["dh.csv"]),
    ("import csv table.csv --problem p.json", &["table.csv", "p.json"]),
];

#[test]
fn no_command_writes_over_what_it_reads() {
    let workshop = Workshop::new();
    let whole = |name: &str| fs::read(workshop.at(name)).unwrap();
    for (line, inputs) in RUNS {
        for input in inputs {
            let before = whole(input);
            // By its name, by another spelling, and by a hard link.
            let link = workshop.at("link");
            let _ = fs::remove_file(&link);
            fs::hard_link(workshop.at(input), &link).unwrap();
            for output in
                [(*input).to_owned(), format!("./../{}/{input}", folder_name(&workshop)), "link".into()]
            {
                let mut command = command();
                command
                    .current_dir(workshop.folder.path())
                    .args(line.split_whitespace())
                    .args(["-o", &output]);
                let ran = ran(&mut command);
                assert_eq!(ran.status, 2, "{line} -o {output}: {ran:?}");
                assert!(ran.stderr.contains("-o"), "{line} -o {output}: {}", ran.stderr);
                assert_eq!(
                    ran.stderr.lines().filter(|l| l.starts_with("error")).count(),
                    1,
                    "{}",
                    ran.stderr
                );
                assert!(ran.stdout.is_empty(), "{line} -o {output}: {}", ran.stdout);
                assert_eq!(whole(input), before, "{line} -o {output}");
            }
        }
    }
}

/// The same commands write where nothing is read.
#[test]
fn the_same_commands_write_elsewhere() {
    let workshop = Workshop::new();
    for (line, _) in RUNS {
        let mut command = command();
        command.current_dir(workshop.folder.path()).args(line.split_whitespace()).args(["-o", "new"]);
        let ran = ran(&mut command);
        assert!(ran.status < 2, "{line}: {ran:?}");
        assert!(fs::metadata(workshop.at("new")).unwrap().len() > 20, "{line}");
        fs::remove_file(workshop.at("new")).unwrap();
    }
}

fn folder_name(workshop: &Workshop) -> String {
    workshop.folder.path().file_name().unwrap().to_string_lossy().into_owned()
}

/// What a comparison merges is an input, too.
#[test]
fn merged_lines_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let line = "compare {0} --solvers minimal --seeds 1 -o {1}";
    done(line, &[&file("problems/serial-scara.json"), folder.path()]);
    let runs = folder.path().join("runs.jsonl");
    let before = fs::read(&runs).unwrap();
    let ran = gough("compare --merge {0} -o {1}", &[&runs, folder.path()]);
    assert!(ran.status == 2 && ran.stderr.contains("-o"), "{ran:?}");
    assert_eq!(fs::read(&runs).unwrap(), before);
}

#[test]
fn control_characters_in_names() {
    for case in ["esc", "inj"] {
        let ran = gough("identify {0}", &[&file(&format!("tests/data/cases/formats/{case}.json"))]);
        assert_eq!(ran.status, 2, "{ran:?}");
        assert!(ran.stderr.contains("control character"), "{}", ran.stderr);
        assert!(!ran.stderr.trim_end().contains(char::is_control), "{:?}", ran.stderr);
    }
    let folder = tempfile::tempdir().unwrap();
    let places: [(&str, &[&str]); 3] = [
        ("/name", &["name", "U+0007"]),
        ("/mechanism/limbs/0/name", &["mechanism.limbs[0].name", "U+0007"]),
        ("/mechanism/limbs/0/joints/1/name", &["joints[1].name", "U+0007"]),
    ];
    for (pointer, parts) in places {
        let mut problem = json(&file("problems/serial-puma560.json"));
        *problem.pointer_mut(pointer).unwrap() = "bell\u{7}".into();
        let path = write(folder.path(), "p.json", &problem);
        for command in ["identify {0}", "predict {0} --actuators {0}", "analyze {0}"] {
            let ran = gough(command, &[&path]);
            assert_eq!(ran.status, 2, "{command}: {ran:?}");
            assert!(parts.iter().all(|part| ran.stderr.contains(part)), "{}", ran.stderr);
        }
    }
    let mut problem = json(&file("problems/kinds/hexapod-6ups-distance.json"));
    let instrument = problem["data"]["instrument"].as_object_mut().unwrap();
    let (name, first) = instrument["points"].as_object().unwrap().iter().next().unwrap();
    let (name, first) = (format!("{name}\u{1b}[31m"), first.clone());
    instrument["points"].as_object_mut().unwrap().insert(name, first);
    let ran = gough("identify {0}", &[&write(folder.path(), "p.json", &problem)]);
    assert!(ran.status == 2 && ran.stderr.contains("U+001B"), "{ran:?}");
}

/// Names that a spreadsheet would run are text in every table, and come back as they were.
#[test]
fn formulas_in_tables() {
    let folder = tempfile::tempdir().unwrap();
    let mut problem = json(&file("problems/serial-puma560.json"));
    for machine in ["mechanism", "truth"] {
        if let Some(limb) = problem.pointer_mut(&format!("/{machine}/limbs/0")) {
            limb["name"] = "=HYPERLINK(\"http://x\")".into();
        }
    }
    let problem = write(folder.path(), "p.json", &problem);
    let at = |name: &str| folder.path().join(name);
    done("identify {0} -o {1}", &[&problem, &at("r.json")]);
    done("export {0} --format csv -o {1}", &[&at("r.json"), &at("d.csv")]);
    done("plan {0} --poses 8 --random 40 -o {1}", &[&problem, &at("plan.csv")]);
    done("predict {0} --actuators {1} -o {2}", &[&at("r.json"), &at("plan.csv"), &at("poses.csv")]);
    for table in ["d.csv", "plan.csv", "poses.csv"] {
        let text = fs::read_to_string(at(table)).unwrap();
        assert!(text.contains("'=HYPERLINK"), "{table}: {text}");
        let mut reader = csv_cells(&text);
        assert!(reader.all(|cell| !cell.starts_with(['=', '+', '@'])), "{table}: {text}");
    }
}

fn csv_cells(text: &str) -> impl Iterator<Item = String> + '_ {
    text.lines().flat_map(|line| line.split(',').map(|cell| cell.trim_matches('"').to_owned()))
}

/// More threads than any system has are no reason to fail.
#[test]
fn absurd_numbers_of_threads() {
    for threads in ["1000000", "99999999999999999999", "0", "-1", "x"] {
        let mut command = command();
        command.env("RAYON_NUM_THREADS", threads).arg("identify").arg(file("problems/tripod-3rps.json"));
        let ran = ran(&mut command);
        assert_eq!(ran.status, 0, "{threads}: {ran:?}");
    }
}
