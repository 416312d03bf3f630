//! Figures of a study. Every identifier keeps its colour and marker in all of them.

use super::line::{Prediction, RunLine};
use super::profile::{Profile, data, performance};
use super::study::{Study, descent};
use super::tables::if_verified;
use crate::render::text::counted;
use crate::render::{Axis, Figure, Kind, Palette, Point, ReferenceLine, Series, Shape, Style};
use crate::solve::registry;
use crate::statistics::{median, wilson};

/// Part of the way to the best cost at which data profiles count a problem as solved.
const SOLVED: f64 = 1e-5;

/// All figures that the study has the data for.
pub fn figures(study: &Study) -> Vec<Figure> {
    // By the registry, so that an identifier looks the same in every campaign.
    let known = registry::all().into_iter().map(|identifier| identifier.name().to_owned());
    let palette = Palette::new(known.chain(study.solvers.iter().cloned()));
    let mut figures = vec![success(study, &palette)];
    let rows = study.matched();
    if !rows.is_empty() {
        let caption = format!(
            "Share of {} that are verified and cost at most so many times what the best identifier spent on the \
             same run. With more than two identifiers the order of two of them may turn when a third is left out.",
            counted(rows.len(), "run")
        );
        let costs = |of: fn(&RunLine) -> f64| -> Vec<Vec<f64>> {
            rows.iter().map(|row| row.iter().map(|line| if_verified(line, of(line))).collect()).collect()
        };
        figures.push(
            profiles(
                study,
                &palette,
                &performance(&costs(RunLine::evaluations)),
                Figure::new(
                    "performance-evaluations",
                    "Performance profile, evaluations",
                    Axis::log("evaluations / least evaluations"),
                    Axis::linear("share of runs").spanning(0.0, 1.0),
                ),
            )
            .captioned(caption.clone()),
        );
        figures.push(
            profiles(
                study,
                &palette,
                &performance(&costs(RunLine::time)),
                Figure::new(
                    "performance-time",
                    "Performance profile, processor time",
                    Axis::log("processor time / least processor time"),
                    Axis::linear("share of runs").spanning(0.0, 1.0),
                ),
            )
            .captioned(caption),
        );
        let descents: Vec<_> =
            rows.iter().map(|row| row.iter().map(|line| descent(line)).collect::<Vec<_>>()).collect();
        figures.push(
            profiles(
                study,
                &palette,
                &data(&descents, SOLVED),
                Figure::new(
                    "data-profile",
                    "Data profile",
                    Axis::log("evaluations of residual and Jacobian"),
                    Axis::linear("share of runs").spanning(0.0, 1.0),
                ),
            )
            .captioned(format!(
                "Share of {} whose cost comes, within so many evaluations, down to {SOLVED:e} of the way from the \
                 first cost to the least of any identifier.",
                counted(rows.len(), "run")
            )),
        );
    }
    figures.push(accuracy(study, &palette));
    figures.extend(consistency(study, &palette));
    if study.values(|condition| condition.start).len() > 1 {
        figures.push(by_start(study, &palette));
    }
    if study.values(|condition| condition.noise).len() > 1 {
        figures.extend(study.problems().into_iter().map(|problem| by_noise(study, &palette, problem)));
    }
    figures
}

/// A step curve an identifier, on `figure`.
fn profiles(study: &Study, palette: &Palette, profiles: &[Profile], figure: Figure) -> Figure {
    let ends = profiles.iter().filter_map(|profile| profile.steps.last());
    let end = ends.fold(1.0_f64, |end, (budget, _)| end.max(*budget)) * 1.05;
    study.solvers.iter().zip(profiles).fold(figure, |figure, (solver, profile)| {
        let mut points = vec![(1.0, profile.at(1.0))];
        points.extend(profile.steps.iter().filter(|(budget, _)| *budget > 1.0));
        points.push((end, profile.at(end)));
        figure.with(Series::new(solver.as_str(), Kind::Steps, palette.style(solver), &points))
    })
}

/// Rate and interval of identifiers, one a row.
fn rates(
    study: &Study,
    palette: &Palette,
    figure: Figure,
    of: impl Fn(usize) -> Option<(usize, usize)>,
) -> Figure {
    let shape = Shape::Rows(study.solvers.len());
    study.solvers.iter().enumerate().fold(figure.shaped(shape), |figure, (index, solver)| {
        let points = of(index).filter(|(_, n)| *n > 0).map(|(count, n)| {
            let (low, high) = wilson(count, n);
            Point::new(count as f64 / n as f64, index as f64).across(low, high)
        });
        let series = Series::new("", Kind::Points, palette.style(solver), &[]);
        figure.with(Series { points: points.into_iter().collect(), ..series })
    })
}

fn success(study: &Study, palette: &Palette) -> Figure {
    let figure = Figure::new(
        "success",
        "Verified success",
        Axis::linear("share of runs").spanning(0.0, 1.0),
        Axis::categories("", study.solvers.clone()),
    );
    rates(study, palette, figure, |index| {
        let runs = study.runs(index);
        let (verified, all) =
            runs.fold((0, 0), |(v, n), line| (v + usize::from(line.verified.success), n + 1));
        Some((verified, all))
    })
    .captioned("Share of all runs that the problem verifies, with 95 % intervals after Wilson.")
}

