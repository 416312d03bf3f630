//! `gough-run/1`: one run of one identifier on one problem, as a line of JSON that explains itself.

use super::tolerance::Tolerance;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Format of a line.
pub const RUN_FORMAT: &str = "gough-run/1";

/// Where the data of a run come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Source {
    /// Drawn for this run from the problem's mechanism, tolerances and noise.
    Simulated,
    /// The problem's own.
    Own,
}

/// A problem, known by what it says and not by where it lies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProblemKey {
    /// Its name.
    pub name: String,
    /// SHA-256 of its content, the first 16 hexadecimal digits.
    pub hash: String,
}

/// An identifier with all its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SolverKey {
    /// Registered name.
    pub name: String,
    /// Every setting in force, as text.
    pub settings: BTreeMap<String, String>,
}

/// All that decides a run: two runs with the same key give the same line, but for `cost`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunKey {
    /// The problem.
    pub problem: ProblemKey,
    /// Where the data come from.
    pub data: Source,
    /// Factor on the problem's noise, of which the instrument knows.
    pub noise: f64,
    /// Start, in tolerances from nominal.
    pub start: f64,
    /// Of truth, postures, noise and start.
    pub seed: u64,
    /// The identifier.
    pub solver: SolverKey,
    /// When to stop, and what passes.
    pub tolerance: Tolerance,
    /// Most evaluations, where there is a limit.
    pub limit: Option<usize>,
    /// Version of this program.
    pub version: String,
    /// Versions of the crates that do the numerical work, by name; empty in lines from before they were noted.
    #[serde(default)]
    pub dependencies: BTreeMap<String, String>,
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Ended {
    /// The identifier says that it converged.
    Converged,
    /// At the limit of iterations or evaluations.
    Limit,
    /// The identifier gave up.
    Failed,
    /// The problem could not be posed: no posture closes at the start, or nothing is left to identify.
    Refused,
}

/// What the identifier says of itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Claimed {
    /// How it ended.
    pub ended: Ended,
    /// In words.
    pub reason: String,
}

/// What the problem says of the result. `None`: it has no say.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Verified {
    /// Whether every check that could be made passed.
    pub success: bool,
    /// Distance from a stationary point within the tolerance, or what may still be gained for a loss without a derivative;
    /// `None` where neither can be evaluated, and then there is no success.
    pub stationary: Option<bool>,
    /// Cost no higher than that of the truth with its prior, or of the nominal machine without a truth; of constrained,
    /// sparse and robust estimates what they minimise, no higher than at the truth, cut at the limits where these
    /// exclude it.
    pub cost: Option<bool>,
    /// Predicted poses within the tolerance of the bound; better than before without a truth, and for the largest
    /// residual, which is not efficient. Where limits exclude the truth the bound does not hold and has no say.
    pub prediction: Option<bool>,
    /// Whether the stated noise explains the residual; asked where no truth is known, the result lies on no limit, and its
    /// loss has a derivative.
    #[serde(default)]
    pub explained: Option<bool>,
    /// What failed, in words; empty where nothing did.
    pub reason: String,
}

/// Errors of predicted poses; `None` where that part was not measured or nothing closes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Prediction {
    /// Root mean square displacement of the tool point, m.
    pub position: Option<f64>,
    /// Largest, m.
    pub position_max: Option<f64>,
    /// Root mean square angle, rad.
    pub rotation: Option<f64>,
    /// Largest, rad.
    pub rotation_max: Option<f64>,
    /// Root mean square in standard deviations of a measurement.
    pub in_noise: Option<f64>,
    /// Poses that close.
    pub poses: usize,
}

/// Errors of the parameters that the data tell better than the tolerances, in tolerances.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    /// How many there are, at the truth.
    pub count: usize,
    /// Root mean square error.
    pub rms: f64,
    /// The bound on it.
    pub bound: f64,
}

/// Normalised error squared of the stated covariance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Consistency {
    /// Error' inverse(covariance) error: chi-square distributed where the covariance is true.
    pub nees: f64,
    /// Degrees of freedom.
    pub freedom: usize,
    /// Probability of a smaller value: the truth lies within the stated 95 % region where it is at most 0.95.
    pub probability: f64,
}

/// Chi-square of a residual against the stated noise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Residual {
    /// `|r|^2` of the postures that take part; the largest number where one of them does not close.
    pub chi_square: f64,
    /// Its expectation (10.5); the number of rows where linear theory does not apply.
    pub freedom: f64,
    /// Probability of a larger value.
    pub probability: f64,
}

