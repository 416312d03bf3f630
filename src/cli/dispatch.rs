//! Commands and their arguments.

use super::error::CliError;
use super::{analyze, compare, identify, predict, simulate, solvers};
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
    /// Draw a true machine from the tolerances and measure it
    Simulate(simulate::Args),
    /// Compare identifiers on problems, scored by the problem
    Compare(compare::Args),
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
        Command::Simulate(args) => simulate::run(args),
        Command::Compare(args) => compare::run(args),
        Command::Solvers => solvers::run(),
    }
}
