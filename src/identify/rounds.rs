//! Rounds of one identification: run, close the samples with what was found, run again where that changes them.

use super::counts::visibility;
use super::covariance::Covariance;
use super::cross_validation::Influence;
use super::outliers::outliers;
use super::run::Identification;
use super::score::score;
use super::sides::Sides;
use super::singularities::{NEAR_SINGULAR, singularities};
use crate::calibration::{ByPosture, Calibration, Coordinates, Sample, SetAside};
use crate::lie::Se3;
use crate::model::Mechanism;
use crate::problem::Form;
use crate::solve::limbwise::Limbwise;
use crate::solve::{Criterion, Estimate, Failure, Identifier, Iterate, Outcome, Report, Stop};
use std::collections::HashSet;

/// How often postures that were set aside are taken back.
const ROUNDS: usize = 8;
/// Part of the iterations left, as 1 in so many, that a round of part of the samples may take.
const SHARE: usize = 4;
/// Residual, in standard deviations of the noise, that is rounding.
pub(super) const EXACT: f64 = 1e-6;

/// One identification on its way.
pub(super) struct Run<'a> {
    /// The drawing, its free ends registered.
    pub start: &'a Mechanism,
    pub problem: Calibration<'a>,
    /// Weighted by their noise.
    pub measured: &'a [Sample],
    /// Weighted as the identifier's form wants them.
    pub samples: &'a [Sample],
    pub identifier: &'a dyn Identifier,
    pub stop: &'a Stop,
    /// Over all rounds, from where the way last began.
    pub trace: Vec<Iterate>,
    /// Link deviations reached, rad and m.
    pub at: Vec<f64>,
}

