//! The order of the layers, and habits that hold for every file of the library.

use std::fs;
use std::path::{Path, PathBuf};

/// Every part of the library and the parts that it may use, besides itself.
const LAYERS: [(&str, &[&str]); 20] = [
    ("wide", &[]),
    ("cells", &[]),
    ("lie", &[]),
    ("statistics", &[]),
    ("linalg", &["wide", "problem"]),
    // A problem knows no robot, no file and no terminal.
    ("problem", &["linalg"]),
    ("model", &["wide", "lie"]),
    ("measure", &["lie", "model"]),
    ("calibration", &["wide", "lie", "linalg", "problem", "model", "measure"]),
    // Nor does an identifier.
    ("solve", &["wide", "linalg", "statistics", "problem"]),
    ("simulate", &["lie", "model", "measure"]),
    (
        "identify",
        &["lie", "linalg", "statistics", "problem", "model", "measure", "calibration", "simulate", "solve"],
    ),
    // Plans postures; what it plans for and where it writes is not its business.
    ("design", &["lie", "linalg", "problem", "model", "measure", "calibration", "simulate", "identify"]),
    (
        "check",
        &[
            "lie",
            "linalg",
            "statistics",
            "problem",
            "model",
            "measure",
            "calibration",
            "solve",
            "simulate",
            "identify",
        ],
    ),
    ("files", &["cells", "lie", "model", "measure", "calibration"]),
    // Figures and pages are data in, bytes out.
    ("render", &["cells"]),
    (
        "compare",
        &[
            "lie",
            "linalg",
            "statistics",
            "problem",
            "model",
            "measure",
            "calibration",
            "solve",
            "simulate",
            "identify",
            "files",
            "render",
        ],
    ),
    ("formats", &["cells", "lie", "model", "files"]),
    (
        "cli",
        &[
            "lie",
            "linalg",
            "statistics",
            "problem",
            "model",
            "measure",
            "calibration",
            "solve",
            "simulate",
            "identify",
            "design",
            "check",
            "files",
            "render",
            "compare",
            "formats",
        ],
    ),
    ("lib", &[]),
];

/// Files of `folder` and below, with their text.
fn files(folder: &Path, found: &mut Vec<(PathBuf, String)>) {
    let mut entries: Vec<PathBuf> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            files(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let text = fs::read_to_string(&path).unwrap();
            found.push((path, text));
        }
    }
}

fn sources() -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    files(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), &mut found);
    assert!(found.len() > 50);
    found
}

/// Lines of code with their numbers: no comments, nothing from the first line `#[cfg(test)]` on.
fn code(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let lines = text.lines().enumerate().map(|(number, line)| (number + 1, line.trim()));
    lines.take_while(|(_, line)| *line != "#[cfg(test)]").filter(|(_, line)| !line.starts_with("//"))
}

/// The part of the library that a file belongs to.
fn part(path: &Path) -> String {
    let below = path.strip_prefix(Path::new(env!("CARGO_MANIFEST_DIR")).join("src")).unwrap();
    Path::new(below.components().next().unwrap().as_os_str())
        .file_stem()
        .unwrap()
        .to_string_lossy()
        .into_owned()
}

#[test]
fn no_layer_uses_one_above_it() {
    let mut uses = 0;
    for (path, text) in sources() {
        let part = part(&path);
        if part == "main" {
            continue;
        }
        let (_, below) = LAYERS.iter().find(|(name, _)| *name == part).unwrap_or_else(|| {
            panic!("{}: give the layer `{part}` its place in tests/layers.rs", path.display())
        });
        for (number, line) in code(&text) {
            for rest in line.split("crate::").skip(1) {
                let used: String =
                    rest.chars().take_while(|c| c.is_ascii_alphanumeric() || *c == '_').collect();
                // `use crate::{...}` would hide what it names.
                assert!(!used.is_empty(), "{}:{number}: name one module a line", path.display());
                assert!(
                    used == part || below.contains(&used.as_str()),
                    "{}:{number}: {part} may not use {used}",
                    path.display()
                );
                uses += 1;
            }
            // Paths upward stay inside their part: `super::super` would leave it unseen.
            assert!(!line.contains("super::super"), "{}:{number}: write crate::", path.display());
        }
    }
    assert!(uses > 150);
}

/// The order has no way round but the one between problems and the factorisations that they are compressed by.
#[test]
fn the_order_is_one() {
    let below = |name: &str| LAYERS.iter().find(|(layer, _)| *layer == name).unwrap().1;
    for (upper, lower) in LAYERS {
        for name in lower {
            let pair = (upper, *name);
            let exempt = pair == ("linalg", "problem") || pair == ("problem", "linalg");
            assert!(exempt || !below(name).contains(&upper), "{upper} and {name} use each other");
        }
    }
}

#[test]
fn the_kinematics_and_the_identifiers_know_no_file_and_no_terminal() {
    let words = ["println!", "eprint", "print!", "std::fs", "std::io", "std::env", "serde_json", "clap::"];
    for (path, text) in sources() {
        if matches!(part(&path).as_str(), "cli" | "compare" | "files" | "main") {
            continue;
        }
        for (number, line) in code(&text) {
            for word in words {
                assert!(!line.contains(word), "{}:{number}: {word}", path.display());
            }
        }
    }
}

#[test]
fn nothing_in_the_library_panics_on_purpose() {
    let words = [
        ".unwrap()",
        ".expect(",
        "panic!(",
        "todo!(",
        "unimplemented!(",
        "unreachable!(",
        "dbg!(",
        "process::exit",
    ];
    for (path, text) in sources() {
        for (number, line) in code(&text) {
            for word in words {
                assert!(!line.contains(word), "{}:{number}: {word}", path.display());
            }
        }
    }
}

/// Decompositions of nalgebra go on for ever with numbers that are not finite, unless they are told when to stop.
#[test]
fn no_decomposition_goes_on_for_ever() {
    let endless = [".svd(true", ".svd(false", ".symmetric_eigen(", "symmetric_eigenvalues(", ".schur("];
    for (path, text) in sources() {
        for (number, line) in code(&text) {
            for word in endless {
                assert!(!line.contains(word), "{}:{number}: {word}", path.display());
            }
        }
    }
}

#[test]
fn files_are_short() {
    let mut all = sources();
    files(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests"), &mut all);
    for (path, text) in all {
        let lines = text.lines().count();
        assert!(lines < 400, "{}: {lines} lines", path.display());
    }
}