/// Scores by the problem.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Score {
    /// Whether the true machine is known; without it the score is that of the hold-out alone.
    pub truth: bool,
    /// Postures to identify from.
    pub samples: usize,
    /// Of these, those that took no part at the end.
    pub set_aside: usize,
    /// Cost of the result over all postures, `|r|^2 / 2` in the stated noise; `None` where some do not close.
    pub cost: Option<f64>,
    /// The same of the nominal machine.
    pub cost_nominal: Option<f64>,
    /// The same of the truth.
    pub cost_truth: Option<f64>,
    /// Squared deviation of the truth in tolerances, halved.
    pub prior_truth: Option<f64>,
    /// Distance of the result from a stationary point of what is minimised (the KKT residual), in units of its
    /// uncertainty: docs/theory.md (13.1), (13.5).
    pub offset: Option<f64>,
    /// What a constrained, sparse or robust estimate minimises, at the result.
    pub objective: Option<f64>,
    /// The same at the truth, at nominal without one; `None` where limits exclude that.
    pub objective_reference: Option<f64>,
    /// Where limits exclude the truth (the nominal machine), the same where it is cut at them.
    #[serde(default)]
    pub objective_within: Option<f64>,
    /// Part by which what is minimised may still fall within a tolerance (docs/theory.md (13.7)); of losses without a
    /// derivative.
    #[serde(default)]
    pub gain: Option<f64>,
    /// Whether the result lies on a limit.
    #[serde(default)]
    pub limited: bool,
    /// Whether the result stands in another assembly mode at home than the drawing.
    #[serde(default)]
    pub other_mode: bool,
    /// Hold-out poses predicted by the nominal machine.
    pub before: Prediction,
    /// Hold-out poses predicted by the result.
    pub after: Prediction,
    /// Cramer-Rao bound on `after`, tolerances as prior.
    pub bound: Option<Prediction>,
    /// `after` by `bound`, in standard deviations.
    pub ratio: Option<f64>,
    /// Residual against the stated noise, where no truth is known.
    #[serde(default)]
    pub residual: Option<Residual>,
    /// Errors of identifiable parameters.
    pub parameters: Option<Parameters>,
    /// Whether the stated covariance is true.
    pub consistency: Option<Consistency>,
}

/// What the identifier did.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Effort {
    /// Accepted iterations.
    pub iterations: usize,
    /// Evaluations of the residual alone.
    pub residuals: f64,
    /// Evaluations of residual and Jacobian in one pass.
    pub jacobians: f64,
    /// Evaluations and cost (in the stated noise) wherever it fell by a thousandth, the result last.
    pub falls: Vec<(f64, f64)>,
}

/// What the run took. All that two equal runs may differ by stands here.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cost {
    /// Wall time of the identifier, s.
    pub wall: f64,
    /// Its processor time, s, where the system tells that of a thread.
    pub cpu: Option<f64>,
    /// Largest resident memory that the process had until the run ended, bytes, where the system tells.
    pub memory: Option<u64>,
    /// Runs at a time.
    pub threads: usize,
    /// The machine: system, architecture, processor.
    pub machine: String,
}

/// A line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunLine {
    /// [`RUN_FORMAT`].
    pub format: String,
    /// What was run.
    pub run: RunKey,
    /// The identifier's word.
    pub claimed: Claimed,
    /// The problem's.
    pub verified: Verified,
    /// How good the result is.
    pub score: Score,
    /// What it took in evaluations.
    pub effort: Effort,
    /// What it took of the machine.
    pub cost: Cost,
}

impl RunKey {
    /// The key as text, by which runs are told apart and put in order.
    pub fn text(&self) -> String {
        serde_json::to_string(self).unwrap_or_default()
    }

    /// The numerical crates for people, such as `argmin 0.11.0, clarabel 0.11.1`.
    pub fn dependencies_text(&self) -> String {
        match self.dependencies.is_empty() {
            true => "not noted".into(),
            false => {
                let each = self.dependencies.iter().map(|(name, version)| format!("{name} {version}"));
                each.collect::<Vec<_>>().join(", ")
            }
        }
    }
}

impl SolverKey {
    /// Name with the settings that are not the registered ones, such as `minimal threshold=3`.
    pub fn label(&self) -> String {
        let usual = crate::solve::registry::find(&self.name).map(|identifier| identifier.settings());
        let usual: BTreeMap<&str, String> = usual.unwrap_or_default().into_iter().collect();
        let other = self.settings.iter().filter(|(key, value)| usual.get(key.as_str()) != Some(value));
        other.fold(self.name.clone(), |label, (key, value)| format!("{label} {key}={value}"))
    }
}

impl RunLine {
    /// Processor time of the identifier, s; its wall time where the system does not tell that of a thread.
    pub fn time(&self) -> f64 {
        self.cost.cpu.unwrap_or(self.cost.wall)
    }

    /// Evaluations in all.
    pub fn evaluations(&self) -> f64 {
        self.effort.residuals + self.effort.jacobians
    }

    /// The line without what may differ between two equal runs.
    pub fn reproducible(&self) -> String {
        let cost = Cost { wall: 0.0, cpu: None, memory: None, threads: 0, machine: String::new() };
        serde_json::to_string(&Self { cost, ..self.clone() }).unwrap_or_default()
    }
}
