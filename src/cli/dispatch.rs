//! Commands and their arguments.

use super::error::CliError;
use super::{analyze, identify, predict, report, simulate, solvers};
use clap::{Parser, Subcommand};

/// Kinematic calibration of parallel and serial manipulators.
#[derive(Debug, Parser)]
#[command(name = "gough", version, about, max_term_width = 100)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Identify a machine's deviations from measured poses
    Identify(identify::Args),
    /// Say what the poses of a problem can reveal
    Analyze(analyze::Args),
    /// Forward kinematics of a problem's or result's machine
    Predict(predict::Args),
    /// Write a page of figures and tables about a result
    Report(report::Args),
    /// Draw a true machine from the tolerances and measure it
    Simulate(simulate::Args),
    /// List the identifiers
    Solvers,
}

/// How a command that did its work ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// Exit status 0.
    Done,
    /// Exit status 1: results are written and say that they did not converge.
    NotConverged,
}

/// Runs the command line.
pub fn run(cli: &Cli) -> Result<Ending, CliError> {
    match &cli.command {
        Command::Identify(args) => identify::run(args),
        Command::Analyze(args) => analyze::run(args),
        Command::Predict(args) => predict::run(args),
        Command::Report(args) => report::run(args),
        Command::Simulate(args) => simulate::run(args),
        Command::Solvers => solvers::run(),
    }
}
