//! Everything that can be wrong with a file, in words that say what to do.

use crate::model::mobility::MobilityError;

/// What is wrong at a place of a file.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "each variant's message is its documentation")]
pub enum Fault {
    #[error("cannot be read: {0}")]
    Read(std::io::Error),
    #[error("cannot be written: {0}")]
    Write(String),
    #[error("is read by this run and would be overwritten by its output; give -o another name")]
    InputAndOutput,
    #[error("the file is empty")]
    Empty,
    #[error("larger than {0} MB: this is no such file")]
    TooLarge(u64),
    #[error("not JSON: {0}")]
    NotJson(String),
    #[error("{0}")]
    Schema(String),
    #[error(
        "this is a result (gough-result/1); expected {expected}: give the problem from which it was made"
    )]
    Result { expected: &'static str },
    #[error("the format is {found}; expected {expected}")]
    Format { found: String, expected: &'static str },

    #[error("{} where {wanted} belong", several(*found, "number"))]
    Length { found: usize, wanted: usize },
    #[error("{0} is no share; it lies between 0 and 1")]
    Share(f64),

    #[error("{0} is not a finite number")]
    NotFinite(f64),
    #[error("{} {unit} is too large: the limit is {} {unit}; are the units right?", plain(*value), plain(*limit))]
    Huge { value: f64, limit: f64, unit: &'static str },
    #[error(
        "{} is no weight; give a number from {} to {}, or 0 for a sample that is not to be used",
        plain(*found), plain(*least), plain(*most)
    )]
    Weight { found: f64, least: f64, most: f64 },
    #[error("{0} is negative; give a standard deviation, 0 to keep it as drawn, or \"free\"")]
    NegativeTolerance(f64),
    #[error(
        "{value:e} {unit} is too small for a tolerance; give at least {least:e} {unit}, or 0 to keep it as drawn"
    )]
    SmallTolerance { value: f64, least: f64, unit: &'static str },
    #[error("{0} is negative; give the largest size that a component may have")]
    NegativeBound(f64),
    #[error("bounds on a link that is held (tolerance 0): remove them, or give it a tolerance")]
    BoundsOnHeld,

    #[error("{0}")]
    NoMachine(Box<MobilityError>),
    #[error("\"{what}\" comes before the first {before}; draw the {before} first")]
    Misplaced { what: String, before: &'static str },
    #[error(
        "the rotation of a pose is no rotation matrix: its columns must be at right angles, of length 1 and right-handed"
    )]
    NoRotationMatrix,
    #[error("there is no limb; draw at least one")]
    NoLimb,
    #[error("the limb has no joints; draw at least one")]
    NoJoint,
    #[error("no joint is actuated; mark the driven or sensed joints with \"actuated\": true")]
    NoActuator,
    #[error("the name {0} is used twice; give each its own")]
    DuplicateName(String),
    #[error("the name is empty; leave it out or fill it in")]
    EmptyName,
    #[error("the name {name} has a control character (U+{code:04X}); remove it")]
    ControlCharacter { name: String, code: u32 },
    #[error("unknown joint type {found}; known types: {known}")]
    UnknownType { found: String, known: String },
    #[error("a {kind} joint has {wanted}: give \"{key}\"")]
    AxisKey { kind: &'static str, wanted: &'static str, key: &'static str },
    #[error("a {kind} joint has {wanted} axes, {found} given")]
    AxisCount { kind: &'static str, wanted: usize, found: usize },
    #[error("the axis is zero; give it a direction")]
    ZeroAxis,
    #[error("a {0} joint needs \"pitch\", its advance per revolution")]
    NoPitch(&'static str),
    #[error("the pitch is zero; a helical joint without advance is a revolute joint")]
    ZeroPitch,
    #[error("a {0} joint has no pitch; remove it, or make the joint helical")]
    Pitch(&'static str),
    #[error("{} for the {wanted} axes of this joint; give one per axis, in chain order", several(*found, "value"))]
    OnePerAxis { wanted: usize, found: usize },
    #[error("a range is [lowest, highest], or a list with one of them or null per axis")]
    RangeForm,
    #[error("the range begins at {0} and ends below, at {1}; give [lowest, highest]")]
    RangeOrder(f64, f64),
    #[error("no tool pose; give \"tool\" on the mechanism, or on each limb")]
    NoTool,
    #[error(
        "no tolerance; \"tolerance\": {{\"angle\": ..., \"length\": ...}} on the mechanism covers all links"
    )]
    NoTolerance,

    #[error("no position")]
    NoPosition,
    #[error(
        "no rotation; give \"rotation\" or \"quaternion\", [null, null, null] where it was not measured, or \
         \"kind\": \"position\" in data where it never was"
    )]
    NoRotation,
    #[error("no rotation; a drawn pose needs \"rotation\" or \"quaternion\"")]
    NoDrawnRotation,
    #[error(
        "no rotation; give one with every pose or, where the position is all that is wanted, give the rotation up: \
         --free rx,ry,rz"
    )]
    NoWantedRotation,
    #[error("both rotation and quaternion given; remove one")]
    TwoRotations,
    #[error("a component is missing; this pose needs all of them")]
    Incomplete,
    #[error("some components of the rotation are missing; a rotation is measured wholly or not at all")]
    PartRotation,
    #[error("no pose; a posture that is only planned serves `gough analyze` alone: measure it, or remove it")]
    Planned,
    #[error("nothing was measured here; remove the sample")]
    NothingMeasured,
    #[error("the quaternion is zero")]
    ZeroQuaternion,
    #[error("the quaternion [w, x, y, z] has length {0}, not 1")]
    QuaternionLength(f64),

    #[error("{} for {} ({names})", several(*found, "reading"), several(*wanted, "actuator"))]
    ActuatorCount { found: usize, wanted: usize, names: String },
    #[error("{0} is no noise; give a positive standard deviation")]
    Noise(f64),
    #[error("{0} is no noise; give a standard deviation, or 0 where nothing is common")]
    PostureNoise(f64),
    #[error("{value:e} {unit} is too small for a noise; give at least {least:e} {unit}")]
    SmallNoise { value: f64, least: f64, unit: &'static str },
    #[error("noise of a measured {kind} needs \"{key}\", a positive standard deviation")]
    NoiseMissing { kind: &'static str, key: &'static str },
    #[error("both noise and covariance given; remove one")]
    TwoNoises,
    #[error("the covariance is not symmetric: entries [{0}][{1}] and [{1}][{0}] differ")]
    Asymmetric(usize, usize),
    #[error("the covariance is not positive definite")]
    NotPositive,
    #[error("unknown kind of measurement {found}; known kinds: {known}")]
    UnknownKind { found: String, known: String },
    #[error("unknown {what} {found}; data.instrument has: {known}")]
    UnknownReference { what: &'static str, found: String, known: String },
    #[error("which {what}? name one with \"{what}\": {known}")]
    WhichReference { what: &'static str, known: String },
    #[error("no {0}; draw one in data.instrument")]
    NoReference(&'static str),
    #[error("no {0}; it may only be left out where the tolerance is \"free\"")]
    NotStated(&'static str),
    #[error("the normal is zero; give it a direction")]
    ZeroNormal,
    #[error("the scale is zero")]
    ZeroScale,
    #[error("no {0}; a measured {1} needs it")]
    NoNumber(&'static str, &'static str),
    #[error("a measured {0} is one number: give its noise, not a covariance")]
    CovarianceOfNumber(&'static str),
    #[error("unknown joint {found}; passive joints: {known}")]
    UnknownJoint { found: String, known: String },
    #[error("no passive joints; this machine knows all of its joints")]
    NoPassiveJoint,
    #[error("{} for {} ({names})", several(*found, "joint reading"), several(*wanted, "sensed joint"))]
    JointCount { found: usize, wanted: usize, names: String },
    #[error("{0} is stated beside \"sets\"; move it into one of them")]
    BesideSets(&'static str),
    #[error("\"{0}\" belongs to data as a whole; move it there")]
    OfWholeData(&'static str),
    #[error("there is no set; list at least one, or give \"samples\" or \"file\"")]
    NoSet,
    #[error("both samples and file given; remove one")]
    TwoSources,
    #[error("{0} only makes sense with a data file; name it with \"file\"")]
    WithoutFile(&'static str),
    #[error("hold-out data have no hold-out of their own; remove it")]
    NestedHoldout,
    #[error("no measured poses; give \"samples\", or \"file\" with the name of a CSV file")]
    NoSamples,
    #[error(
        "no measured poses to use: {} of weight 0, which is predicted, never used; give some of them a weight",
        if *.0 == 1 { "the only sample is".to_owned() } else { format!("all {} samples are", .0) }
    )]
    AllUnused(usize),
    #[error("{0} is below zero, which no distance is: the gauge reads {1} where there is none")]
    NegativeDistance(f64, f64),
    #[error(
        "no such data file; looked for {0}; put it beside the problem file, name its folder with --data-dir, or \
         set GOUGH_SHARED to the folder that has it under data/"
    )]
    NoDataFile(String),
    #[error("the true machine has other actuators ({found}) than the mechanism ({wanted})")]
    OtherActuators { found: String, wanted: String },

    #[error("not a result line of gough compare: {0}; remove the line, and its run is made again")]
    ResultLine(String),
    #[error("another result of the same run than {0}; keep one of them")]
    OtherResult(String),
    #[error("{found} is too small or not finite; give a number of at least {least}")]
    BenchmarkNumber { found: f64, least: f64 },

    #[error("not a CSV table: {0}")]
    Table(String),
    #[error("columns are divided by {0:?}: write commas, and points in decimal numbers")]
    Separator(char),
    #[error("no column {wanted}; the columns are {found}")]
    NoColumn { wanted: String, found: String },
    #[error("two columns are called {0}")]
    TwoColumns(String),
    #[error(
        "the column {0} is named twice; each value has a column of its own: where one reading drives several joints, \
         copy its column in the table, once for each of them, under names of their own"
    )]
    ColumnTwice(String),
    #[error("unknown column {found}; {expected}")]
    UnknownColumn { found: String, expected: String },
    #[error("{} where the header has {wanted}", several(*found, "cell"))]
    CellCount { found: usize, wanted: usize },
    #[error("{0} is not a number")]
    NotNumber(String),
    #[error("the readings are in the table {0}: give that as the file of actuators")]
    ReadingsElsewhere(String),
    #[error("the reading is missing")]
    NoReading,
    #[error("there are no rows{0}")]
    NoRows(String),
}

/// The number, with an exponent where it would be long.
fn plain(value: f64) -> String {
    if value.abs() > 1e9 || value != 0.0 && value.abs() < 1e-6 {
        format!("{value:e}")
    } else {
        value.to_string()
    }
}

/// The number with its noun.
fn several(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}
