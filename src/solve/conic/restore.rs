//! A point within all limits to start from, or the names of the limits that exclude each other.

use super::here::Here;
use super::limits::Limits;
use super::loss::Frame;
use super::program::{Owner, Program, Solution};
use crate::problem::{Group, Param};
use crate::solve::report::Failure;
use clarabel::solver::SolverStatus;
use faer::Mat;

/// Overstepping, in units of `x`, that counts as within the limits.
const SLACK: f64 = 1e-9;

/// The point within `limits` nearest to `start`.
pub fn restore(
    start: &[f64],
    limits: &Limits,
    groups: &[Group],
    params: &[Param],
) -> Result<Vec<f64>, Failure> {
    let mut x = start.to_vec();
    limits.clamp(&mut x);
    if limits.violation(&x, groups) <= SLACK {
        return Ok(x);
    }
    let unit = units(&x, limits);
    let (program, solution) = nearest(&x, limits, groups)?;
    match solution.status {
        SolverStatus::Solved | SolverStatus::AlmostSolved => {
            for (x, (step, unit)) in x.iter_mut().zip(solution.x.iter().zip(&unit)) {
                *x += step * unit;
            }
            limits.clamp(&mut x);
            if limits.violation(&x, groups) <= 1e-6 * limits.cone {
                Ok(x)
            } else {
                Err(Failure::Inner(format!(
                    "{:?} while looking for a point within the limits",
                    solution.status
                )))
            }
        }
        SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible => {
            let conflict = minimal(program.clash(&solution.z), &x, limits, groups)?;
            let name = |owner: &Owner| match owner {
                Owner::Param(i) => params.get(*i).map(|p| p.name.clone()),
                Owner::Group(g) => groups.get(*g).map(|group| group.name.clone()),
                Owner::Nobody => None,
            };
            Err(Failure::Infeasible(conflict.iter().filter_map(name).collect()))
        }
        other => Err(Failure::Inner(format!("{other:?} while looking for a point within the limits"))),
    }
}

/// The program for the nearest point within limits, and its solution.
fn nearest(x: &[f64], limits: &Limits, groups: &[Group]) -> Result<(Program, Solution), Failure> {
    let here = Here { x: x.to_vec(), r: Vec::new(), jac: Mat::zeros(0, x.len()), cost: 0.0 };
    let frame = Frame { here: &here, unit: units(x, limits) };
    let mut program = Program::new(x.len());
    for (j, unit) in frame.unit.iter().enumerate() {
        program.quadratic[(j, j)] = unit * unit;
    }
    limits.pose(&mut program, &frame, groups);
    let solution = program.solve().map_err(Failure::Inner)?;
    Ok((program, solution))
}

/// The certificate's limits without those that the conflict does not need, in the order of the problem.
fn minimal(
    suspects: Vec<Owner>,
    x: &[f64],
    limits: &Limits,
    groups: &[Group],
) -> Result<Vec<Owner>, Failure> {
    let mut kept = suspects.clone();
    for suspect in suspects {
        let rest: Vec<Owner> = kept.iter().copied().filter(|owner| *owner != suspect).collect();
        let alone =
            |i: usize, value: f64, none: f64| if rest.contains(&Owner::Param(i)) { value } else { none };
        let fewer = Limits {
            lower: limits.lower.iter().enumerate().map(|(i, &v)| alone(i, v, f64::NEG_INFINITY)).collect(),
            upper: limits.upper.iter().enumerate().map(|(i, &v)| alone(i, v, f64::INFINITY)).collect(),
            cone: limits.cone,
        };
        let named = groups.iter().enumerate().filter(|(g, _)| rest.contains(&Owner::Group(*g)));
        let fewer_groups: Vec<Group> = named.map(|(_, group)| group.clone()).collect();
        let status = nearest(x, &fewer, &fewer_groups)?.1.status;
        if matches!(status, SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible) {
            kept = rest;
        }
    }
    kept.sort_unstable();
    Ok(kept)
}

/// One unit per coordinate: the farther of its limits, or the cone's where that is nearer.
fn units(x: &[f64], limits: &Limits) -> Vec<f64> {
    x.iter()
        .zip(limits.lower.iter().zip(&limits.upper))
        .map(|(x, (lower, upper))| {
            let reach = (upper - x).max(x - lower).min(limits.cone);
            if reach > 0.0 && reach.is_finite() { reach } else { 1.0 }
        })
        .collect()
}
