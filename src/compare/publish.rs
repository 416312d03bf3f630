//! Everything that a study is shown as: tables in Markdown and CSV, figures in SVG, one page in HTML.

use super::figures::figures;
use super::line::RunLine;
use super::study::{Mixed, Study};
use super::tables::{by_accuracy, by_problem, claims};
use crate::render::svg::svg;
use crate::render::text::counted;
use crate::render::{Cell, Page, Part, Section, Table};

/// A file by its name and content.
pub type Named = (String, String);

/// The tables of lines in Markdown, under a head each.
pub fn markdown(lines: &[RunLine]) -> Result<String, Mixed> {
    let Some(study) = Study::new(lines)? else { return Ok(String::new()) };
    let mut text = format!("{}\n", intro(&study, lines));
    for note in study.notes() {
        text.push_str(&format!("\nNote: {note}.\n"));
    }
    for table in [claims(&study), by_accuracy(&study), by_problem(&study)] {
        text.push_str(&format!("\n## {}\n\n{}\n\n{}", table.title, table.caption, table.markdown()));
    }
    Ok(text)
}

/// All files of a study.
pub fn files(lines: &[RunLine]) -> Result<Vec<Named>, Mixed> {
    let Some(study) = Study::new(lines)? else { return Ok(Vec::new()) };
    let mut files = vec![("summary.md".into(), markdown(lines)?), ("runs.csv".into(), all_runs(lines).csv())];
    let tables = [claims(&study), by_accuracy(&study), by_problem(&study)];
    files.extend(tables.iter().map(|table| (format!("{}.csv", table.id), table.csv())));
    let figures = figures(&study);
    files.extend(figures.iter().map(|figure| (format!("{}.svg", figure.id), svg(figure))));
    files.extend(figures.iter().map(|figure| (format!("{}.csv", figure.id), figure.csv())));
    let mut about = Section::new("About");
    for note in study.notes() {
        about = about.with(Part::Text(format!("Note: {note}.")));
    }
    let names: Vec<&str> = study.problems();
    about = about.with(Part::Text(format!("Problems: {}.", names.join(", "))));
    let [claims, by_accuracy, by_problem] = tables;
    let overview = Section::new("Identifiers").with(Part::Table(claims)).with(Part::Table(by_accuracy));
    let pictures =
        figures.into_iter().fold(Section::new("Figures"), |s, figure| s.with(Part::Figure(figure)));
    let page = Page {
        title: "Comparison of identifiers".into(),
        intro: intro(&study, lines),
        sections: vec![about, overview, pictures, Section::new("Problems").with(Part::Table(by_problem))],
        note: format!(
            "gough {} ({}) on {}",
            study.sample.run.version,
            study.sample.run.dependencies_text(),
            study.sample.cost.machine
        ),
    };
    files.push(("index.html".into(), page.html()));
    Ok(files)
}

fn intro(study: &Study, lines: &[RunLine]) -> String {
    let tolerance = &study.sample.run.tolerance;
    format!(
        "{}: {}, {}, tolerance `{}` (relative offset at most {:e}, cost at most {} % above that \
         of the truth with its prior, hold-out error at most {} times the Cramer-Rao bound).",
        counted(lines.len(), "run"),
        counted(study.problems().len(), "problem"),
        counted(study.solvers.len(), "identifier"),
        tolerance.name,
        tolerance.offset,
        100.0 * tolerance.cost,
        tolerance.prediction,
    )
}

/// One row a run.
fn all_runs(lines: &[RunLine]) -> Table {
    let columns = [
        "problem",
        "hash",
        "#noise",
        "#start",
        "#seed",
        "identifier",
        "ended",
        "reason",
        "verified",
        "failed checks",
        "#position / m",
        "#rotation / rad",
        "#in noise",
        "#by bound",
        "#parameters / tolerance",
        "#parameter bound / tolerance",
        "#NEES",
        "#freedom",
        "#KKT residual (relative offset)",
        "#cost",
        "#evaluations",
        "#iterations",
        "#wall / s",
        "#processor / s",
        "#memory / B",
    ];
    let mut table = Table::new("runs", "Runs", &columns);
    let full = |value: Option<f64>| value.map_or_else(Cell::none, |v| Cell::number(v, 6));
    for line in lines {
        let (run, score) = (&line.run, &line.score);
        table.push(vec![
            Cell::text(&run.problem.name),
            Cell::text(&run.problem.hash),
            full(Some(run.noise)),
            full(Some(run.start)),
            Cell::text(run.seed.to_string()),
            Cell::text(run.solver.label()),
            Cell::text(format!("{:?}", line.claimed.ended).to_lowercase()),
            Cell::text(&line.claimed.reason),
            Cell::text(if line.verified.success { "yes" } else { "no" }),
            Cell::text(&line.verified.reason),
            full(score.after.position),
            full(score.after.rotation),
            full(score.after.in_noise),
            full(score.ratio),
            full(score.parameters.map(|p| p.rms)),
            full(score.parameters.map(|p| p.bound)),
            full(score.consistency.map(|c| c.nees)),
            full(score.consistency.map(|c| c.freedom as f64)),
            full(score.offset),
            full(score.cost),
            full(Some(line.evaluations())),
            Cell::count(line.effort.iterations),
            full(Some(line.cost.wall)),
            full(line.cost.cpu),
            line.cost.memory.map_or_else(Cell::none, |bytes| Cell::count(bytes as usize)),
        ]);
    }
    table
}
