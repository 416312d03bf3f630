//! Identification with tolerances that are tested: where the deviations contradict them, under those that they support.

use super::counts::visibility;
use super::evidence::{Evidence, ToleranceTest, ToleranceVerdict};
use super::run::{Identification, IdentifyError, identify_from};
use crate::calibration::{Calibration, Sample};
use crate::model::Mechanism;
use crate::problem::Form;
use crate::solve::{Estimate, Identifier, Iterate, Stop};
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Most identifications under restated tolerances.
const ROUNDS: usize = 6;
/// Relative change of the factor at which it has settled: half of its standard error where 200 directions are decided.
const SETTLED: f64 = 0.025;
/// Factor beyond which it is not followed: such a machine is not the one that was drawn.
const MOST: f64 = 100.0;
/// Probability of the residual below which the size of the noise is taken from it.
const CONTRADICTED: f64 = 1e-3;

/// Identifies the machine's deviations from the samples.
///
/// The stated tolerances are tested by the deviations that come out (docs/theory.md (10.19)). Where these are larger, the
/// machine is identified again under tolerances of the most likely size until that settles: an estimate that leans on
/// tolerances too small is pulled towards the drawing, and its errors are stated too small.
pub fn identify(
    drawn: &Mechanism,
    samples: &[Sample],
    identifier: &dyn Identifier,
    stop: &Stop,
) -> Result<Identification, IdentifyError> {
    let zeros = vec![0.0; drawn.component_count()];
    let mut first = identify_from(drawn, samples, identifier, stop, &zeros)?;
    let Some(test) = tolerance_test(&first, samples, 1.0) else { return Ok(first) };
    // What did not end says nothing of the machine.
    first.tolerance_test = Some(test).filter(|_| first.report.outcome.converged());
    if test.verdict != ToleranceVerdict::TooSmall || !follows(&first, identifier) {
        return Ok(first);
    }
    let mut trace = first.trace.clone();
    let mut last: Option<(Identification, ToleranceTest)> = None;
    let mut wanted = test.factor;
    for _ in 0..ROUNDS {
        if wanted > MOST {
            break;
        }
        // Where tolerances too small led astray, the drawing is the better start.
        let from = match &last {
            Some((before, _)) => before.geometry.deviations_from(&before.start.nominal()),
            None if first.report.outcome.converged() => {
                first.geometry.deviations_from(&first.start.nominal())
            }
            None => zeros.clone(),
        };
        let wider = drawn.with_tolerances(wanted);
        // What was found with the tolerances as stated stands where this goes nowhere.
        let Ok(mut next) = identify_from(&wider, samples, identifier, stop, &from) else { break };
        trace.extend_from_slice(&next.trace);
        if !next.report.outcome.converged() && from != zeros {
            let Ok(again) = identify_from(&wider, samples, identifier, stop, &zeros) else { break };
            next = again;
            trace.extend_from_slice(&next.trace);
        }
        let test = tolerance_test(&next, samples, 1.0 / wanted);
        let Some(test) = test.filter(|_| next.report.outcome.converged()) else { break };
        let (change, likely) = ((test.factor / wanted).ln().abs(), test.factor);
        // Where the factor has not settled, the one in force may lie beside the interval found under it.
        let interval = (test.interval.0.min(wanted), test.interval.1.max(wanted));
        last = Some((next, ToleranceTest { factor: wanted, in_force: wanted, interval, ..test }));
        if change <= SETTLED {
            break;
        }
        wanted = likely;
    }
    match last {
        Some((found, test)) if test.verdict == ToleranceVerdict::TooSmall => {
            Ok(restated(found, test, &first, trace))
        }
        _ => Ok(first),
    }
}

/// Whether tolerances decide what the identifier estimates, apart from limits that are stated in them.
fn follows(found: &Identification, identifier: &dyn Identifier) -> bool {
    identifier.form() != Form::Plain && found.report.estimate != Estimate::Other
}

/// What was found under tolerances that the data support, told in those that were stated.
fn restated(
    found: Identification,
    test: ToleranceTest,
    first: &Identification,
    trace: Vec<Iterate>,
) -> Identification {
    let mut start = found.start.clone();
    let stated = first.start.limbs.iter().flat_map(|limb| &limb.links);
    let own = start.limbs.iter_mut().flat_map(|limb| &mut limb.links);
    own.zip(stated).for_each(|(link, stated)| link.tolerance = stated.tolerance);
    start.ends = first.start.ends;
    let constants = start.instrument.iter_mut().zip(&first.start.instrument);
    constants.for_each(|(constant, stated)| constant.prior = stated.prior);
    let at = found.geometry.deviations_from(&start.nominal());
    Identification {
        visibility: visibility(&start, &found.taking, &at).ok(),
        nominal: first.nominal.clone(),
        set_aside_at_start: first.set_aside_at_start.clone(),
        start,
        tolerance_test: Some(test),
        trace,
        ..found
    }
}

/// Test of tolerances that are `stated` times those under which `found` came out, by its deviations; `None` where linear
/// theory does not describe the estimate or no direction is decided.
fn tolerance_test(found: &Identification, samples: &[Sample], stated: f64) -> Option<ToleranceTest> {
    let evidence = evidence(found, samples)?;
    evidence.test(noise(found), stated)
}

/// What the deviations found tell of the tolerances of `found.supported`.
pub fn evidence(found: &Identification, samples: &[Sample]) -> Option<Evidence> {
    if found.report.estimate == Estimate::Other {
        return None;
    }
    let seen = found.visibility.as_ref()?;
    let taking = found.taking_part(samples);
    let at = found.geometry.deviations_from(&found.supported.nominal());
    let problem = Calibration::new(&found.supported, &taking, Form::Minimal, &at);
    let x = problem.coordinates().nearest(&at);
    Evidence::at(&found.supported, &problem, &x, seen).ok()
}

/// The noise in units of the stated one, from the residual where this contradicts it.
fn noise(found: &Identification) -> f64 {
    let square = |rms: f64| rms * rms * found.rows as f64;
    let Some((value, freedom)) = found.chi_square() else {
        let rms = found.fit.1.map_or(1.0, |fit| square(fit.weighted_rms));
        let freedom = found.rows as f64 - found.counts().map_or(0.0, |counts| counts.practical as f64);
        return (rms / freedom.max(1.0)).sqrt().max(1.0);
    };
    let Ok(law) = ChiSquared::new(freedom) else { return 1.0 };
    match law.sf(value).min(law.cdf(value)) < CONTRADICTED {
        true => (value / freedom).sqrt(),
        false => 1.0,
    }
}
