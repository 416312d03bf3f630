//! Runs every unbounded identifier on the NIST StRD nonlinear regressions.
//!
//! `cargo run --release --example nist -- DIR` reads the 27 `.dat` files in DIR, starts each identifier from
//! both published starts, and ends with one line per identifier: `NAME SOLVED/54 MEAN_DIGITS`.

#[path = "../tests/nist/mod.rs"]
mod nist;

use gough::solve::{Failure, Identifier, Outcome, Stop, registry};
use nist::Regression;
use std::path::Path;
use std::process::ExitCode;

/// Digits from which a run counts as solved.
const SOLVED: f64 = 4.0;

fn main() -> ExitCode {
    let Some(directory) = std::env::args_os().nth(1) else {
        eprintln!("usage: nist DIR");
        return ExitCode::from(2);
    };
    match nist::read_all(Path::new(&directory)) {
        Ok(problems) if !problems.is_empty() => {
            run(&problems);
            ExitCode::SUCCESS
        }
        Ok(_) => {
            eprintln!("no .dat files in {}", Path::new(&directory).display());
            ExitCode::FAILURE
        }
        Err(why) => {
            eprintln!("{why}");
            ExitCode::FAILURE
        }
    }
}

fn suits(identifier: &dyn Identifier, problem: &Regression) -> bool {
    let trial = identifier.identify(problem, &problem.starts[1], &Stop { iterations: 1, ..nist::TIGHT });
    !matches!(trial.outcome, Outcome::Failed(Failure::Unsuited(_)))
}

fn run(problems: &[Regression]) {
    let (identifiers, unsuited): (Vec<_>, Vec<_>) = registry::all()
        .into_iter()
        .filter(|i| !i.name().starts_with("conic-"))
        .partition(|i| suits(i.as_ref(), &problems[0]));
    let mut digits = vec![Vec::new(); identifiers.len()];
    println!(
        "| problem | start | {} |",
        identifiers.iter().map(|i| i.name()).collect::<Vec<_>>().join(" | ")
    );
    println!("|---|---|{}", "---|".repeat(identifiers.len()));
    for problem in problems {
        for (index, start) in problem.starts.iter().enumerate() {
            let mut row = format!("| {} | {} |", problem.name, index + 1);
            for (identifier, digits) in identifiers.iter().zip(&mut digits) {
                let report = identifier.identify(problem, start, &nist::TIGHT);
                let reached = problem.digits(&report.x);
                digits.push(reached);
                row += &format!(" {reached:.1} |");
            }
            println!("{row}");
        }
    }
    println!();
    for identifier in &unsuited {
        println!("left out: {} (needs tolerances, which a regression does not have)", identifier.name());
    }
    for (identifier, digits) in identifiers.iter().zip(&digits) {
        let solved = digits.iter().filter(|d| **d >= SOLVED).count();
        let mean = digits.iter().sum::<f64>() / digits.len() as f64;
        println!("{} {solved}/{} {mean:.2}", identifier.name(), digits.len());
    }
}
