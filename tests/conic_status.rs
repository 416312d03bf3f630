//! Every way in which clarabel can end, provoked where it can be, and what is made of it.

use clarabel::solver::SolverStatus;
use faer::Mat;
use gough::problem::{Dual, EvalError, Formula};
use gough::solve::conic::here::Here;
use gough::solve::conic::loss::Frame;
use gough::solve::conic::program::{Owner, Program, Solution};
use gough::solve::conic::step::{NoStep, usable};
use gough::solve::{Failure, Identifier, Outcome, Stop, conic::Conic};

/// `min |x - 3|^2 / 2` in two variables within `|x_i| <= 1` and, to make it work for it, a cone.
fn program() -> Program {
    let mut program = Program::new(2);
    for i in 0..2 {
        program.quadratic[(i, i)] = 1.0;
        program.linear[i] = -3.0;
        program.at_most([(i, 1.0)], 1.0, Owner::Param(i));
        program.at_most([(i, -1.0)], 1.0, Owner::Param(i));
    }
    program.within((None, 1.2), [(0, 1.0, 0.0), (1, 1.0, 0.0)], Owner::Group(0));
    program
}

fn status(program: &Program) -> SolverStatus {
    program.solve().expect("data it takes").status
}

fn point(x: &[f64]) -> Here {
    Here { x: x.to_vec(), r: Vec::new(), jac: Mat::zeros(0, x.len()), cost: 0.0 }
}

/// Whether the point of a solution with that status is used.
fn used(status: SolverStatus, x: Vec<f64>) -> bool {
    let here = point(&[0.0, 0.0]);
    let frame = Frame { here: &here, unit: vec![1.0; 2] };
    usable(&Solution { status, x, z: Vec::new() }, &frame).is_some()
}

#[test]
fn solved() {
    let solution = program().solve().expect("data it takes");
    assert_eq!(solution.status, SolverStatus::Solved);
    let expected = 1.2 / 2f64.sqrt();
    assert!(solution.x.iter().all(|x| (x - expected).abs() < 1e-7), "{:?}", solution.x);
    assert!(used(SolverStatus::Solved, vec![1.0, 1.0]));
}

#[test]
fn at_the_iteration_limit() {
    let mut short = program();
    short.iterations = 2;
    assert_eq!(status(&short), SolverStatus::MaxIterations);
    assert!(used(SolverStatus::MaxIterations, vec![1.0, 1.0]), "the true merit judges it");
}

#[test]
fn almost_solved_or_out_of_progress() {
    let mut greedy = program();
    greedy.tolerance = 1e-18;
    let status = status(&greedy);
    let expected = [SolverStatus::AlmostSolved, SolverStatus::InsufficientProgress];
    assert!(expected.contains(&status), "{status:?}");
    assert!(expected.into_iter().all(|status| used(status, vec![1.0, 1.0])));
    assert!(expected.into_iter().all(|status| !used(status, vec![f64::NAN, 1.0])));
}

#[test]
fn infeasible_with_a_certificate_that_names_the_culprits() {
    let mut clash = program();
    clash.at_most([(1, -1.0)], -2.0, Owner::Param(1));
    let solution = clash.solve().expect("data it takes");
    assert_eq!(solution.status, SolverStatus::PrimalInfeasible);
    assert!(clash.clash(&solution.z).contains(&Owner::Param(1)));
    assert!(!used(SolverStatus::PrimalInfeasible, vec![1.0, 1.0]));
    assert!(!used(SolverStatus::AlmostPrimalInfeasible, vec![1.0, 1.0]));
    // About a point within the limits it can only be rounding, and is not called anything else.
    let why = NoStep::of(SolverStatus::PrimalInfeasible).0;
    assert!(why.starts_with("numerical failure (PrimalInfeasible"), "{why}");
}

#[test]
fn unbounded() {
    let mut falling = Program::new(1);
    falling.linear[0] = -1.0;
    falling.at_most([(0, -1.0)], 0.0, Owner::Nobody);
    assert_eq!(status(&falling), SolverStatus::DualInfeasible);
    assert!(!used(SolverStatus::DualInfeasible, vec![1.0, 1.0]));
    assert!(!used(SolverStatus::AlmostDualInfeasible, vec![1.0, 1.0]));
}

#[test]
fn numerical_error() {
    let mut broken = program();
    broken.linear[0] = f64::NAN;
    assert_eq!(status(&broken), SolverStatus::NumericalError);
    assert!(!used(SolverStatus::NumericalError, vec![1.0, 1.0]));
}

/// No time limit is set and no callback registered, so that these two cannot come; they would be refused.
#[test]
fn what_cannot_come_is_refused_all_the_same() {
    for status in [SolverStatus::MaxTime, SolverStatus::CallbackTerminated, SolverStatus::Unsolved] {
        assert!(!used(status, vec![1.0, 1.0]), "{status:?}");
    }
}

#[test]
fn values_that_are_not_finite_never_reach_it() {
    let problem = Formula::new(1, |x: &[Dual]| -> Result<Vec<Dual>, EvalError> { Ok(vec![x[0].ln()]) });
    let report = Conic::bounded().identify(&problem, &[-1.0], &Stop::default());
    assert!(matches!(report.outcome, Outcome::Failed(Failure::Start(_))), "{}", report.outcome);
}
