//! Everything that can be wrong with a foreign file, in words that say what to do.

/// Something wrong at a place of a foreign file.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{at}: {wrong}")]
pub struct FormatError {
    /// The file, line and element.
    pub at: String,
    /// What is wrong there.
    pub wrong: Wrong,
}

/// What is wrong.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs, reason = "each variant's message is its documentation")]
pub enum Wrong {
    #[error("not XML: {0}")]
    NotXml(String),
    #[error("the file begins with <{found}> where <{wanted}> is expected")]
    Root { found: String, wanted: &'static str },
    #[error("no attribute `{0}`")]
    NoAttribute(&'static str),
    #[error("`{attribute}` is {found}; {wanted} expected")]
    Numbers { attribute: String, found: String, wanted: String },
    #[error("`{0}` is zero; give it a direction")]
    ZeroAxis(&'static str),
    #[error("`{name}` is {found}; known: {known}")]
    Unknown { name: &'static str, found: String, known: &'static str },
    #[error("two of them are called {0}; give each its own name")]
    Twice(String),
    #[error("no {what} {found}; there are {known}")]
    Missing { what: &'static str, found: String, known: String },
    #[error("{0}")]
    Unsupported(String),

    #[error("link {link} is the child of two joints, {first} and {second}; a URDF is a tree")]
    TwoParents { link: String, first: String, second: String },
    #[error(
        "no chain leads from link {base} to link {tool}; above {base} are {above_base}; above {tool} are {above_tool}"
    )]
    NoChain { base: String, tool: String, above_base: String, above_tool: String },
    #[error(
        "the chain goes up from link {base} through joint {joint}, whose origin is then no place of the machine's axes \
         alone; leave --template out for a URDF of the chain by itself"
    )]
    Upwards { base: String, joint: String },
    #[error("the chain from {base} to {tool} has no moving joint")]
    NothingMoves { base: String, tool: String },
    #[error(
        "joint {joint} mimics {leader}: a chain with coupled joints is not described by independent axes; end \
         the chain before it, or make it a joint of its own"
    )]
    Mimic { joint: String, leader: String },
    #[error("joint {joint} is {kind}: a serial chain takes revolute, continuous, prismatic and fixed joints")]
    JointKind { joint: String, kind: String },
    #[error("the range begins at {0} and ends below, at {1}")]
    RangeOrder(f64, f64),
    #[error("this is a xacro source; expand it first: xacro FILE > robot.urdf")]
    Xacro,

    #[error("not a CSV table: {0}")]
    Table(String),
    #[error("no column `{wanted}`; the columns are {found}")]
    NoColumn { wanted: &'static str, found: String },
    #[error("unknown column {found}; known columns: {known}")]
    UnknownColumn { found: String, known: String },
    #[error("{found} cells where the header has {wanted}: the row is too {size}")]
    CellCount { found: usize, wanted: usize, size: &'static str },
    #[error("column `{column}`: {found} is not a number")]
    NotNumber { column: &'static str, found: String },
    #[error("column `{column}`: {value} is too large; are the units right?")]
    Huge { column: &'static str, value: f64 },
    #[error("column `type`: {0} is no joint type; R (revolute), P (prismatic) or F (fixed) expected")]
    RowType(String),
    #[error("column `min`: give both `min` and `max`, or neither")]
    HalfRange,
    #[error("there are no joint rows; a row with type R or P is needed")]
    NoRows,

    #[error("{format} describes one serial chain; this machine has {found}")]
    NotSerial { format: &'static str, found: String },
    #[error("{format} has no helical joints; {joint} is one")]
    Helical { format: &'static str, joint: String },
    #[error("the template's chain has the moving joints {found}; the machine has {wanted}")]
    OtherJoints { found: String, wanted: String },

    #[error("the machine does not reduce to limbs: {0}")]
    NotLimbs(String),
}

/// Text of a file as it may be quoted in a message.
pub(super) fn quoted(text: &str) -> String {
    crate::files::error::quoted(text)
}
