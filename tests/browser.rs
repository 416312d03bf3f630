//! Pages in a real browser: they render without errors, with all their figures, in light and dark, at the width of a
//! desk and of a phone.

mod support;

use std::path::{Path, PathBuf};
use std::process::Command;
use support::{done, file};

/// Names that the browser goes by; `CHROMIUM` names another.
const NAMES: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];

/// The browser, if there is one. Where everything must be checked (`CI` is set) its absence is a failure.
fn browser() -> Option<PathBuf> {
    let named = std::env::var_os("CHROMIUM").map(PathBuf::from);
    let works =
        |path: &PathBuf| Command::new(path).arg("--version").output().is_ok_and(|ran| ran.status.success());
    let found = named.into_iter().chain(NAMES.map(PathBuf::from)).find(works);
    if found.is_none() {
        assert!(
            std::env::var_os("CI").is_none(),
            "no chromium: install Debian's package chromium, or set CHROMIUM"
        );
        eprintln!("skipped: no chromium (Debian's package chromium, or the variable CHROMIUM)");
    }
    found
}

/// Width of a phone, px.
const PHONE: u32 = 390;

/// What the page says of itself once it is ready.
struct Seen {
    root: String,
    console: Vec<String>,
}

impl Seen {
    fn of(browser: &Path, page: &Path, width: u32, dark: bool) -> Self {
        let profile = tempfile::tempdir().unwrap();
        let ran = Command::new(browser)
            .args(["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run"])
            .args(["--virtual-time-budget=5000", "--enable-logging=stderr", "--dump-dom"])
            .arg(format!("--window-size={width},900"))
            .arg(format!("--blink-settings=preferredColorScheme={}", u8::from(!dark)))
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg(format!("file://{}", page.display()))
            .output()
            .unwrap();
        let (dom, log) = (String::from_utf8_lossy(&ran.stdout), String::from_utf8_lossy(&ran.stderr));
        let root = dom.split_once("<html").and_then(|(_, rest)| rest.split_once('>'));
        let root = root.unwrap_or_else(|| panic!("no page: {log}")).0.to_owned();
        Self {
            root,
            console: log.lines().filter(|line| line.contains("CONSOLE")).map(str::to_owned).collect(),
        }
    }

    fn value(&self, key: &str) -> &str {
        let value =
            self.root.split_once(&format!("data-{key}=\"")).and_then(|(_, rest)| rest.split_once('"'));
        value.unwrap_or_else(|| panic!("no data-{key} in <html{}>", self.root)).0
    }
}

/// A page that holds this one in a frame of a phone's width, and passes on what it says: windows are not that narrow.
fn on_a_phone(page: &Path, text: &str) -> PathBuf {
    let held = text.replace('&', "&amp;").replace('"', "&quot;");
    let script = "const f = document.querySelector('iframe'); f.onload = () => \
                  Object.assign(document.documentElement.dataset, f.contentDocument.documentElement.dataset);";
    let framed = format!(
        "<!DOCTYPE html><html><head><meta name=\"color-scheme\" content=\"light dark\"></head><body>\
         <iframe width=\"{PHONE}\" height=\"844\" style=\"border:0\" srcdoc=\"{held}\"></iframe>\
         <script>{script}</script></body></html>"
    );
    let path = page.with_extension("phone.html");
    std::fs::write(&path, framed).unwrap();
    path
}

/// Fails unless the page is whole in every dress.
fn check(browser: &Path, page: &Path) {
    let text = std::fs::read_to_string(page).unwrap();
    let figures = text.matches("<svg").count();
    assert!(figures > 5, "{}: {figures} figures", page.display());
    for (width, dark) in [(1280, false), (1280, true), (PHONE, false), (PHONE, true)] {
        let framed = if width == PHONE { on_a_phone(page, &text) } else { page.to_owned() };
        let seen = Seen::of(browser, &framed, 1280, dark);
        let what = format!("{} at {width} px, dark {dark}: <html{}>", page.display(), seen.root);
        assert!(seen.console.is_empty(), "{what}: {:?}", seen.console);
        assert_eq!((seen.value("ready"), seen.value("errors")), ("true", "0"), "{what}");
        assert_eq!(seen.value("figures"), figures.to_string(), "{what}");
        assert_eq!(seen.value("scheme"), if dark { "dark" } else { "light" }, "{what}");
        // Figures and tables scroll in frames of their own, the page never.
        assert_eq!(seen.value("overflow"), "0", "{what}");
        assert_eq!(seen.value("width"), width.to_string(), "{what}");
    }
}

#[test]
fn reports_are_whole_in_a_browser() {
    let Some(browser) = browser() else { return };
    let folder = tempfile::tempdir().unwrap();
    for problem in ["problems/hexapod-6ups.json", "problems/serial-puma560.json"] {
        let (result, page) = (folder.path().join("result.json"), folder.path().join("page.html"));
        done("identify {0} -o {1}", &[&file(problem), &result]);
        done("report {0} -o {1}", &[&result, &page]);
        check(&browser, &page);
    }
}

/// The check would notice: a page whose script fails, and one whose figure has no size.
#[test]
fn a_broken_page_is_noticed() {
    let Some(browser) = browser() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (result, page) = (folder.path().join("result.json"), folder.path().join("page.html"));
    done("identify {0} -o {1}", &[&file("problems/serial-puma560.json"), &result]);
    done("report {0} -o {1}", &[&result, &page]);
    let text = std::fs::read_to_string(&page).unwrap();
    let figures = text.matches("<svg").count();
    let broken = text.replacen("<figure id", "<figure style=\"display:none\" id", 1);
    std::fs::write(&page, broken.replace("</main>", "</main><script>missing();</script>")).unwrap();
    let seen = Seen::of(&browser, &page, 1280, false);
    assert!(seen.console.iter().any(|line| line.contains("missing")), "{:?}", seen.console);
    assert_eq!(seen.value("figures"), (figures - 1).to_string());
}
