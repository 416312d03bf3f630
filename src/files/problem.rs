//! Problem files, and the model that a problem or a result holds.

use super::benchmark::BenchmarkDrawing;
use super::columns::ColumnsDrawing;
use super::data::{Context, DataDrawing};
use super::dataset::{DataSet, Kind};
use super::drawing::MechanismDrawing;
use super::elsewhere::ElsewhereEntry;
use super::error::{FileError, Location, quoted};
use super::fault::Fault;
use super::instrument::{Instrument, true_constants};
use super::json;
use super::machine::Drawn;
use super::name;
use super::place::Place;
use super::result::{RESULT_FORMAT, ResultFile};
use super::uncertainty::LinkUncertainty;
use super::units::Units;
use crate::model::{Constant, Mechanism, mobility};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Format of problem files.
pub const PROBLEM_FORMAT: &str = "gough-problem/1";

/// A problem file as written, in its units.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProblemDrawing {
    /// [`PROBLEM_FORMAT`].
    pub format: String,
    /// Of the problem; the file's where it is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// For people.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub description: Option<String>,
    /// Why it is in a benchmark set.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub benchmark: Option<BenchmarkDrawing>,
    /// Of every number.
    pub units: Units,
    /// Nominal machine.
    pub mechanism: MechanismDrawing,
    /// Measured postures.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub data: Option<DataDrawing>,
    /// The true machine of a benchmark problem.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub truth: Option<MechanismDrawing>,
    /// The true values of the instrument's unknown constants, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub truth_instrument: BTreeMap<String, f64>,
}

/// A problem file, read.
#[derive(Clone, Debug)]
pub struct ProblemFile {
    /// The file, as it was named.
    pub file: String,
    /// Name of the problem.
    pub name: String,
    /// The file as written, to write it again.
    pub drawing: ProblemDrawing,
    /// Units of the file.
    pub units: Units,
    /// Nominal machine, rad and m.
    pub mechanism: Mechanism,
    /// Measured postures.
    pub data: DataSet,
    /// Postures that are never used to identify.
    pub holdout: DataSet,
    /// The true machine of a benchmark problem.
    pub truth: Option<Mechanism>,
    without_tolerance: Option<Location>,
}

/// A machine to predict with: from a problem, or the calibrated one of a result.
#[derive(Clone, Debug)]
pub struct Model {
    /// The file, as it was named.
    pub file: String,
    /// Name of the problem.
    pub name: String,
    /// Units of the file.
    pub units: Units,
    /// The machine, rad and m.
    pub mechanism: Mechanism,
    /// What the problem's data file calls its columns.
    pub columns: Option<ColumnsDrawing>,
    /// How well the machine of a result is known, where the result says it.
    pub uncertainty: Option<LinkUncertainty>,
    /// Values of the instrument's constants by name, units of the file, as a result states them; `None` for a problem.
    pub constants: Option<BTreeMap<String, f64>>,
    /// Whether the identification that a result comes from converged; `true` for a problem.
    pub converged: bool,
    /// What a result says of samples that predictions miss.
    pub elsewhere: Option<ElsewhereEntry>,
}

/// Folders where a data file may be, other than that of the problem file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DataPlaces {
    /// Named on the command line.
    pub data_dir: Option<PathBuf>,
    /// Its folder `data` is looked in last.
    pub shared: PathBuf,
}

impl DataPlaces {
    /// `data_dir`, then the variable `GOUGH_SHARED`, `../shared` where it is not set.
    pub fn from_environment(data_dir: Option<PathBuf>) -> Self {
        let shared = std::env::var_os("GOUGH_SHARED").map_or_else(|| "../shared".into(), PathBuf::from);
        Self { data_dir, shared }
    }

    /// The first place where `file` is.
    pub(super) fn find(&self, folder: &Path, file: &str, at: &Place<'_>) -> Result<PathBuf, FileError> {
        let mut candidates = vec![folder.join(file)];
        candidates.extend(self.data_dir.as_ref().map(|dir| dir.join(file)));
        candidates.push(self.shared.join("data").join(file));
        candidates.dedup();
        if let Some(found) = candidates.iter().find(|path| path.is_file()) {
            return Ok(found.clone());
        }
        let looked: Vec<String> = candidates.iter().map(|path| path.display().to_string()).collect();
        Err(at.error(Fault::NoDataFile(looked.join(", "))))
    }
}

