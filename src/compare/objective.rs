//! Constrained, sparse and robust estimates, held against what their identifiers say that they minimise.

use super::gain::Corner;
use crate::calibration::{Calibration, Sample};
use crate::identify::Identification;
use crate::linalg;
use crate::model::{Geometry, Mechanism};
use crate::problem::{Form, Group, Problem, Representative};
use crate::solve::Objective;
use crate::solve::anchored::by_representative;
use crate::solve::conic::loss::{Loss, loss};
use crate::solve::split::prior_weight;
use faer::Mat;
use std::ops::Range;

/// Size, in tolerances, up to which a coordinate is zero or at its limit.
const TOUCHES: f64 = 1e-7;

/// A machine as an objective sees it: residuals of data and prior, and limits.
struct Seen {
    x: Vec<f64>,
    r: Vec<f64>,
    jac: Mat<f64>,
    /// Rows that were measured together, and how many of the last rows are the prior's.
    blocks: Vec<Range<usize>>,
    prior: usize,
    /// The rows of the prior by the representative; empty where there is none.
    prior_rows: Mat<f64>,
    /// Limit of every coordinate.
    limits: Vec<(f64, f64)>,
    groups: Vec<Group>,
    /// Largest distance by which a limit is overstepped, tolerances; negative where all are kept.
    over: f64,
    /// Whether coordinates by themselves matter.
    form: Form,
}

/// What an objective says of a result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Judged {
    /// Its value at the result.
    pub value: f64,
    /// The same at the machine that the result is compared with; `None` where limits exclude that.
    pub reference: Option<f64>,
    /// Where limits exclude that machine, the value at the one that it becomes when it is brought within them.
    pub within: Option<f64>,
    /// Distance from a stationary point (docs/theory.md (13.5)); `None` for a loss without a derivative.
    pub offset: Option<f64>,
    /// For such a loss the part by which the value may still fall (13.7).
    pub gain: Option<f64>,
    /// Whether the result lies on a limit, so that noise alone need not explain its residual.
    pub limited: bool,
}

/// Judges a result by its objective, against the links of `reference`; `None` where the identifier states no objective
/// or a sample does not close.
pub fn judged(found: &Identification, samples: &[Sample], reference: &Geometry) -> Option<Judged> {
    let objective = found.report.objective.as_ref()?;
    let here = Seen::at(&found.start, &found.geometry, samples, objective, None)?;
    // Far from the noise Huber's threshold follows the residual; the reference is judged by the same one.
    let loss = loss(objective.loss, objective.delta)?;
    let asked = loss.arranged(&here.blocks, here.r.len(), here.prior);
    let loss = asked.at_scale(&here.r);
    let at = |geometry: &Geometry| Seen::at(&found.start, geometry, samples, objective, Some(here.form));
    let value = |seen: Seen| (seen.over <= TOUCHES).then(|| seen.value(objective, loss.as_ref()));
    let there = at(reference);
    let excluded = there.as_ref().is_some_and(|there| there.over > TOUCHES);
    let nearest = || at(&brought_within(&found.start, reference, objective));
    Some(Judged {
        value: here.value(objective, loss.as_ref()),
        reference: there.and_then(value),
        within: excluded.then(nearest).flatten().and_then(value),
        offset: loss.smooth().then(|| here.offset(objective, loss.as_ref())).flatten(),
        gain: (!loss.smooth()).then(|| here.gain(found, samples, objective, loss.as_ref())).flatten(),
        limited: here.over >= -TOUCHES,
    })
}

/// The machine with every deviation cut at its limits, and shrunk to the length that cones allow.
fn brought_within(start: &Mechanism, geometry: &Geometry, objective: &Objective) -> Geometry {
    let none: [Sample; 0] = [];
    let at = geometry.deviations_from(&start.nominal());
    let complete = Calibration::new(start, &none, Form::Complete, &at);
    let mut x = complete.coordinates().nearest(&at);
    for (x, (low, high)) in x.iter_mut().zip(limits(&complete, objective)) {
        *x = x.min(high).max(low);
    }
    for group in complete.groups() {
        let shrink = (objective.cone / group.length(&x).max(f64::MIN_POSITIVE)).min(1.0);
        group.members.iter().for_each(|&i| x[i] *= shrink);
    }
    start.deviated(&complete.coordinates().deviations(&x))
}

