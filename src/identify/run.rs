//! One identification: which postures take part, the identifier's run, and what came of it.

use super::counts::{Counts, Visibility};
use super::covariance::{Covariance, Variance};
use super::evidence::ToleranceTest;
use super::outliers::Outlier;
use super::registration::{FreeEnds, Registration, register};
use super::rounds::Run;
use super::score::Fit;
use super::sides::{Sides, has_points, sides};
use super::singularities::NEAR_SINGULAR;
use super::uncertainty::LinkRoot;
use super::untold::Untold;
use crate::calibration::{Calibration, Coordinates, Sample, SetAside};
use crate::lie::Se3;
use crate::measure::Weights;
use crate::model::mobility::{self, MobilityError};
use crate::model::{Geometry, Mechanism, Prior};
use crate::problem::{Form, Problem};
use crate::solve::{Identifier, Iterate, Report, Stop};
use std::collections::HashMap;

pub use super::singularities::NearSingular;

/// Why nothing could be identified.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum IdentifyError {
    /// No samples.
    #[error("there are no samples to identify from")]
    NoSamples,
    /// A machine built in code that this model does not describe.
    #[error("{0}")]
    NoMachine(#[from] MobilityError),
    /// A sample built in code.
    #[error("{name}: {found} readings, where the machine has {wanted} actuators")]
    Readings {
        /// The sample.
        name: String,
        /// Readings that it has.
        found: usize,
        /// Actuators.
        wanted: usize,
    },
    /// Everything is held.
    #[error("every link is held (all tolerances are 0): nothing is left to identify")]
    AllHeld,
    /// Base or tool are free and the samples do not place them.
    #[error(
        "base or tool stand free (tolerance \"free\") and the samples do not determine where they are: \
         at least three postures, or three points that lie on no line, are needed"
    )]
    Unregistered,
    /// No posture closes.
    #[error("no posture closes with the nominal machine; {}: {}", .0.name, .0.reason)]
    NoneCloses(SetAside),
}

/// What an identification found.
#[derive(Clone, Debug)]
pub struct Identification {
    /// The machine about which it was linearised: as drawn, with free ends registered.
    pub start: Mechanism,
    /// Motions that registration put in front of the drawing and behind it.
    pub placed: (Se3, Se3),
    /// What registration kept as drawn of free ends.
    pub untold: Vec<Untold>,
    /// The same under the tolerances that the data support: estimate and covariance are in these.
    pub supported: Mechanism,
    /// Test of the stated tolerances by the deviations; `None` where it was not made, nothing is decided, or linear theory
    /// does not apply.
    pub tolerance_test: Option<ToleranceTest>,
    /// Links as identified.
    pub geometry: Geometry,
    /// Deviation of every link from the drawing, six per link, rad and m; then of the instrument's constants.
    pub deviations: Vec<f64>,
    /// Variance of each, `None` where linear theory does not apply.
    pub variances: Option<Vec<Variance>>,
    /// Covariance of the minimal coordinates about `supported`, `None` where linear theory does not apply.
    pub covariance: Option<Covariance>,
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
    /// Prediction of the training samples by the drawing (free ends registered) and by the result.
    pub fit: (Option<Fit>, Option<Fit>),
    /// Number of residuals.
    pub rows: usize,
    /// Samples that took part, each to be closed from where it was closed.
    pub taking: Vec<Sample>,
    /// On which side of their readings' plane fixed points stand.
    pub sides: Sides,
}

/// Identifies the machine's deviations under the stated tolerances, started from link deviations `from` (rad, m, six per
/// link) of the drawing with its free ends registered.
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
    mobility::check_structure(drawn, &drawn.nominal())?;
    let wanted = drawn.actuator_count();
    if let Some(sample) = samples.iter().find(|sample| sample.actuators.len() != wanted) {
        let (name, found) = (sample.name.clone(), sample.actuators.len());
        return Err(IdentifyError::Readings { name, found, wanted });
    }
    let Registration { machine: start, base, tool, untold } =
        placed(drawn, samples).ok_or(IdentifyError::Unregistered)?;
    let known = has_points(&start);
    let mut found = identify_placed(drawn, (start, untold), samples, identifier, stop, from)?;
    if known {
        let (other, known) = sides(&found, samples, stop);
        if let Some((start, from)) = other {
            let placed = (start, found.untold.clone());
            found = identify_placed(drawn, placed, samples, identifier, stop, &from)?;
        }
        found.sides = known;
    }
    found.placed = (base, tool);
    Ok(found)
}

