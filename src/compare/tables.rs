//! Tables of a study.

use super::line::{Ended, Prediction, RunLine};
use super::profile::evaluations_to;
use super::study::{Study, descent};
use crate::render::{Cell, Table};
use crate::statistics::{Middle, middle, wilson};
use std::collections::BTreeMap;

/// Parts of the way from first to best cost at which runs are matched.
pub const REACHED: [f64; 3] = [1e-1, 1e-3, 1e-5];

/// The value, or infinity where the run is not verified: failures count at the limit.
pub fn if_verified(line: &RunLine, value: f64) -> f64 {
    if line.verified.success { value } else { f64::INFINITY }
}

fn or_infinite(value: Option<f64>) -> f64 {
    value.unwrap_or(f64::INFINITY)
}

/// A share of runs, in percent.
fn share(count: usize, of: usize) -> Cell {
    match of {
        0 => Cell::none(),
        _ => {
            let percent = 100.0 * count as f64 / of as f64;
            Cell::valued(format!("{percent:.0} %"), percent)
        }
    }
}

/// Ends of the 95 % interval of a share, in percent.
fn interval(count: usize, of: usize) -> [Cell; 2] {
    let (low, high) = wilson(count, of);
    [low, high].map(|end| Cell::valued(format!("{:.0} %", 100.0 * end), 100.0 * end))
}

/// A value, `limit` where it is infinite.
fn number(value: f64) -> Cell {
    if value.is_finite() { Cell::number(value, 3) } else { Cell::valued("limit", f64::INFINITY) }
}

/// Median, lower and upper quartile.
fn spread(values: impl Iterator<Item = f64>) -> [Cell; 3] {
    match middle(values) {
        Some(Middle { low, median, high }) => [median, low, high].map(number),
        None => [Cell::none(), Cell::none(), Cell::none()],
    }
}

fn verified(runs: &[&RunLine]) -> usize {
    runs.iter().filter(|line| line.verified.success).count()
}

fn claimed(line: &RunLine) -> bool {
    line.claimed.ended == Ended::Converged
}

/// Median and spread over seeds, by problem, noise, start and identifier.
pub fn by_problem(study: &Study) -> Table {
    let columns = [
        "problem",
        "#noise",
        "#start",
        "identifier",
        "#runs",
        "#verified",
        "#verified: from",
        "#verified: to",
        "#claimed",
        "#position error / µm",
        "#position: quartile 1",
        "#position: quartile 3",
        "#rotation error / µrad",
        "#rotation: quartile 1",
        "#rotation: quartile 3",
        "#error in noise",
        "#error by bound",
        "#in 95 % region",
        "#evaluations",
        "#iterations",
        "#wall time / ms",
        "#wall time: quartile 1",
        "#wall time: quartile 3",
        "#processor time / ms",
    ];
    let mut table = Table::new("by-problem", "Problems", &columns).captioned(
        "Medians over seeds. Position and rotation are those of hold-out poses; \
         the error in noise is that of all readings of the hold-out, in standard deviations. Runs that are not verified count at the \
         limit in evaluations, iterations and times. \"By bound\" is the hold-out error in units of the Cramer-Rao bound; \
         \"in 95 % region\" the share of runs whose stated 95 % region covers the truth. Noise is the factor on the \
         stated noise, start the distance from nominal in tolerances.",
    );
    for condition in &study.conditions {
        for (solver, runs) in study.solvers.iter().zip(&condition.runs) {
            if runs.is_empty() {
                continue;
            }
            let n = runs.len();
            let of = |value: fn(&RunLine) -> f64| spread(runs.iter().map(move |line| value(line)));
            let covered = runs.iter().filter_map(|line| line.score.consistency);
            let (regions, inside) =
                (covered.clone().count(), covered.filter(|c| c.probability <= 0.95).count());
            // What the hold-out does not measure is no failure.
            let measured = |of: fn(&Prediction) -> Option<f64>| {
                if !runs.iter().any(|line| of(&line.score.before).is_some()) {
                    return [Cell::none(), Cell::none(), Cell::none()];
                }
                spread(runs.iter().map(|line| 1e6 * or_infinite(of(&line.score.after))))
            };
            let position = measured(|error| error.position);
            let rotation = measured(|error| error.rotation);
            let [in_noise, ..] = of(|line| or_infinite(line.score.after.in_noise));
            let ratios = runs.iter().filter(|line| line.score.bound.is_some());
            let [ratio, ..] = spread(ratios.map(|line| or_infinite(line.score.ratio)));
            let [evaluations, ..] = of(|line| if_verified(line, line.evaluations()));
            let [iterations, ..] = of(|line| if_verified(line, line.effort.iterations as f64));
            let time = of(|line| if_verified(line, 1e3 * line.cost.wall));
            let times = runs.iter().filter_map(|line| Some(if_verified(line, 1e3 * line.cost.cpu?)));
            let [processor, ..] = spread(times);
            let mut row = vec![
                Cell::text(condition.problem),
                Cell::number(condition.noise, 2),
                Cell::number(condition.start, 2),
                Cell::text(solver),
                Cell::count(n),
                share(verified(runs), n),
            ];
            row.extend(interval(verified(runs), n));
            row.push(share(runs.iter().filter(|line| claimed(line)).count(), n));
            row.extend(position.into_iter().chain(rotation));
            row.extend([in_noise, ratio, share(inside, regions), evaluations, iterations]);
            row.extend(time.into_iter().chain([processor]));
            table.push(row);
        }
    }
    table
}