/// Reads a problem file with its data.
pub fn read_problem(path: &Path, places: &DataPlaces) -> Result<ProblemFile, FileError> {
    parse_problem(path, &json::read(path)?, places)
}

/// The problem that `bytes` hold; `path` names the file and the folder of its data.
pub fn parse_problem(path: &Path, bytes: &[u8], places: &DataPlaces) -> Result<ProblemFile, FileError> {
    let file = path.display().to_string();
    let head = Head::read(&file, bytes)?;
    if head.format() != Some(PROBLEM_FORMAT) {
        return Err(head.wrong(&file, "\"format\": \"gough-problem/1\""));
    }
    let drawing: ProblemDrawing = json::parse(&file, bytes)?;
    let units = drawing.units;
    let at = Place::file(&file);
    if let Some(name) = &drawing.name {
        name::check(name, &at.key("name"))?;
    }
    let Drawn { mut mechanism, without_tolerance } = drawing.mechanism.read(units, &at.key("mechanism"))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let at_data = at.key("data");
    let instrument = match &drawing.data {
        Some(data) => data.instrument(units, &at_data)?,
        None => Instrument::default(),
    };
    let context = Context { mechanism: &mechanism, units, instrument: &instrument, folder, places };
    let (data, holdout) = match &drawing.data {
        Some(data) => data.read(&context, &at_data)?,
        None => Default::default(),
    };
    if let Some(benchmark) = &drawing.benchmark {
        benchmark.check(&at.key("benchmark"))?;
    }
    for (limb, name) in data.sensed.iter().chain(&holdout.sensed) {
        let limb = &mut mechanism.limbs[*limb];
        let joint = limb.joints.iter_mut().find(|joint| *name == format!("{}.{}", limb.name, joint.name));
        if let Some(joint) = joint {
            joint.sensed = true;
        }
    }
    let true_values = &drawing.truth_instrument;
    let constants = true_constants(&instrument.constants, true_values, units, &at.key("truth_instrument"))?;
    mechanism.instrument = instrument.constants;
    let at_truth = at.key("truth");
    let truth = drawing.truth.as_ref().map(|truth| truth.read(units, &at_truth)).transpose()?;
    let truth = truth.map(|truth| Mechanism { instrument: constants, ..truth.mechanism });
    if let Some(truth) = &truth {
        let (found, wanted) = (truth.actuator_count(), mechanism.actuator_count());
        if found != wanted {
            let (found, wanted) = (truth.actuator_names().join(", "), mechanism.actuator_names().join(", "));
            return Err(at_truth.error(Fault::OtherActuators { found, wanted }));
        }
        mobility::check_structure(truth, &truth.nominal())
            .map_err(|why| at_truth.error(Fault::NoMachine(Box::new(why))))?;
    }
    let name = drawing.name.clone().unwrap_or_else(|| stem(path));
    Ok(ProblemFile { file, name, drawing, units, mechanism, data, holdout, truth, without_tolerance })
}

/// Reads the machine of a problem file, or the calibrated machine of a result file, and refuses what is none. Data are
/// not looked for.
pub fn read_model(path: &Path) -> Result<Model, FileError> {
    parse_model(path, &json::read(path)?)
}