/// Limits of all complete coordinates.
fn limits(complete: &Calibration<'_>, objective: &Objective) -> Vec<(f64, f64)> {
    let limit = |bounds: (f64, f64)| (bounds.0.max(-objective.bounds), bounds.1.min(objective.bounds));
    complete.params().iter().map(|param| limit(param.bounds)).collect()
}

/// Largest distance by which `x` oversteps a limit, negative where it keeps all.
fn overstepped(x: &[f64], limits: &[(f64, f64)], cone: f64, groups: &[Group]) -> f64 {
    let beyond = x.iter().zip(limits).map(|(x, (low, high))| (low - x).max(x - high));
    let far = groups.iter().map(|group| group.length(x) - cone);
    beyond.chain(far).fold(f64::NEG_INFINITY, f64::max)
}

/// Coordinates without redundancy stand for themselves.
fn itself(x: &[f64]) -> Representative {
    Representative { z: x.to_vec(), jac: Mat::identity(x.len(), x.len()) }
}

impl Seen {
    /// The machine in `form`, or in the one that suits it.
    fn at(
        start: &Mechanism,
        geometry: &Geometry,
        samples: &[Sample],
        objective: &Objective,
        form: Option<Form>,
    ) -> Option<Self> {
        let at = geometry.deviations_from(&start.nominal());
        let of = |form| Calibration::new(start, samples, form, &at);
        let complete = of(Form::Complete);
        let limits = limits(&complete, objective);
        let over =
            overstepped(&complete.coordinates().nearest(&at), &limits, objective.cone, complete.groups());
        // Only where equivalent descriptions cost the same, and no limit tells them apart, the redundancy can be left
        // out.
        let by_themselves = objective.threshold.is_none() || over >= -TOUCHES;
        let form = form.unwrap_or(if by_themselves { Form::Complete } else { Form::Minimal });
        let (problem, limits, groups) = match form {
            Form::Complete => {
                let groups = complete.groups().to_vec();
                (complete, limits, groups)
            }
            _ => (of(form), Vec::new(), Vec::new()),
        };
        if !problem.set_aside().is_empty() {
            return None;
        }
        let x = problem.coordinates().nearest(&at);
        let mut lin = problem.linearize(&x).ok()?;
        let (mut prior, mut prior_rows) = (0, Mat::zeros(0, 0));
        if let Some(threshold) = objective.threshold {
            let of = problem.representative(&x).unwrap_or_else(|| itself(&x));
            let svd = linalg::svd(by_representative(lin.jac.as_ref(), &of).as_ref())?;
            let root = |k: usize| prior_weight(svd.s.get(k).copied().unwrap_or(0.0) / threshold).sqrt();
            // Directions without a prior have no row.
            let weak: Vec<usize> = (0..of.z.len()).filter(|&k| root(k) > 0.0).collect();
            let rows = Mat::from_fn(weak.len(), of.z.len(), |i, j| root(weak[i]) * svd.v[(j, weak[i])]);
            prior = weak.len();
            lin.r.extend(linalg::mul(rows.as_ref(), &of.z));
            lin.jac = faer::concat![[lin.jac], [&rows * of.jac]];
            prior_rows = rows;
        }
        let blocks = problem.blocks();
        Some(Self { x, r: lin.r, jac: lin.jac, blocks, prior, prior_rows, limits, groups, over, form })
    }

    fn value(&self, objective: &Objective, loss: &dyn Loss) -> f64 {
        let squares: f64 = self.x.iter().map(|x| x * x).sum();
        let sizes: f64 = self.x.iter().map(|x| x.abs()).sum();
        let lengths: f64 = self.groups.iter().map(|group| group.length(&self.x)).sum();
        loss.merit(&self.r)
            + 0.5 * objective.ridge * squares
            + objective.lasso * sizes
            + objective.group * lengths
    }

    /// (13.7), with the residual of the nonlinear problem.
    fn gain(
        &self,
        found: &Identification,
        samples: &[Sample],
        objective: &Objective,
        loss: &dyn Loss,
    ) -> Option<f64> {
        let at = found.geometry.deviations_from(&found.start.nominal());
        let problem = Calibration::new(&found.start, samples, self.form, &at);
        let residual = |x: &[f64]| {
            let mut r = problem.residual(x).ok()?;
            if self.prior > 0 {
                let z = problem.representative(x).map_or_else(|| x.to_vec(), |of| of.z);
                r.extend(linalg::mul(self.prior_rows.as_ref(), &z));
            }
            Some(r)
        };
        let Self { x, r, jac, limits, groups, .. } = self;
        Corner { x, r, jac, limits, groups }.gain(objective, loss, residual)
    }

