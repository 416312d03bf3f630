//! Pages in a real browser: they render without errors, with all their figures, in light and dark, at the width of a
//! desk and of a phone.

mod support;

use std::path::{Path, PathBuf};
use std::process::Command;
use support::{COMPARISON_FIGURES, done, file, gough};

/// Names that the browser goes by; `CHROMIUM` names another.
const NAMES: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];

/// The browser. Tests that ask for it are ignored where there is none, unless everything must be checked (`CI` is set).
fn browser() -> PathBuf {
    let named = std::env::var_os("CHROMIUM").map(PathBuf::from);
    let works =
        |path: &PathBuf| Command::new(path).arg("--version").output().is_ok_and(|ran| ran.status.success());
    let found = named.into_iter().chain(NAMES.map(PathBuf::from)).find(works);
    found.expect("no chromium: install Debian's package chromium, or set CHROMIUM")
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
        let size = format!("--window-size={width},900");
        let scheme = format!("--blink-settings=preferredColorScheme={}", u8::from(!dark));
        let (dom, log) = opened(browser, page, &["--dump-dom", &size, &scheme]);
        let root = dom.split_once("<html").and_then(|(_, rest)| rest.split_once('>'));
        let root = root.unwrap_or_else(|| panic!("no page: {log}")).0.to_owned();
        Self { root, console: complaints(&log) }
    }

    fn value(&self, key: &str) -> &str {
        let value =
            self.root.split_once(&format!("data-{key}=\"")).and_then(|(_, rest)| rest.split_once('"'));
        value.unwrap_or_else(|| panic!("no data-{key} in <html{}>", self.root)).0
    }
}

/// What the browser writes, and its log.
fn opened(browser: &Path, page: &Path, arguments: &[&str]) -> (String, String) {
    let profile = tempfile::tempdir().unwrap();
    let ran = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run"])
        .args(["--virtual-time-budget=5000", "--enable-logging=stderr"])
        .args(arguments)
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("file://{}", page.display()))
        .output()
        .unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (text(&ran.stdout), text(&ran.stderr))
}

/// What pages complain of: errors of scripts, and whatever they wanted from elsewhere.
fn complaints(log: &str) -> Vec<String> {
    log.lines().filter(|line| line.contains("CONSOLE")).map(str::to_owned).collect()
}

/// The page with a script that runs once it is ready.
fn with_script(page: &Path, text: &str, script: &str) -> PathBuf {
    let script = format!("<script>addEventListener('load', () => {{ {script} }});</script></body>");
    let path = page.with_extension("script.html");
    std::fs::write(&path, text.replacen("</body>", &script, 1)).unwrap();
    path
}

/// Clicks on every head of every table, twice, and counts the columns that stand in order then: numbers by size, before
/// texts when ascending, no row lost.
const CLICKS: &str = "
    let heads = 0, sorted = 0;
    for (const table of document.querySelectorAll('table')) {
        const rows = () => [...table.tBodies[0].rows];
        const all = rows().length;
        for (const button of table.querySelectorAll('th button')) {
            heads += 1;
            const column = button.closest('th').cellIndex;
            const cells = () => rows().map((row) => row.cells[column]);
            const numbers = () => cells().filter((cell) => cell.dataset.value !== undefined)
                .map((cell) => Number(cell.dataset.value));
            const texts = () => cells().filter((cell) => cell.dataset.value === undefined)
                .map((cell) => cell.textContent);
            const before = [...numbers()].sort((a, b) => a - b), words = [...texts()];
            button.click();
            words.sort((a, b) => a.localeCompare(b, 'en', { numeric: true }));
            const up = String(numbers()) === String(before) && String(texts()) === String(words)
                && (before.length === 0 || cells()[0].dataset.value !== undefined);
            button.click();
            const down = String(numbers()) === String(before.reverse())
                && String(texts()) === String(words.reverse());
            sorted += up && down && rows().length === all ? 1 : 0;
        }
    }
    Object.assign(document.documentElement.dataset, { heads, sorted });
