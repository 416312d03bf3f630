//! One identification: which postures take part, the identifier's run, and what came of it.

use super::counts::{Counts, Visibility, visibility};
use super::registration::{FreeEnds, registered};
use super::score::{Fit, Outlier, outliers, score};
use super::uncertainty::{root, weight};
use crate::calibration::{Calibration, Sample, SetAside};
use crate::lie::Se3;
use crate::lie::se3::{self, Twist};
use crate::measure::Weights;
use crate::model::{Geometry, Mechanism, Posture, Prior};
use crate::problem::{Form, Problem};
use crate::solve::{Estimate, Identifier, Iterate, Report, Stop};
use nalgebra::Matrix6;

/// Ratio of the extreme singular values of the wrench matrix below which a posture is reported.
const NEAR_SINGULAR: f64 = 1e-2;

/// How often postures that were set aside are taken back.
const ROUNDS: usize = 8;

/// Why nothing could be identified.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum IdentifyError {
    /// No samples.
    #[error("there are no samples to identify from")]
    NoSamples,
    /// Everything is held.
    #[error("every link is held (all tolerances are 0): nothing is left to identify")]
    AllHeld,
    /// Base or tool are free and the samples do not place them.
    #[error(
        "base or tool stand free (tolerance \"free\") and the samples do not determine where they are: \
         at least three postures with different orientations are needed"
    )]
    Unregistered,
    /// No posture closes.
    #[error("no posture closes with the nominal machine; {}: {}", .0.name, .0.reason)]
    NoneCloses(SetAside),
}

/// A posture near a singularity.
#[derive(Clone, Debug, PartialEq)]
pub struct NearSingular {
    /// The sample.
    pub name: String,
    /// Singular values of its wrench matrix, descending (lengths in machine sizes).
    pub singular_values: [f64; 6],
}

/// What an identification found.
#[derive(Clone, Debug)]
pub struct Identification {
    /// The machine about which it was linearised: as drawn, with free ends registered.
    pub start: Mechanism,
    /// Links as identified.
    pub geometry: Geometry,
    /// Deviation of every link from the drawing, six per link, rad and m; then of the instrument's constants.
    pub deviations: Vec<f64>,
    /// Standard error of each, `None` where linear theory does not apply.
    pub std: Option<Vec<f64>>,
    /// The identifier's own report, of its last round.
    pub report: Report,
    /// Accepted iterations over all rounds.
    pub trace: Vec<Iterate>,
    /// Counts and singular values at the solution; `None` where it cannot be evaluated.
    pub visibility: Option<Visibility>,
    /// Counts at nominal.
    pub nominal: Option<Visibility>,
    /// Samples set aside at first.
    pub set_aside_at_start: Vec<SetAside>,
    /// Samples that took no part to the end.
    pub set_aside: Vec<SetAside>,
    /// Samples whose posture is near a singularity.
    pub near_singular: Vec<NearSingular>,
    /// Samples that the result predicts far worse than the others, worst first.
    pub outliers: Vec<Outlier>,
    /// Samples that were measured beyond a singularity, as seen from home.
    pub other_mode: Vec<String>,
    /// Prediction of the training samples by the drawing (free ends registered) and by the result.
    pub fit: (Option<Fit>, Option<Fit>),
    /// Number of residuals.
    pub rows: usize,
}

/// Identifies the machine's deviations from the samples.
pub fn identify(
    drawn: &Mechanism,
    samples: &[Sample],
    identifier: &dyn Identifier,
    stop: &Stop,
) -> Result<Identification, IdentifyError> {
    identify_from(drawn, samples, identifier, stop, &vec![0.0; drawn.component_count()])
}

/// The same, started from link deviations `from` (rad, m, six per link) of the drawing with its free ends registered.
pub fn identify_from(
    drawn: &Mechanism,
    samples: &[Sample],
    identifier: &dyn Identifier,
    stop: &Stop,
    from: &[f64],
) -> Result<Identification, IdentifyError> {
    if samples.is_empty() {
        return Err(IdentifyError::NoSamples);
    }
    let start = placed(drawn, samples).ok_or(IdentifyError::Unregistered)?;
    let weighted: Vec<Sample>;
    let samples_in_form = match identifier.form() {
        Form::Plain => {
            let plain = |s: &Sample| s.measurement.reweighted(Weights::SpatialTwist);
            weighted = samples.iter().map(|s| Sample { measurement: plain(s), ..s.clone() }).collect();
            &weighted
        }
        Form::Minimal | Form::Complete => samples,
    };
    let mut at = from.to_vec();
    let mut problem = Calibration::new(&start, samples_in_form, identifier.form(), &at);
    if problem.params().is_empty() {
        return Err(IdentifyError::AllHeld);
    }
    let set_aside_at_start = problem.set_aside().to_vec();
    if problem.sample_count() == 0 {
        return Err(set_aside_at_start
            .into_iter()
            .next()
            .map_or(IdentifyError::NoSamples, IdentifyError::NoneCloses));
    }
    // Near a singularity the nominal pose may be far from the measured one, or on another branch: such postures wait
    // until the others have been identified from.
    if !Posture::new(&start).is_open_chain(&start) {
        problem.take_back(samples_in_form, &at, NEAR_SINGULAR);
    }
    if problem.sample_count() == 0 {
        problem.take_back(samples_in_form, &at, 0.0);
    }
    let mut x = problem.coordinates().nearest(&at);
    let mut trace = Vec::new();
    let mut report;
    let mut round = 0;
    loop {
        report = identifier.identify(&problem, &x, stop);
        trace.extend_from_slice(&report.trace);
        round += 1;
        if !report.cost.is_finite() || !report.x.iter().all(|v| v.is_finite()) {
            break;
        }
        x.copy_from_slice(&report.x);
        at = problem.coordinates().deviations(&x);
        let before: Vec<usize> = problem.set_aside().iter().map(|s| s.sample).collect();
        problem.take_back(samples_in_form, &at, 0.0);
        let same = problem.set_aside().iter().map(|s| s.sample).eq(before);
        if same || round == ROUNDS || problem.sample_count() == 0 {
            break;
        }
    }
    let geometry = start.deviated(&at);
    let visibility_at = |at: &[f64]| visibility(&start, samples, at).ok();
    let at_solution = visibility_at(&at);
    let std = at_solution.as_ref().and_then(|v| standard_errors(drawn, &start, &at, v, report.estimate));
    let (near_singular, other_mode) = singularities(&start, &geometry, samples);
    Ok(Identification {
        fit: (score(&start, &start.nominal(), samples), score(&start, &geometry, samples)),
        nominal: visibility_at(&vec![0.0; at.len()]),
        deviations: geometry.deviations_from(&drawn.nominal()),
        rows: problem.rows(),
        near_singular,
        other_mode,
        outliers: outliers(&start, &geometry, samples),
        set_aside: problem.set_aside().to_vec(),
        visibility: at_solution,
        start,
        geometry,
        std,
        report,
        trace,
        set_aside_at_start,
    })
}

