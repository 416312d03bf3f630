//! Says which data of other people and which programs there are, so that tests that need what is absent are ignored, and
//! reported so.

use std::env;
use std::path::{Path, PathBuf};

/// Folders below `GOUGH_SHARED`, and what tests call them.
const FOLDERS: [(&str, &str); 4] =
    [("data", "shared_data"), ("mgh", "shared_mgh"), ("nist", "shared_nist"), ("cases", "shared_cases")];
/// Names of the browser.
const BROWSERS: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    for name in ["GOUGH_SHARED", "CHROMIUM", "CI", "PATH"] {
        println!("cargo:rerun-if-env-changed={name}");
    }
    let shared = env::var_os("GOUGH_SHARED").map_or_else(|| "../shared".into(), PathBuf::from);
    for (folder, name) in FOLDERS {
        tell(name, shared.join(folder).is_dir());
    }
    // Where everything must pass, a missing browser is a failure.
    tell("browser", env::var_os("CI").is_some() || has_browser());
}

fn tell(name: &str, there: bool) {
    println!("cargo:rustc-check-cfg=cfg({name})");
    if there {
        println!("cargo:rustc-cfg={name}");
    }
}

fn has_browser() -> bool {
    if env::var_os("CHROMIUM").is_some_and(|path| Path::new(&path).is_file()) {
        return true;
    }
    let folders = env::var_os("PATH").map(|path| env::split_paths(&path).collect::<Vec<_>>());
    folders.unwrap_or_default().iter().any(|folder| BROWSERS.iter().any(|name| folder.join(name).is_file()))
}