";

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
    let seen = Seen::of(browser, &with_script(page, &text, CLICKS), 1280, false);
    assert!(seen.console.is_empty(), "{}: {:?}", page.display(), seen.console);
    let heads: usize = seen.value("heads").parse().unwrap();
    assert!(heads > 10 && seen.value("sorted") == seen.value("heads"), "{}: {}", page.display(), seen.root);
    printed(browser, page);
}

/// Fails unless the page can be printed, on several sheets as wide as paper is.
fn printed(browser: &Path, page: &Path) {
    let path = page.with_extension("pdf");
    let to = format!("--print-to-pdf={}", path.display());
    let (_, log) = opened(browser, page, &[&to, "--no-pdf-header-footer"]);
    let pdf = String::from_utf8_lossy(&std::fs::read(&path).unwrap_or_else(|_| panic!("{log}"))).into_owned();
    assert!(pdf.starts_with("%PDF") && complaints(&log).is_empty(), "{log}");
    let sheets = pdf.matches("/Type /Page").count() - pdf.matches("/Type /Pages").count();
    assert!(sheets > 1, "{}: {sheets} sheets", page.display());
}

#[test]
#[cfg_attr(not(browser), ignore = "no chromium: install Debian's package, or set CHROMIUM")]
fn reports_are_whole_in_a_browser() {
    let browser = browser();
    let folder = tempfile::tempdir().unwrap();
    for problem in ["problems/hexapod-6ups.json", "problems/serial-puma560.json"] {
        let (result, page) = (folder.path().join("result.json"), folder.path().join("page.html"));
        done("identify {0} -o {1}", &[&file(problem), &result]);
        done("report {0} -o {1}", &[&result, &page]);
        check(&browser, &page);
    }
}

/// With identifiers that succeed and that fail, starts, noises and problems, so that every figure is there.
#[test]
#[cfg_attr(not(browser), ignore = "no chromium: install Debian's package, or set CHROMIUM")]
fn comparisons_are_whole_in_a_browser() {
    let browser = browser();
    let folder = tempfile::tempdir().unwrap();
    let problems = ["problems/serial-puma560.json", "problems/serial-scara.json"].map(file);
    let arguments =
        "--solvers minimal,map,argmin-lm,argmin-lbfgs,textbook --seeds 2 --noise 1,0.1 --start 0,5";
    let ran = gough(
        &format!("compare {{0}} {{1}} {arguments} -o {{2}}"),
        &[&problems[0], &problems[1], folder.path()],
    );
    assert_eq!(ran.status, 0, "{}", ran.stderr);
    let page = folder.path().join("index.html");
    let text = std::fs::read_to_string(&page).unwrap();
    for figure in COMPARISON_FIGURES {
        assert!(text.contains(&format!("<figure id=\"{figure}\"")), "{figure}");
    }
    check(&browser, &page);
}

/// The check would notice: a page whose script fails, one whose figure has no size, and one that wants something from
/// elsewhere.
#[test]
#[cfg_attr(not(browser), ignore = "no chromium: install Debian's package, or set CHROMIUM")]
fn a_broken_page_is_noticed() {
    let browser = browser();
    let folder = tempfile::tempdir().unwrap();
    let (result, page) = (folder.path().join("result.json"), folder.path().join("page.html"));
    done("identify {0} -o {1}", &[&file("problems/serial-puma560.json"), &result]);
    done("report {0} -o {1}", &[&result, &page]);
    let text = std::fs::read_to_string(&page).unwrap();
    let figures = text.matches("<svg").count();
    let broken = text.replacen("<figure id", "<figure style=\"display:none\" id", 1);
    let broken =
        broken.replace("</main>", "</main><img src='http://localhost/x.png'/><script>missing();</script>");
    std::fs::write(&page, broken).unwrap();
    let seen = Seen::of(&browser, &page, 1280, false);
    assert!(seen.console.iter().any(|line| line.contains("missing")), "{:?}", seen.console);
    assert!(seen.console.iter().any(|line| line.contains("Content Security Policy")), "{:?}", seen.console);
    assert_eq!(seen.value("figures"), (figures - 1).to_string());
}