/// The drawing with its free ends, and what is unknown of the instrument, placed by the samples; `None` where these do
/// not place them.
pub fn placed(drawn: &Mechanism, samples: &[Sample]) -> Option<Mechanism> {
    let free = FreeEnds::of(drawn);
    let unknown = drawn.instrument.iter().any(|constant| constant.prior == Prior::Free);
    match free {
        FreeEnds { base: false, tool: false } if !unknown => Some(drawn.clone()),
        _ => registered(drawn, samples, free),
    }
}

/// Postures whose wrench matrix is close to losing rank, and those with another sign of its determinant than home.
fn singularities(
    mechanism: &Mechanism,
    geometry: &Geometry,
    samples: &[Sample],
) -> (Vec<NearSingular>, Vec<String>) {
    let mut posture = Posture::new(mechanism);
    if posture.is_open_chain(mechanism) {
        return Default::default();
    }
    let home = posture.close(mechanism, geometry).ok().map(|()| posture.mode);
    let (mut near, mut other_mode) = (Vec::new(), Vec::new());
    for sample in samples {
        if sample.close(mechanism, geometry, &mut posture).is_ok() {
            let singular_values = posture.wrench_singular_values();
            if singular_values[5] < NEAR_SINGULAR * singular_values[0] {
                near.push(NearSingular { name: sample.name.clone(), singular_values });
            }
            if home.is_some_and(|mode| mode != posture.mode) {
                other_mode.push(sample.name.clone());
            }
        }
    }
    (near, other_mode)
}

/// Standard errors of the link deviations, from the singular value decomposition at the solution `at`: covariance
/// `(J'J + W)^-1`, `W` the prior that the estimate used.
fn standard_errors(
    drawn: &Mechanism,
    start: &Mechanism,
    at: &[f64],
    seen: &Visibility,
    estimate: Estimate,
) -> Option<Vec<f64>> {
    let coordinates = crate::calibration::Coordinates::new(start, Form::Minimal);
    // A registered link deviates by D from the drawing and by d from where it was registered: dD follows from dd.
    let links = |mechanism: &Mechanism| -> Vec<Se3> { mechanism.nominal().limbs.concat() };
    let charts: Vec<Option<Matrix6<f64>>> = links(drawn)
        .iter()
        .zip(links(start))
        .zip(at.chunks_exact(6))
        .map(|((drawn, start), d)| {
            let d = Twist::from_column_slice(d);
            let whole = se3::log(&(drawn.inverse() * start * se3::exp(&d)));
            (*drawn != start).then(|| se3::left_jacobian_inverse(&-whole) * se3::right_jacobian(&d))
        })
        .collect();
    let mut variance = vec![0.0; start.component_count()];
    let root = root(seen, estimate)?;
    for k in 0..root.ncols() {
        let column: Vec<f64> = root.col(k).iter().copied().collect();
        let column = coordinates.deviations(&column);
        let links = start.link_component_count();
        variance.iter_mut().zip(&column).skip(links).for_each(|(sum, v)| *sum += v * v);
        for ((sum, d), chart) in
            variance[..links].chunks_exact_mut(6).zip(column.chunks_exact(6)).zip(&charts)
        {
            let d = Twist::from_column_slice(d);
            let shown = chart.map_or(d, |chart| chart * d);
            sum.iter_mut().zip(shown.iter()).for_each(|(sum, v)| *sum += v * v);
        }
    }
    Some(variance.into_iter().map(f64::sqrt).collect())
}

impl Identification {
    /// Counts at the solution, or at nominal where the solution cannot be evaluated.
    pub fn counts(&self) -> Option<Counts> {
        self.visibility.as_ref().or(self.nominal.as_ref()).map(|v| v.counts)
    }

    /// Chi-square of the residuals and its degrees of freedom, for estimates that linear theory describes.
    ///
    /// The effective number of parameters is the trace of the influence matrix, `sum s^2 / (s^2 + w)`.
    pub fn chi_square(&self) -> Option<(f64, f64)> {
        let fit = self.fit.1?;
        let seen = self.visibility.as_ref()?;
        let estimate = self.report.estimate;
        let mut used = 0.0;
        for s in seen.singular_values.iter().filter(|s| **s > 0.0) {
            used += s * s / (s * s + weight(estimate, *s)?);
        }
        Some((fit.weighted_rms.powi(2) * self.rows as f64, self.rows as f64 - used))
    }
}