/// The machine that `bytes` hold; `path` names the file.
pub fn parse_model(path: &Path, bytes: &[u8]) -> Result<Model, FileError> {
    let file = path.display().to_string();
    let at = Place::file(&file);
    let head = Head::read(&file, bytes)?;
    let (mut converged, mut constants, mut elsewhere) = (true, None, None);
    let (name, units, mechanism, columns, uncertainty) = match head.format() {
        Some(PROBLEM_FORMAT) => {
            let problem: ProblemDrawing = json::parse(&file, bytes)?;
            let columns = problem.data.and_then(|data| data.columns);
            (problem.name.unwrap_or_else(|| stem(path)), problem.units, problem.mechanism, columns, None)
        }
        Some(RESULT_FORMAT) => {
            let result: ResultFile = json::parse(&file, bytes)?;
            converged = result.converged;
            elsewhere = result.measured_elsewhere;
            let values = result.instrument.into_iter().map(|constant| (constant.name, constant.value));
            constants = Some(values.collect());
            (result.problem, result.units, result.mechanism, None, result.uncertainty)
        }
        _ => return Err(head.wrong(&file, "gough-problem/1 or gough-result/1")),
    };
    name::check_characters(&name, &at.key("name"))?;
    let at_mechanism = at.key("mechanism");
    let mechanism = mechanism.read(units, &at_mechanism)?.mechanism;
    // Where an identification failed, its machine need not close: only its structure is that of a machine.
    let geometry = mechanism.nominal();
    let checked = match converged {
        true => mobility::check(&mechanism, &geometry).map(|_| ()),
        false => mobility::check_structure(&mechanism, &geometry),
    };
    checked.map_err(|why| at_mechanism.error(Fault::NoMachine(Box::new(why))))?;
    let links = mechanism.component_count() / 6;
    let at_uncertainty = at.key("uncertainty");
    let uncertainty = uncertainty.map(|u| u.read(links, units, &at_uncertainty)).transpose()?;
    Ok(Model {
        name,
        units,
        mechanism,
        columns,
        uncertainty,
        constants,
        converged,
        elsewhere,
        file: file.clone(),
    })
}

impl Model {
    /// These constants of an instrument with the values that a result found; those that it does not know stay.
    pub fn constants_of(&self, drawn: &[Constant]) -> Result<Vec<Constant>, FileError> {
        let mut known = self.constants.clone().unwrap_or_default();
        known.retain(|name, _| drawn.iter().any(|constant| constant.name() == *name));
        true_constants(drawn, &known, self.units, &Place::file(&self.file).key("instrument"))
    }
}

#[derive(Deserialize)]
struct Head {
    #[serde(default)]
    format: Option<Value>,
}

impl Head {
    fn read(file: &str, bytes: &[u8]) -> Result<Self, FileError> {
        json::parse(file, bytes).map_err(|error| match json::parse::<ProblemDrawing>(file, bytes) {
            // It skips what it does not know, so that the whole problem names the place better.
            Err(closer) if matches!(closer.fault, Fault::NotJson(_)) => closer,
            _ => error,
        })
    }

    fn format(&self) -> Option<&str> {
        self.format.as_ref().and_then(Value::as_str)
    }

    fn wrong(&self, file: &str, expected: &'static str) -> FileError {
        let found =
            self.format.as_ref().map_or_else(|| "not stated".into(), |found| quoted(&found.to_string()));
        let fault = match self.format() {
            Some(RESULT_FORMAT) => Fault::Result { expected },
            _ => Fault::Format { found, expected },
        };
        Place::file(file).key("format").error(fault)
    }
}

fn stem(path: &Path) -> String {
    path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}

impl ProblemFile {
    /// Whether all that is measured are poses of the tool, or positions of the tool point, by an instrument without
    /// constants of its own.
    pub fn measures_tool_alone(&self) -> bool {
        let alone = |set: &DataSet| {
            matches!(set.kind, Kind::Pose | Kind::Position)
                && set.blanks.iter().all(|blank| blank.drawing.target.is_none())
        };
        self.mechanism.instrument.is_empty() && matches!(self.data.parts(), [set] if alone(set))
    }

    /// Refuses a problem with links whose tolerance is not stated: without it nothing can be identified.
    pub fn require_tolerances(&self) -> Result<(), FileError> {
        match &self.without_tolerance {
            None => Ok(()),
            Some(at) => Err(FileError { location: Box::new(at.clone()), fault: Fault::NoTolerance }),
        }
    }

    /// Refuses a problem without measured postures, or with some that are only planned.
    pub fn require_samples(&self) -> Result<(), FileError> {
        for (key, set) in [("data", &self.data), ("data.holdout", &self.holdout)] {
            if let Some(planned) = set.planned.first() {
                return Err(Place::file(&self.file).key(key).named(&planned.name).error(Fault::Planned));
            }
        }
        if self.data.is_empty() {
            let fault = match self.data.unused.len() {
                0 => Fault::NoSamples,
                unused => Fault::AllUnused(unused),
            };
            Err(Place::file(&self.file).key("data").error(fault))
        } else {
            Ok(())
        }
    }
}
