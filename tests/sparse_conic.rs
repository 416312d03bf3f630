//! Sparse penalties on machines: every problem has its solution, and no program about a point is called infeasible.

mod support;

use clarabel::solver::SolverStatus as Status;
use gough::calibration::Calibration;
use gough::files::{DataPlaces, ProblemFile, read_problem};
use gough::identify::{Identification, identify};
use gough::problem::{Form, Problem};
use gough::solve::conic::here::Here;
use gough::solve::conic::least_squares::LeastSquares;
use gough::solve::conic::limits::Limits;
use gough::solve::conic::loss::Frame;
use gough::solve::conic::penalty::Penalty;
use gough::solve::conic::step::{Model, usable};
use gough::solve::damped::column_norms;
use gough::solve::{Stop, registry};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

fn problem(path: &Path) -> ProblemFile {
    let places = DataPlaces { data_dir: None, shared: "no such folder".into() };
    read_problem(path, &places).unwrap()
}

fn found(problem: &ProblemFile, solver: &str, stop: &Stop) -> Identification {
    let identifier = registry::find(solver).unwrap();
    identify(&problem.mechanism, &problem.data.samples, identifier.as_ref(), stop).unwrap()
}

/// The problems of problems/ and problems/kinds.
fn all() -> Vec<PathBuf> {
    let kinds =
        std::fs::read_dir(support::file("problems/kinds")).unwrap().map(|entry| entry.unwrap().path());
    let kinds: Vec<PathBuf> = kinds.filter(|path| path.extension().is_some_and(|e| e == "json")).collect();
    assert!(kinds.len() >= 6);
    support::problems().into_iter().chain(kinds).collect()
}

#[test]
fn every_problem_has_a_sparse_solution() {
    all().into_par_iter().for_each(|path| {
        let problem = problem(&path);
        for solver in ["conic-lasso", "conic-group-lasso"] {
            let report = found(&problem, solver, &Stop::default()).report;
            let (outcome, kkt) = (&report.outcome, report.kkt.unwrap());
            eprintln!("{} {solver}: {outcome} in {}, kkt {kkt:.1e}", path.display(), report.trace.len());
            assert!(outcome.converged(), "{} {solver}: {outcome}", path.display());
            assert!(kkt < 1e-6, "{} {solver}: {kkt:e}", path.display());
        }
    });
}

/// Near the end steps are 1e-5 of the deviations or less, in units of which the programs are posed; and shorter yet under
/// a trust region.
#[test]
fn programs_of_short_steps_are_feasible() {
    let problem = problem(&support::file("problems/kinds/serial-puma560-mixed.json"));
    let near = found(&problem, "conic-group-lasso", &Stop { iterations: 2, ..Stop::default() });
    let at = near.geometry.deviations_from(&near.start.nominal());
    let calibration = Calibration::new(&near.start, &problem.data.samples, Form::Complete, &at);
    let x = calibration.coordinates().nearest(&at);
    let here = Here::at(&calibration, &x, false).unwrap();
    let (limits, metric) = (Limits::unlimited(x.len()), vec![1.0; x.len()]);
    for (lasso, group) in [(1.0, 0.0), (0.0, 1.0)] {
        let penalty = Penalty { ridge: 1e-8, lasso, group };
        let groups = calibration.groups();
        let model = Model { loss: &LeastSquares, penalty, limits: &limits, groups, metric: &metric };
        for unit in [1e-3, 1e-5, 1e-7] {
            let columns = column_norms(&here.jac);
            let largest = columns.iter().fold(0.0f64, |a, c| a.max(*c));
            let frame = Frame { here: &here, unit: columns.iter().map(|c| unit * largest / c).collect() };
            for radius in [None, Some(1e-2), Some(1e-6)] {
                let solution = model.program(&frame, radius, &[]).solve().unwrap();
                let status = solution.status;
                let infeasible = matches!(
                    status,
                    Status::PrimalInfeasible
                        | Status::DualInfeasible
                        | Status::AlmostPrimalInfeasible
                        | Status::AlmostDualInfeasible
                );
                let refused = infeasible || (unit > 1e-6 && usable(&solution, &frame).is_none());
                assert!(!refused, "{unit:e} {radius:?}: {status:?}");
            }
        }
    }
}