impl Run<'_> {
    /// Runs the identifier until the samples that take part are those that close with what it found.
    ///
    /// While samples wait, a round only leads to where they close. Few samples may leave the machine in a flat valley,
    /// whose minimum is worth nothing: such a round ends early, so that iterations are left for all the samples.
    pub fn rounds(&mut self) -> Report {
        let mut x = self.problem.coordinates().nearest(&self.at);
        let (mut round, mut settled, mut led_past) = (0, false, false);
        let mut spent = 0;
        let mut report = loop {
            let part = !settled && round + 1 < ROUNDS && self.problem.sample_count() < self.samples.len();
            let left = self.stop.iterations.saturating_sub(spent);
            let report = self.report(&x, if part { left.div_ceil(SHARE) } else { left });
            self.trace.extend_from_slice(&report.trace);
            spent += report.trace.len();
            round += 1;
            if !report.cost.is_finite() || !report.x.iter().all(|v| v.is_finite()) {
                break report;
            }
            x.copy_from_slice(&report.x);
            self.at = self.problem.coordinates().deviations(&x);
            // A posture that comes to a singularity on the way is where the identifier cannot pass: it waits.
            let blocked = matches!(report.outcome, Outcome::Failed(Failure::Evaluation(_)));
            if blocked && !led_past {
                led_past = true;
                if self.limb_by_limb() {
                    x = self.problem.coordinates().nearest(&self.at);
                    self.trace.clear();
                    settled = false;
                    continue;
                }
            }
            let least = if blocked { NEAR_SINGULAR } else { 0.0 };
            let changed = self.problem.take_back(self.samples, &self.at, least);
            let exhausted = spent >= self.stop.iterations;
            // Where the same samples take part as before, the round goes on with all iterations that are left.
            let cut = part && report.outcome == Outcome::OutOfIterations;
            settled = !changed;
            if !(changed || cut) || exhausted || round == ROUNDS || self.problem.sample_count() == 0 {
                break report;
            }
        };
        if self.problem.sample_count() == 0 && report.outcome.converged() {
            let first = self.problem.set_aside().first();
            let why = first.map_or_else(String::new, |s| format!("{}: {}", s.name, s.reason.unitless()));
            report.outcome = Outcome::Failed(Failure::Evaluation(why));
        }
        report
    }

    /// Leads past loops that open on the way: limbs that are brought to the measured poses one by one know of none. Goes to
    /// the machine that they make where that explains the poses better than the one at which the way ended, and returns
    /// whether it does.
    fn limb_by_limb(&mut self) -> bool {
        let drawn = vec![0.0; self.at.len()];
        let samples = self.problem.closed(self.measured);
        let limbs = Calibration::new(self.start, &samples, Form::Minimal, &drawn);
        let report = Limbwise.identify(&limbs, &limbs.coordinates().nearest(&drawn), self.stop);
        let at = limbs.coordinates().deviations(&report.x);
        if !at.iter().all(|v| v.is_finite()) {
            return false;
        }
        let error = |at: &[f64]| {
            let fit = score(self.start, &self.start.deviated(at), &samples)?;
            (2 * fit.samples > samples.len() && fit.weighted_rms.is_finite()).then_some(fit.weighted_rms)
        };
        let Some(there) = error(&at) else { return false };
        if error(&self.at).is_some_and(|here| here <= there) {
            return false;
        }
        self.problem.take_back(self.samples, &at, 0.0);
        self.at = at;
        true
    }

    /// The identifier's report from `x`, of at most `left` iterations. Where the samples are exact there, residuals are
    /// rounding, which an identifier may follow for ever: it need not find anything better.
    fn report(&self, x: &[f64], left: usize) -> Report {
        let exact = self.is_exact();
        let iterations = if exact { left.min(1) } else { left };
        let mut report = self.identifier.identify(&self.problem, x, &Stop { iterations, ..*self.stop });
        let refused = |outcome: &Outcome| {
            matches!(outcome, Outcome::Failed(Failure::Infeasible(_) | Failure::Unsuited(_)))
        };
        if exact && !report.outcome.converged() && !refused(&report.outcome) {
            report.x = x.to_vec();
            report.cost = 0.0;
            report.trace.clear();
            report.outcome = Outcome::Converged(Criterion::Zero);
        }
        report
    }

    /// Whether the machine as it stands predicts all samples that take part to rounding.
    fn is_exact(&self) -> bool {
        let geometry = self.start.deviated(&self.at);
        let exact = |samples: &[Sample]| {
            score(self.start, &geometry, samples).is_some_and(|fit| fit.weighted_rms < EXACT)
        };
        // One sample is looked at first: data are hardly ever exact.
        let Some((first, _)) = self.measured.split_first() else { return false };
        if !exact(std::slice::from_ref(first)) {
            return false;
        }
        exact(&self.taking())
    }

    /// The samples that take part, each to be closed from where it was closed.
    fn taking(&self) -> Vec<Sample> {
        let closed = self.problem.closed(self.measured).into_iter().enumerate();
        let apart: HashSet<usize> = self.problem.set_aside().iter().map(|s| s.sample).collect();
        closed.filter(|(i, _)| !apart.contains(i)).map(|(_, sample)| sample).collect()
    }

    /// Whether samples that stand out were measured in other postures than those in which they were closed, by the
    /// machine that the others give.
    pub fn reconsider(&mut self, found: &Identification) -> bool {
        if found.outliers.is_empty() || found.start.is_open_chain() {
            return false;
        }
        let taking = found.taking_part(self.measured);
        let names: HashSet<&str> =
            found.outliers.iter().flat_map(|o| &o.samples).map(String::as_str).collect();
        let out = |sample: &Sample| names.contains(sample.name.as_str());
        let postures = ByPosture::of(&taking);
        let outlying = postures.iter().enumerate().filter(|(_, of)| of.iter().all(|i| out(&taking[*i])));
        let inside: Vec<usize> = outlying.map(|(posture, _)| posture).collect();
        let without = Influence::new(found, &taking).ok().and_then(|influence| influence.without(&inside));
        let geometry = without.as_ref().unwrap_or(&found.geometry);
        let doubted: Vec<usize> = (0..self.samples.len()).filter(|&i| out(&self.samples[i])).collect();
        self.problem.reconsider(self.samples, &doubted, &geometry.deviations_from(&found.start.nominal()))
    }

    /// What came of it.
    pub fn found(
        &self,
        drawn: &Mechanism,
        report: Report,
        set_aside_at_start: &[SetAside],
    ) -> Identification {
        let (start, problem, at) = (self.start, &self.problem, &self.at);
        let taking = self.taking();
        let geometry = start.deviated(at);
        let visibility_at = |at: &[f64]| visibility(start, &taking, at).ok();
        let at_solution = visibility_at(at);
        let covariance = match (report.estimate, at_solution.as_ref()) {
            // Linear theory is that of whitened residuals, at their least.
            _ if self.identifier.form() == Form::Plain || !report.outcome.converged() => None,
            (Estimate::Decoupled { .. }, Some(_)) => {
                Covariance::decoupled(report.estimate, problem, &report.x).ok().flatten()
            }
            (estimate, seen) => seen.and_then(|seen| Covariance::joint(estimate, seen)),
        };
        let minimal = Coordinates::new(start, Form::Minimal);
        let variances =
            covariance.as_ref().map(|c| c.of_deviations(&c.of_links(&minimal, at), drawn, &geometry));
        let near_singular = singularities(start, &geometry, &taking);
        let mut found = Identification {
            fit: (score(start, &start.nominal(), &taking), score(start, &geometry, &taking)),
            nominal: visibility_at(&vec![0.0; at.len()]),
            deviations: geometry.deviations_from(&drawn.nominal()),
            rows: problem.rows(),
            sides: Sides::default(),
            near_singular,
            outliers: Vec::new(),
            set_aside: problem.set_aside().to_vec(),
            visibility: at_solution,
            start: start.clone(),
            supported: start.clone(),
            tolerance_test: None,
            untold: Vec::new(),
            placed: (Se3::identity(), Se3::identity()),
            geometry,
            variances,
            covariance,
            report,
            trace: self.trace.clone(),
            set_aside_at_start: set_aside_at_start.to_vec(),
            taking,
        };
        found.outliers = outliers(&found, self.measured);
        found
    }
}
