//! Commands and their arguments.

use super::error::CliError;
use super::{
    analyze, check, command, compare, export, identify, import, plan, predict, report, simulate, solvers,
    threads,
};
use crate::files::ledger;
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
    /// Say whether a problem means what it should: units, signs, orders and frames
    Check(check::Args),
    /// Forward kinematics of a problem's or result's machine
    Predict(predict::Args),
    /// Actuator readings that bring a problem's or result's machine to wanted poses
    #[command(name = "command")]
    Reach(command::Args),
    /// Choose the postures to measure
    Plan(plan::Args),
    /// Write a page of figures and tables about a result
    Report(report::Args),
    /// Draw a true machine from the tolerances and measure it
    Simulate(simulate::Args),
    /// Compare identifiers on problems, scored by the problem
    Compare(compare::Args),
    /// Make a problem of a machine or of measurements in another format
    Import(import::Args),
    /// Write a calibrated machine for other programs
    Export(export::Args),
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
    /// Exit status 1: something in the data looks wrong.
    Suspicious,
}

/// Runs the command line.
pub fn run(cli: &Cli) -> Result<Ending, CliError> {
    ledger::open();
    threads::prepare();
    match &cli.command {
        Command::Identify(args) => identify::run(args),
        Command::Analyze(args) => analyze::run(args),
        Command::Check(args) => check::run(args),
        Command::Predict(args) => predict::run(args),
        Command::Reach(args) => command::run(args),
        Command::Plan(args) => plan::run(args),
        Command::Report(args) => report::run(args),
        Command::Simulate(args) => simulate::run(args),
        Command::Compare(args) => compare::run(args),
        Command::Import(args) => import::run(args),
        Command::Export(args) => export::run(args),
        Command::Solvers => solvers::run(),
    }
}