    /// (13.5): the Gauss-Newton step on the face of the limits and of the zeros that the point lies on, no longer than
    /// tolerances allow, in units of its uncertainty.
    fn offset(&self, objective: &Objective, loss: &dyn Loss) -> Option<f64> {
        let influence = loss.influence(&self.r);
        let mut g = linalg::mul_transpose(self.jac.as_ref(), &influence);
        g.iter_mut().zip(&self.x).for_each(|(g, x)| *g += objective.ridge * x);
        let mut free = vec![true; g.len()];
        self.penalise(objective, &mut g, &mut free);
        for (i, (low, high)) in self.limits.iter().enumerate() {
            let (x, pull) = (self.x[i], g[i]);
            if (x >= high - TOUCHES && pull <= 0.0) || (x <= low + TOUCHES && pull >= 0.0) {
                free[i] = false;
            }
        }
        self.hold_cones(objective, &mut g, &free);
        // Rows on the linear part of the loss have no curvature.
        let curved: Vec<usize> = (0..self.r.len()).filter(|&i| influence[i] == self.r[i]).collect();
        let kept: Vec<usize> = (0..g.len()).filter(|&i| free[i]).collect();
        if kept.is_empty() {
            return Some(0.0);
        }
        let face = Mat::from_fn(curved.len(), kept.len(), |i, j| self.jac[(curved[i], kept[j])]);
        let svd = linalg::svd(face.as_ref())?;
        let along = linalg::mul_transpose(svd.v.as_ref(), &kept.iter().map(|&i| g[i]).collect::<Vec<f64>>());
        let curvature = |k: usize| svd.s.get(k).map_or(0.0, |s| s * s) + objective.ridge;
        let decrement: f64 = along.iter().enumerate().map(|(k, g)| g * g / curvature(k).max(1.0)).sum();
        let known = (0..along.len()).filter(|&k| curvature(k) > 1.0).count().max(1) as f64;
        // In units of the stated noise however large the residual is: what limits leave is no noise.
        let offset = (decrement / known).sqrt();
        // Whatever oversteps a limit is no solution.
        let possible = self.over <= TOUCHES;
        offset.is_finite().then_some(if possible { offset } else { f64::MAX })
    }

    /// Adds to the gradient the subgradients of least size of the sparse penalties; what they hold at zero is not free.
    fn penalise(&self, objective: &Objective, g: &mut [f64], free: &mut [bool]) {
        if objective.lasso > 0.0 {
            for i in 0..g.len() {
                if self.x[i].abs() > TOUCHES {
                    g[i] += objective.lasso.copysign(self.x[i]);
                } else {
                    let beyond = (g[i].abs() - objective.lasso).max(0.0);
                    (g[i], free[i]) = (beyond.copysign(g[i]), beyond > 0.0);
                }
            }
        }
        if objective.group > 0.0 {
            for group in &self.groups {
                let size = group.length(&self.x);
                let pull = group.length(g);
                let held = size <= TOUCHES && pull <= objective.group;
                for &i in &group.members {
                    g[i] = match size > TOUCHES {
                        true => g[i] + objective.group * self.x[i] / size,
                        false if held => 0.0,
                        false => g[i] * (1.0 - objective.group / pull),
                    };
                    free[i] &= !held;
                }
            }
        }
    }

    /// Takes from the gradient what the cones carry that the point lies on.
    fn hold_cones(&self, objective: &Objective, g: &mut [f64], free: &[bool]) {
        for group in self.groups.iter().filter(|group| group.length(&self.x) >= objective.cone - TOUCHES) {
            let members = || group.members.iter().copied().filter(|&i| free[i]);
            let square: f64 = members().map(|i| self.x[i] * self.x[i]).sum();
            let along: f64 = members().map(|i| self.x[i] * g[i]).sum();
            if square > 0.0 && along < 0.0 {
                members().for_each(|i| g[i] -= along / square * self.x[i]);
            }
        }
    }
}
