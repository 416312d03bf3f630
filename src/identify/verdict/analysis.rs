//! All tests of one estimate: what depends on order, posture or joint first, then the noise, then single postures.

use super::Cause;
use super::groups::{self, GroupTest};
use super::joints::{JointPattern, joint_patterns};
use super::linear::{Grams, Linear, Residual, Solution};
use super::model;
use super::order;
use super::postures::{named, outlying, to_blame};
use crate::calibration::Sample;
use crate::identify::outliers::Outlier;
use crate::identify::run::Identification;
use faer::Mat;

/// Degrees of freedom below which a cell keeps the stated noise while other causes are sought.
const FEW: f64 = 8.0;
/// Causes that depend on order, posture or joint, at most.
const MOST: usize = 3;

/// What one estimate says.
pub(super) struct Analysis {
    /// Chi-square of each group.
    pub groups: Vec<GroupTest>,
    /// Causes found.
    pub causes: Vec<Cause>,
    /// Postures that stand out: indices of their samples, and what is said of them.
    pub outliers: Vec<(Vec<usize>, Outlier)>,
    /// Samples that close with the estimate.
    pub closing: Vec<usize>,
}

impl Analysis {
    /// Of an identification from those samples that are `active`. `None` where linear theory does not describe it.
    pub fn new(found: &Identification, samples: &[Sample], sets: &[usize], active: &[bool]) -> Option<Self> {
        let stated = Linear::new(found, samples, sets, active)?;
        let grams = stated.grams();
        let ones = vec![1.0; stated.cells.len()];
        let as_stated = stated.solve(&grams, &ones)?;
        let groups = groups::tests(&groups::groups(&stated.cells), &as_stated);
        // Causes are sought in residuals of equal variance, whatever was stated.
        let (mut noise, mut factors) = groups::noise(&stated, &grams, &as_stated);
        let equal = if noise.is_none() { None } else { Some(each(&stated, &grams)?) };
        let mut search = Search::new(found, &stated, samples, equal, &as_stated)?;
        search.run(found, samples)?;
        // Then the noise, beside what was found.
        let remainder = search.remainder(&stated);
        if let Some(remainder) = remainder {
            let grams = remainder.grams();
            let solution = remainder.solve(&grams, &ones)?;
            (noise, factors) = groups::noise(&remainder, &grams, &solution);
        }
        if search.causes.iter().any(|cause| matches!(cause, Cause::Model(_)))
            && let Some(finding) = &mut noise
        {
            // What a pattern leaves of errors that the model does not have is no noise.
            finding.keep_overstated();
        }
        let changed = noise.is_some() || !search.columns.is_empty();
        let mut causes = search.causes;
        causes.extend(noise.filter(|finding| !finding.parts.is_empty()).map(Cause::Noise));
        // Postures are judged by marginal residuals: those of readings in their order are not independent.
        let mut judged = stated;
        let mut solution = as_stated;
        if changed {
            for columns in &search.columns {
                judged = judged.extended(columns);
            }
            let mut rows = judged.rows();
            judged.normalise(&factors, &mut rows);
            judged.set_rows(&rows);
            solution = judged.solve(&judged.grams(), &ones)?;
        }
        let count = judged.spans.len();
        let outliers = outlying(&judged, &solution, samples).into_iter().map(|(members, outlier)| {
            let blamed = to_blame(found, samples, &members, count);
            let outlier = named(&outlier, samples, &blamed);
            (blamed, outlier)
        });
        let outliers = outliers.collect();
        Some(Self { groups, causes, outliers, closing: judged.closing })
    }

    /// Indices of the samples of the postures that stand out, ascending.
    pub fn outlying(&self, samples: &[Sample]) -> Vec<usize> {
        let mut named: Vec<usize> =
            self.outliers.iter().flat_map(|(group, _)| group.iter().copied()).collect();
        // What does not close stays out.
        named.extend((0..samples.len()).filter(|k| self.closing.binary_search(k).is_err()));
        named.sort_unstable();
        named
    }
}

/// The variance of each cell by itself, where there is enough of it.
fn each(linear: &Linear, grams: &Grams) -> Option<Vec<f64>> {
    let mut factors = vec![1.0; linear.cells.len()];
    for _ in 0..20 {
        let at = linear.solve(grams, &factors)?;
        for (factor, (q, freedom)) in factors.iter_mut().zip(at.square.iter().zip(&at.freedom)) {
            if *freedom >= FEW {
                *factor = (*factor * q / freedom).max(1e-12);
            }
        }
    }
    Some(factors)
}

/// The search for causes that depend on order, posture or joint.
struct Search {
    /// Rows in standard deviations, beside what was found.
    linear: Linear,
    patterns: Vec<JointPattern>,
    before: Vec<Option<usize>>,
    causes: Vec<Cause>,
    /// Further unknowns that were found, in rows as stated.
    columns: Vec<Mat<f64>>,
    /// Correlation that was found.
    correlation: Option<f64>,
    factors: Vec<f64>,
    /// Of the present rows, where it is known.
    present: Option<Residual>,
}

