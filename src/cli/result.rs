//! The result file of one identification.

use super::summary::Summary;
use super::wording::reason;
use crate::calibration::SetAside;
use crate::files::elsewhere::ElsewhereEntry;
use crate::files::noise::{NoiseDrawing, PostureNoiseDrawing, PostureNoiseEntry};
use crate::files::place::Place;
use crate::files::result::RESULT_FORMAT;
use crate::files::summary::{
    ActiveBoundEntry, BeforeAfter, ConstantResult, Counts, CrossValidationEntry, Deviation, LinkResult,
    MountResult, PoseErrors, SetAsideEntry, SourceEntry, TraceEntry, UnusedEntry, WeightEntry,
};
use crate::files::{MechanismDrawing, ResultFile, UncertaintyDrawing, Units, from_quantity, redraw};
use crate::identify::{self, Fit, Variance};
use crate::model::{Prior, Tolerance};

/// Part of its tolerance below which a component without error is a rounded zero.
const ROUNDING: f64 = 1e-9;

impl From<identify::Counts> for Counts {
    fn from(counts: identify::Counts) -> Self {
        let identify::Counts { structural, first_order, practical } = counts;
        Self { structural, first_order, practical }
    }
}

fn errors(fit: Option<Fit>, units: Units) -> PoseErrors {
    let Some(fit) = fit else { return PoseErrors::default() };
    PoseErrors {
        position_rms: fit.position.map(|p| p.rms),
        position_max: fit.position.map(|p| p.max),
        rotation_rms: fit.rotation.map(|r| r.rms),
        rotation_max: fit.rotation.map(|r| r.max),
        distance_rms: fit.distance.map(|d| d.rms),
        distance_max: fit.distance.map(|d| d.max),
        plane_rms: fit.plane.map(|p| p.rms),
        plane_max: fit.plane.map(|p| p.max),
        joint_angle_rms: fit.joint_angle.map(|j| j.rms),
        joint_angle_max: fit.joint_angle.map(|j| j.max),
        joint_length_rms: fit.joint_length.map(|j| j.rms),
        joint_length_max: fit.joint_length.map(|j| j.max),
        weighted_rms: Some(fit.weighted_rms),
    }
    .in_units(units)
}

fn entries(set_aside: &[SetAside], units: Units) -> Vec<SetAsideEntry> {
    let entry = |s: &SetAside| SetAsideEntry { sample: s.name.clone(), reason: reason(&s.reason, units) };
    set_aside.iter().map(entry).collect()
}

/// Components of link `k` among those of all.
fn six(k: usize, of: &[f64]) -> Option<[f64; 6]> {
    of.get(6 * k..6 * k + 6).and_then(|s| <[f64; 6]>::try_from(s).ok())
}

fn before_after(pair: (Option<Fit>, Option<Fit>), units: Units) -> Option<BeforeAfter> {
    (pair.0.is_some() || pair.1.is_some())
        .then(|| BeforeAfter { before: errors(pair.0, units), after: errors(pair.1, units) })
}