/// Coverage of the stated regions; none where no identifier states a covariance.
fn consistency(study: &Study, palette: &Palette) -> Option<Figure> {
    let covered = |index: usize| {
        let stated: Vec<_> = study.runs(index).filter_map(|line| line.score.consistency).collect();
        (stated.iter().filter(|c| c.probability <= 0.95).count(), stated.len())
    };
    (0..study.solvers.len()).any(|index| covered(index).1 > 0).then(|| {
        let figure = Figure::new(
            "consistency",
            "Truth within the stated 95 % region",
            Axis::linear("share of runs").spanning(0.0, 1.0),
            Axis::categories("", study.solvers.clone()),
        );
        rates(study, palette, figure, |index| Some(covered(index)))
            .with_line(ReferenceLine::X(0.95, "0.95".into()))
            .captioned("Share of the runs with a stated covariance, by the normalised error squared.")
    })
}

fn accuracy(study: &Study, palette: &Palette) -> Figure {
    let figure = Figure::new(
        "accuracy-time",
        "Accuracy and time",
        Axis::log("processor time of the identifier / ms"),
        Axis::log("hold-out error / noise"),
    );
    study
        .solvers
        .iter()
        .enumerate()
        .fold(figure, |figure, (index, solver)| {
            let points: Vec<(f64, f64)> = study
                .conditions
                .iter()
                .filter_map(|condition| {
                    let runs = &condition.runs[index];
                    let time = median(runs.iter().map(|line| 1e3 * line.time()))?;
                    let error = |line: &&RunLine| line.score.after.in_noise.unwrap_or(f64::INFINITY);
                    Some((time, median(runs.iter().map(error))?))
                })
                .collect();
            figure.with(Series::new(solver.as_str(), Kind::Points, palette.style(solver), &points))
        })
        .captioned("Medians over seeds, a point for each problem, noise and start; left and low is better. Errors are in standard \
             deviations of a measurement; processor time is wall time where the system does not tell it.")
}

fn by_start(study: &Study, palette: &Palette) -> Figure {
    let figure = Figure::new(
        "success-start",
        "Success and start",
        Axis::linear("start / tolerances from nominal"),
        Axis::linear("share of runs verified").spanning(0.0, 1.0),
    );
    let starts = study.values(|condition| condition.start);
    study
        .solvers
        .iter()
        .enumerate()
        .fold(figure, |figure, (index, solver)| {
            let points = starts.iter().filter_map(|start| {
                let conditions = study.conditions.iter().filter(|c| c.start == *start);
                let runs: Vec<_> = conditions.flat_map(|condition| &condition.runs[index]).collect();
                let verified = runs.iter().filter(|line| line.verified.success).count();
                let (low, high) = wilson(verified, runs.len());
                let rate = verified as f64 / runs.len() as f64;
                (!runs.is_empty()).then(|| Point::new(*start, rate).between(low, high))
            });
            let series = Series::new(solver.as_str(), Kind::LinePoints, palette.style(solver), &[]);
            figure.with(Series { points: points.collect(), ..series })
        })
        .captioned("Over all problems, with 95 % intervals after Wilson.")
}

fn by_noise(study: &Study, palette: &Palette, problem: &str) -> Figure {
    // Distances, heights and joint readings have no position: their errors count in the noise.
    let mut runs = study.conditions.iter().filter(|c| c.problem == problem).flat_map(|c| &c.runs).flatten();
    let placed = runs.any(|line| line.score.before.position.is_some());
    let shown = |of: Prediction| if placed { of.position.map(|v| 1e6 * v) } else { of.in_noise };
    let figure = Figure::new(
        format!("error-noise-{problem}"),
        format!("Error and noise, {problem}"),
        Axis::log("factor on the noise"),
        Axis::log(if placed { "hold-out position error / µm" } else { "hold-out error / noise" }),
    );
    let start = study.values(|c| if c.problem == problem { c.start } else { f64::INFINITY })[0];
    let conditions: Vec<_> =
        study.conditions.iter().filter(|c| c.problem == problem && c.start == start).collect();
    let line = |of: &dyn Fn(&&RunLine) -> Option<f64>, solvers: std::ops::Range<usize>| -> Vec<(f64, f64)> {
        conditions
            .iter()
            .filter_map(|condition| {
                let runs = condition.runs[solvers.clone()].iter().flatten();
                Some((condition.noise, median(runs.filter_map(of))?))
            })
            .collect()
    };
    let bound = line(&|line| shown(line.score.bound?), 0..study.solvers.len());
    let style = Style { colour: "currentColor".into(), marker: crate::render::Marker::Circle };
    let figure = figure.with(Series::new("Cramer-Rao bound", Kind::Dashed, style, &bound));
    study
        .solvers
        .iter()
        .enumerate()
        .fold(figure, |figure, (index, solver)| {
            let error = |line: &&RunLine| Some(shown(line.score.after).unwrap_or(f64::INFINITY));
            let points = line(&error, index..index + 1);
            figure.with(Series::new(solver.as_str(), Kind::LinePoints, palette.style(solver), &points))
        })
        .captioned(format!(
            "Medians over seeds, started {start} tolerances from nominal. {}The broken line is the Cramer-Rao bound.",
            if placed { "" } else { "In standard deviations of a measurement at that noise. " }
        ))
}
