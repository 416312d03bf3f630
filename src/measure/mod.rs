//! What instruments report of a posture, or of two.

pub mod closed;
pub mod distance;
pub mod measurement;
pub mod passive_joint;
pub mod plane;
pub mod point;
pub mod pose;
pub mod position;
pub mod posture_noise;
pub mod separation;
pub mod weighted;

pub use closed::{Closed, ClosedAt};
pub use distance::Distance;
pub use measurement::{
    Clue, ConstantDerivative, Errors, Evaluation, LimbDerivative, Measurement, Row, View, Weights,
};
pub use passive_joint::{PassiveJoints, SensedJoint};
pub use plane::Touch;
pub use point::{Gauge, Plane, Point};
pub use pose::{Pose, Weighting};
pub use position::Position;
pub use posture_noise::{OfPosture, PostureNoise};
pub use separation::Separation;
pub use weighted::Weighted;