impl Summary<'_> {
    /// The result file.
    pub fn file(&self) -> ResultFile {
        let (found, units) = (self.found, self.problem.units);
        let report = &found.report;
        let mechanism = redraw(&found.start, &found.geometry, units);
        ResultFile {
            format: RESULT_FORMAT.into(),
            problem: self.problem.name.clone(),
            source: Some(SourceEntry {
                problem_file: self.problem.file.clone(),
                holdout: self.chosen.map(|chosen| chosen.0),
                seed: self.chosen.map(|chosen| chosen.1),
            }),
            solver: report.identifier.into(),
            settings: self.identifier.settings().into_iter().map(|(k, v)| (k.to_owned(), v)).collect(),
            converged: report.outcome.converged(),
            reason: report.outcome.to_string(),
            iterations: found.trace.len(),
            units,
            postures: Some(self.taking_part().0),
            samples: Some(self.taking_part().1),
            counts: found.counts().map(Counts::from).unwrap_or_default(),
            fit: before_after(self.reached(found.fit), units),
            holdout: before_after(self.reached(self.holdout), units),
            chi_square: self.chi_square(),
            tolerance_factor: found.tolerance_test.as_ref().map(super::tolerances::entry),
            cross_validation: self.cross_validation.map(|cross| CrossValidationEntry {
                folds: cross.folds,
                refitted: cross.refitted,
                errors: errors(Some(cross.fit), units),
            }),
            noise_estimate: self.noise.map(|noise| NoiseDrawing {
                angle: noise.angle.map(|v| units.from_radians(v)),
                length: noise.length.map(|v| units.from_metres(v)),
                covariance: None,
            }),
            posture_noise_estimate: self.common.map(|common| {
                let PostureNoiseDrawing { angle, length } = PostureNoiseDrawing::of(common.noise, units);
                PostureNoiseEntry { angle, length, probability: common.probability }
            }),
            warnings: self.warnings(),
            measured_elsewhere: (!self.elsewhere.is_empty())
                .then_some(ElsewhereEntry { samples: self.elsewhere.len(), of: found.taking.len() }),
            set_aside: entries(&found.set_aside, units),
            holdout_set_aside: entries(&self.holdout_set_aside, units),
            unused: self
                .unused
                .iter()
                .map(|(sample, fit)| UnusedEntry {
                    sample: sample.clone(),
                    errors: fit.map(|fit| errors(Some(fit), units)),
                })
                .collect(),
            active_bounds: report
                .active
                .iter()
                .map(|a| ActiveBoundEntry { name: a.name.clone(), limit: a.limit, multiplier: a.multiplier })
                .collect(),
            kkt: report.kkt,
            estimate: Some(report.estimate.into()),
            weights: report
                .weights
                .iter()
                .map(|w| WeightEntry { weight: w.weight, score: w.score })
                .collect(),
            singular_values: found
                .visibility
                .as_ref()
                .map(|v| v.structural_values().to_vec())
                .unwrap_or_default(),
            trace: found
                .trace
                .iter()
                .map(|t| TraceEntry { cost: t.cost, step: t.step, kept: t.kept })
                .collect(),
            instrument: self.instrument(),
            placement: self
                .mounts
                .placement
                .as_ref()
                .map(|m| MountResult::of(&m.pose, m.std.as_ref(), units)),
            tool_mounting: (self.mounts.tool_mounting.as_ref())
                .map(|m| MountResult::of(&m.pose, m.std.as_ref(), units)),
            links: self.links(),
            uncertainty: self.uncertainty(&mechanism),
            mechanism,
            versions: [("gough".to_owned(), env!("CARGO_PKG_VERSION").to_owned())].into(),
        }
    }

    fn links(&self) -> Vec<LinkResult> {
        let mut links = Vec::new();
        let std = self.found.standard_errors();
        let ratio = self.judgement.birge_ratio();
        let scaled: Option<Vec<f64>> = ratio
            .zip(self.found.variances.as_ref())
            .map(|(ratio, all)| all.iter().map(|v| v.scaled_error(ratio)).collect());
        let shares: Option<Vec<f64>> =
            self.found.variances.as_ref().map(|all| all.iter().map(Variance::prior_share).collect());
        let names =
            self.found.start.limbs.iter().flat_map(|limb| limb.links.iter().map(|l| (&limb.name, &l.name)));
        let zeros = self.rounding_zeros(std.as_deref());
        for (k, (limb, link)) in names.enumerate() {
            let six = |of: &[f64]| six(k, of);
            let rounded = |mut of: [f64; 6]| {
                of.iter_mut()
                    .zip(zeros.iter().skip(6 * k))
                    .filter(|(_, zero)| **zero)
                    .for_each(|(v, _)| *v = 0.0);
                of
            };
            let Some(deviation) = six(&self.found.deviations).map(rounded) else { continue };
            let std = std.as_deref().and_then(six).map(rounded);
            let beside = self.mounts.links().find(|beside| beside.link == k);
            links.push(LinkResult {
                limb: limb.clone(),
                link: link.clone(),
                deviation: Deviation::of(&deviation, self.problem.units),
                beside: beside.map(|b| Deviation::of(&b.deviation, self.problem.units)),
                beside_std: beside.and_then(|b| b.std).map(|std| Deviation::of(&std, self.problem.units)),
                std: std.map(|std| Deviation::of(&std, self.problem.units)),
                scaled_std: scaled
                    .as_deref()
                    .and_then(six)
                    .map(|std| Deviation::of(&rounded(std), self.problem.units)),
                prior_share: shares
                    .as_deref()
                    .and_then(six)
                    .map(|[a, b, c, x, y, z]| Deviation { rotation: [a, b, c], translation: [x, y, z] }),
            });
        }
        links
    }

    /// Which components are zero by convention (redundant, so that neither data nor tolerances move them), and differ
    /// from it by rounding alone: deviation and standard error `std` are both far below the tolerance.
    fn rounding_zeros(&self, std: Option<&[f64]>) -> Vec<bool> {
        let links = self.found.start.limbs.iter().flat_map(|limb| &limb.links);
        let priors = links.flat_map(|link| {
            let Tolerance { angle, length } = link.tolerance;
            [angle, angle, angle, length, length, length]
        });
        let (Some(std), deviations) = (std, &self.found.deviations) else { return Vec::new() };
        let zero = |((prior, d), std): ((Prior, &f64), &f64)| match prior {
            Prior::Sigma(sigma) => d.abs() < ROUNDING * sigma && *std < ROUNDING * sigma,
            Prior::Held | Prior::Free => false,
        };
        priors.zip(deviations).zip(std).map(zero).collect()
    }

    /// The instrument's constants as identified.
    pub(super) fn instrument(&self) -> Vec<ConstantResult> {
        let (found, units) = (self.found, self.problem.units);
        let drawn = self.problem.mechanism.instrument.iter().enumerate();
        let first = found.start.link_component_count();
        let errors = found.standard_errors();
        let constants = drawn.zip(&found.geometry.instrument).map(|((k, constant), value)| {
            let shown = |v: f64| from_quantity(units, constant.quantity, v);
            ConstantResult {
                name: constant.name(),
                nominal: shown(constant.nominal),
                value: shown(*value),
                std: errors.as_ref().and_then(|std| std.get(first + k)).map(|v| shown(*v)),
            }
        });
        constants.collect()
    }

    /// Square root of the links' covariance for the machine as it is drawn in the result: of all directions, since one
    /// that these readings do not see may move the pose all the same.
    fn uncertainty(&self, drawing: &MechanismDrawing) -> Option<UncertaintyDrawing> {
        let (found, units) = (self.found, self.problem.units);
        let links = found.link_root()?;
        let redrawn = drawing.read(units, &Place::file("result")).ok()?.mechanism;
        let root: Vec<Vec<f64>> =
            links.root.col_iter().map(|column| column.iter().copied().collect()).collect();
        let finite = root.iter().flatten().all(|v| v.is_finite());
        finite.then(|| UncertaintyDrawing::of(&found.geometry, &redrawn, &root, &links.prior_share, units))
    }
}