/// What identifiers say of themselves, against what the problem says.
pub fn claims(study: &Study) -> Table {
    let columns = [
        "identifier",
        "#runs",
        "#verified",
        "#verified: from",
        "#verified: to",
        "#claimed",
        "#claimed, verified",
        "#claimed, not verified",
        "#verified, not claimed",
        "most frequent reason of failure",
    ];
    let mut table = Table::new("claims", "Identifiers", &columns).captioned(format!(
        "Verified by the problem: the result is a stationary point of what its identifier minimises, {}, each within the \
         tolerance (95 % interval after Wilson). Claimed: the identifier says that it converged.",
        match study.without_truth() {
            false => "costs no more than the truth does, and predicts the hold-out",
            true => {
                "costs no more than the truth does where it is known and else than the drawing, predicts the hold-out, and \
                 without a truth leaves a residual that the stated noise explains"
            }
        }
    ));
    for (index, solver) in study.solvers.iter().enumerate() {
        let runs: Vec<&RunLine> = study.runs(index).collect();
        let n = runs.len();
        let count = |says: bool, holds: bool| {
            runs.iter().filter(|line| claimed(line) == says && line.verified.success == holds).count()
        };
        let mut reasons: BTreeMap<&str, usize> = BTreeMap::new();
        for line in runs.iter().filter(|line| !line.verified.success) {
            *reasons.entry(reason(line)).or_default() += 1;
        }
        let most = reasons.iter().max_by_key(|(reason, count)| (**count, std::cmp::Reverse(**reason)));
        let mut row = vec![Cell::text(solver), Cell::count(n), share(verified(&runs), n)];
        row.extend(interval(verified(&runs), n));
        row.extend([
            share(count(true, true) + count(true, false), n),
            Cell::count(count(true, true)),
            Cell::count(count(true, false)),
            Cell::count(count(false, true)),
            most.map_or_else(Cell::none, |(reason, count)| Cell::text(format!("{reason} ({count})"))),
        ]);
        table.push(row);
    }
    table
}

/// Why a run failed, without the numbers of this one.
fn reason(line: &RunLine) -> &'static str {
    let verified = &line.verified;
    match line.claimed.ended {
        Ended::Refused => "could not be started",
        Ended::Limit => "iteration or evaluation limit",
        Ended::Failed => "gave up",
        Ended::Converged if verified.prediction == Some(false) => "predictions beyond the limit",
        Ended::Converged if verified.explained == Some(false) => "noise does not explain the residual",
        Ended::Converged if verified.cost == Some(false) && line.score.truth => {
            "cost above that of the truth"
        }
        Ended::Converged if verified.cost == Some(false) => "cost above that of the drawing",
        Ended::Converged => "not stationary",
    }
}

/// Runs matched by the accuracy that they reach instead of the tolerance that was asked.
pub fn by_accuracy(study: &Study) -> Table {
    let mut columns = vec!["identifier".to_owned(), "#runs".to_owned()];
    for tau in REACHED {
        columns.push(format!("#reach {tau:e}"));
        columns.push(format!("#evaluations to {tau:e}"));
    }
    let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
    let mut table = Table::new("by-accuracy", "Matched by accuracy", &columns).captioned(
        "Share of runs whose cost comes within a part of the way from its first value to the least that any identifier \
         reached on the same data, and the median of evaluations until then; runs that do not get there count at the limit.",
    );
    let rows = study.matched();
    let reached: Vec<Vec<Vec<f64>>> = REACHED
        .iter()
        .map(|tau| {
            let counts = |row: &Vec<&RunLine>| {
                evaluations_to(&row.iter().map(|line| descent(line)).collect::<Vec<_>>(), *tau)
            };
            rows.iter().map(counts).collect()
        })
        .collect();
    for (index, solver) in study.solvers.iter().enumerate() {
        let mut cells = vec![Cell::text(solver), Cell::count(rows.len())];
        for at in &reached {
            let counts: Vec<f64> = at.iter().filter_map(|row| row.get(index)).copied().collect();
            cells.push(share(counts.iter().filter(|n| n.is_finite()).count(), counts.len()));
            let [median, ..] = spread(counts.into_iter());
            cells.push(median);
        }
        table.push(cells);
    }
    table
}
