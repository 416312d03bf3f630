//! `gough`: parse, run, print one error, set the exit status.

use clap::Parser;
use gough::cli::dispatch::{Cli, Ending, run};
use std::process::ExitCode;

/// The message without control characters of the file that it quotes: they would act on the terminal.
fn harmless(message: &str) -> String {
    message.chars().map(|c| if c.is_control() && c != '\n' { '\u{fffd}' } else { c }).collect()
}

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(message) => {
            // Help and version are no errors and go to standard output.
            let status = if message.use_stderr() { 2 } else { 0 };
            let _ = message.print();
            return ExitCode::from(status);
        }
    };
    match run(&cli) {
        Ok(Ending::Done) => ExitCode::SUCCESS,
        Ok(Ending::NotConverged | Ending::Suspicious) => ExitCode::from(1),
        Err(error) => {
            eprintln!("error: {}", harmless(&error.to_string()));
            ExitCode::from(2)
        }
    }
}