impl Search {
    fn new(
        found: &Identification,
        stated: &Linear,
        samples: &[Sample],
        equal: Option<Vec<f64>>,
        as_stated: &Solution,
    ) -> Option<Self> {
        let mut patterns = joint_patterns(found, stated, samples)?;
        let mut linear = stated.clone();
        let present = equal.is_none().then(|| Residual::of(stated, as_stated));
        if let Some(factors) = &equal {
            let mut rows = linear.rows();
            stated.normalise(factors, &mut rows);
            linear.set_rows(&rows);
            let columns = patterns.iter_mut().flat_map(JointPattern::columns);
            columns.for_each(|columns| stated.normalise(factors, columns));
        }
        let before = order::predecessors(stated);
        Some(Self {
            linear,
            patterns,
            before,
            causes: Vec::new(),
            columns: Vec::new(),
            correlation: None,
            factors: equal.unwrap_or_else(|| vec![1.0; stated.cells.len()]),
            present,
        })
    }

    fn residual(&mut self) -> Option<Residual> {
        if let Some(present) = self.present.take() {
            return Some(present);
        }
        let ones = vec![1.0; self.linear.cells.len()];
        let solution = self.linear.solve(&self.linear.grams(), &ones)?;
        Some(Residual::of(&self.linear, &solution))
    }

    /// Takes the cause with the most evidence, accounts for it, and looks again.
    fn run(&mut self, found: &Identification, samples: &[Sample]) -> Option<()> {
        for _ in 0..MOST {
            let residual = self.residual()?;
            if residual.freedom < FEW {
                break;
            }
            let ordered = match self.correlation {
                None => order::order(&self.linear, &residual, &self.before),
                Some(_) => None,
            };
            let mut drifting = order::drift_pattern(&self.linear);
            if let Some(rho) = self.correlation {
                order::decorrelate(&self.linear, &self.before, rho, &mut drifting.columns);
            }
            let has_drift = self.causes.iter().any(|cause| matches!(cause, Cause::Drift(..)));
            let drift_fit = drifting.fit(&self.linear, &residual).filter(|_| !has_drift);
            let drift = drift_fit.as_ref().and_then(|fit| order::drift(&self.linear, &drifting, fit));
            let joint = model::joint(&self.linear, &residual, &self.patterns);
            let gains = [
                ordered.as_ref().map(|f| f.gain - 0.5 * residual.freedom.ln()),
                drift.as_ref().map(|f| f.gain),
                joint.as_ref().map(|(f, ..)| f.gain),
            ];
            let best = gains.iter().enumerate().filter_map(|(i, gain)| Some((i, (*gain)?)));
            match (best.max_by(|a, b| a.1.total_cmp(&b.1)), ordered, drift, drift_fit, joint) {
                (Some((0, _)), Some(finding), ..) => {
                    let mut rows = self.linear.rows();
                    order::decorrelate(&self.linear, &self.before, finding.correlation, &mut rows);
                    let rho = finding.correlation;
                    for columns in self.patterns.iter_mut().flat_map(JointPattern::columns) {
                        order::decorrelate(&self.linear, &self.before, rho, columns);
                    }
                    self.linear.set_rows(&rows);
                    self.correlation = Some(rho);
                    self.causes.push(Cause::Order(finding));
                }
                (Some((1, _)), _, Some(finding), Some(fit), _) => {
                    let name = groups::cell_name(&self.linear.cells, finding.cell);
                    self.add(&fit.columns);
                    self.causes.push(Cause::Drift(finding, name));
                }
                (Some((2, _)), .., Some((finding, k, fit))) => {
                    self.add(&fit.columns);
                    self.patterns.remove(k);
                    self.causes.push(Cause::Model(finding));
                    // What one joint's pattern leaves of its errors is no further cause.
                    break;
                }
                _ => {
                    self.present = Some(residual);
                    break;
                }
            }
        }
        let residual = self.residual()?;
        if !self.causes.iter().any(|cause| matches!(cause, Cause::Model(_)))
            && let Some(finding) =
                model::neighbours(&found.supported, &self.linear, &residual, samples, &self.before)
        {
            self.causes.push(Cause::Model(finding));
        }
        Some(())
    }

    /// Further unknowns in the present rows.
    fn add(&mut self, columns: &Mat<f64>) {
        self.linear = self.linear.extended(columns);
        let mut columns = columns.clone();
        if let Some(rho) = self.correlation {
            order::recorrelate(&self.linear, &self.before, rho, &mut columns);
        }
        self.columns.push(columns);
    }

    /// The model as stated with what was found accounted for; `None` where that is the model as it was.
    fn remainder(&mut self, stated: &Linear) -> Option<Linear> {
        if self.columns.is_empty() && self.correlation.is_none() {
            return None;
        }
        let mut out = self.linear.clone();
        let back: Vec<f64> = self.factors.iter().map(|factor| 1.0 / factor).collect();
        let mut rows = out.rows();
        out.normalise(&back, &mut rows);
        out.set_rows(&rows);
        self.columns.iter_mut().for_each(|columns| stated.normalise(&back, columns));
        Some(out)
    }
}