/// The same from a machine whose free ends and constants are placed, and what the samples do not tell of them.
fn identify_placed(
    drawn: &Mechanism,
    (start, untold): (Mechanism, Vec<Untold>),
    samples: &[Sample],
    identifier: &dyn Identifier,
    stop: &Stop,
    from: &[f64],
) -> Result<Identification, IdentifyError> {
    let weighted: Vec<Sample>;
    let samples_in_form = match identifier.form() {
        Form::Plain => {
            let plain = |s: &Sample| s.measurement.reweighted(Weights::SpatialTwist);
            weighted = samples.iter().map(|s| Sample { measurement: plain(s), ..s.clone() }).collect();
            &weighted
        }
        Form::Minimal | Form::Complete => samples,
    };
    let at = from.to_vec();
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
    if !start.is_open_chain() {
        problem.take_back(samples_in_form, &at, NEAR_SINGULAR);
    }
    if problem.sample_count() == 0 {
        problem.take_back(samples_in_form, &at, 0.0);
    }
    let mut run = Run {
        start: &start,
        problem,
        measured: samples,
        samples: samples_in_form,
        identifier,
        stop,
        trace: Vec::new(),
        at,
    };
    let report = run.rounds();
    let mut found = run.found(drawn, report, &set_aside_at_start);
    if run.reconsider(&found) {
        let report = run.rounds();
        found = run.found(drawn, report, &set_aside_at_start);
    }
    found.untold = untold;
    Ok(found)
}

/// The drawing with its free ends, and what is unknown of the instrument, placed by the samples; `None` where these do
/// not place them.
pub fn placed(drawn: &Mechanism, samples: &[Sample]) -> Option<Registration> {
    let free = FreeEnds::of(drawn);
    let unknown = drawn.instrument.iter().any(|constant| constant.prior == Prior::Free);
    match free {
        FreeEnds { base: false, tool: false } if !unknown => Some(Registration::as_drawn(drawn)),
        _ => register(drawn, samples, free),
    }
}

impl Identification {
    /// Counts at the solution, or at nominal where the solution cannot be evaluated.
    pub fn counts(&self) -> Option<Counts> {
        self.visibility.as_ref().or(self.nominal.as_ref()).map(|v| v.counts)
    }

    /// Chi-square of the residuals and its degrees of freedom, its expectation under the stated noise (10.5), for
    /// estimates that linear theory describes.
    pub fn chi_square(&self) -> Option<(f64, f64)> {
        let (fit, covariance) = (self.fit.1?, self.covariance.as_ref()?);
        Some((fit.weighted_rms.powi(2) * self.rows as f64, self.rows as f64 - covariance.absorbed))
    }

    /// Standard error of each deviation, rad and m; `None` where linear theory does not apply.
    pub fn standard_errors(&self) -> Option<Vec<f64>> {
        Some(self.variances.as_ref()?.iter().map(|v| v.total.sqrt()).collect())
    }

    /// The machine as identified, with the priors of the drawing.
    pub fn calibrated(&self) -> Mechanism {
        let mut machine = self.start.clone();
        for (i, (limb, links)) in machine.limbs.iter_mut().zip(&self.geometry.limbs).enumerate() {
            for (link, g) in limb.links.iter_mut().zip(links) {
                link.nominal = *g;
            }
            for (joint, frame) in limb.joints.iter_mut().zip(self.geometry.home_frames(i)) {
                joint.frame = frame;
            }
        }
        for (constant, value) in machine.instrument.iter_mut().zip(&self.geometry.instrument) {
            constant.nominal = *value;
        }
        machine
    }

    /// Square root of the covariance of the links of [`calibrated`](Self::calibrated), `None` where linear theory does
    /// not apply.
    pub fn link_root(&self) -> Option<LinkRoot> {
        let covariance = self.covariance.as_ref()?;
        let at = self.geometry.deviations_from(&self.supported.nominal());
        let coordinates = Coordinates::new(&self.supported, Form::Minimal);
        let root = covariance.of_links(&coordinates, &at);
        let root = root.get(..self.start.link_component_count(), ..).to_owned();
        Some(LinkRoot { root, prior_share: covariance.prior_share.clone() })
    }

    /// Those of the samples that were not set aside, by name, each to be closed from where it was closed.
    pub(super) fn taking_part(&self, samples: &[Sample]) -> Vec<Sample> {
        let taking: HashMap<&str, &Sample> = self.taking.iter().map(|s| (s.name.as_str(), s)).collect();
        let known = |sample: &Sample| {
            let closed = taking.get(sample.name.as_str())?.measurement.closed_at();
            Some(closed.map_or_else(|| sample.clone(), |at| sample.closed_at(at.clone())))
        };
        samples.iter().filter_map(known).collect()
    }
}
