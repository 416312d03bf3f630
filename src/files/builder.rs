//! A machine drawn in code: the same drawing, read and refused by the same rules, as one in a file.

use super::drawing::{JointDrawing, LimbDrawing, MechanismDrawing};
use super::error::FileError;
use super::fault::Fault;
use super::place::Place;
use super::pose::PoseDrawing;
use super::tolerance::{BoundsDrawing, ToleranceDrawing};
use super::units::Units;
use super::values::{OneOrEach, RangeDrawing, RangeEntry};
use crate::lie::Se3;
use crate::model::{Mechanism, Tolerance, mobility};
use nalgebra::{Matrix3, Vector3};

/// What messages call a machine that stands in no file.
const IN_CODE: &str = "machine drawn in code";

/// Largest entry of `R R' - I` of a rotation matrix.
const ORTHOGONAL: f64 = 1e-6;

/// A machine while it is drawn, m and rad, lines in {S} at home (docs/conventions.md).
///
/// Joints go to the limb named last, and what is said of a joint to the joint drawn last. [`build`](Self::build) refuses
/// what a file would be refused for, so that every [`Mechanism`] made here can be evaluated.
///
/// ```
/// use gough::lie::Se3;
/// use gough::model::{Mechanism, Tolerance};
///
/// let arm = Mechanism::builder()
///     .limb("arm")
///     .prismatic("slide", [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]).actuated().range(0.0, 0.8)
///     .revolute("shoulder", [0.0, 0.0, 0.3], [0.0, 0.0, 1.0]).actuated()
///     .revolute("elbow", [0.5, 0.0, 0.3], [0.0, 1.0, 0.0]).actuated()
///     .tool(Se3::translation(0.9, 0.0, 0.3))
///     .tolerance(Tolerance::sigma(1e-3, 1e-3))
///     .build()?;
/// assert_eq!(arm.actuator_names(), ["arm.slide", "arm.shoulder", "arm.elbow"]);
/// # Ok::<(), gough::files::FileError>(())
/// ```
#[derive(Debug)]
pub struct MechanismBuilder {
    drawing: MechanismDrawing,
    /// The first thing that no drawing can hold.
    refused: Option<Fault>,
}

impl Mechanism {
    /// Begins a machine in code.
    pub fn builder() -> MechanismBuilder {
        MechanismBuilder { drawing: MechanismDrawing::default(), refused: None }
    }
}

impl MechanismBuilder {
    /// Begins a limb, from base to platform.
    pub fn limb(mut self, name: &str) -> Self {
        self.drawing.limbs.push(LimbDrawing { name: Some(name.to_owned()), ..LimbDrawing::default() });
        self
    }

    /// A rotation about `axis` (any length but zero) through `point` (m).
    pub fn revolute(self, name: &str, point: impl Into<Vector3<f64>>, axis: impl Into<Vector3<f64>>) -> Self {
        self.one_axis("revolute", name, point, axis)
    }

    /// A translation along `axis`.
    pub fn prismatic(
        self,
        name: &str,
        point: impl Into<Vector3<f64>>,
        axis: impl Into<Vector3<f64>>,
    ) -> Self {
        self.one_axis("prismatic", name, point, axis)
    }

    /// A rotation about `axis` and a translation along it, both free of each other.
    pub fn cylindrical(
        self,
        name: &str,
        point: impl Into<Vector3<f64>>,
        axis: impl Into<Vector3<f64>>,
    ) -> Self {
        self.one_axis("cylindrical", name, point, axis)
    }

    /// A screw about `axis` that advances by `pitch` (m, not zero, negative for a left-handed one) a revolution.
    pub fn helical(
        self,
        name: &str,
        point: impl Into<Vector3<f64>>,
        axis: impl Into<Vector3<f64>>,
        pitch: f64,
    ) -> Self {
        self.one_axis("helical", name, point, axis).of_joint("pitch", |joint| joint.pitch = Some(pitch))
    }

    /// Two rotations about axes through `point`, in chain order.
    pub fn universal(self, name: &str, point: impl Into<Vector3<f64>>, axes: [[f64; 3]; 2]) -> Self {
        self.several_axes("universal", name, point, &axes)
    }

    /// Three rotations about axes through `point`: a ball.
    pub fn spherical(self, name: &str, point: impl Into<Vector3<f64>>) -> Self {
        self.several_axes("spherical", name, point, &[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    }

    /// Two translations and a rotation about the third axis.
    pub fn planar(self, name: &str, point: impl Into<Vector3<f64>>, axes: [[f64; 3]; 3]) -> Self {
        self.several_axes("planar", name, point, &axes)
    }

    /// The joint drawn last is driven, or read by a sensor, about all of its axes.
    pub fn actuated(self) -> Self {
        self.of_joint("actuated", |joint| joint.actuated = Some(OneOrEach::One(true)))
    }

    /// Which of the axes of the joint drawn last are driven, in chain order.
    pub fn actuated_axes(self, axes: &[bool]) -> Self {
        self.of_joint("actuated_axes", |joint| joint.actuated = Some(OneOrEach::Each(axes.to_vec())))
    }

    /// Reading at home of the joint drawn last, rad or m.
    pub fn home(self, reading: f64) -> Self {
        self.of_joint("home", |joint| joint.home = Some(OneOrEach::One(reading)))
    }

    /// Readings between which the joint drawn last is used, rad or m.
    pub fn range(self, low: f64, high: f64) -> Self {
        let pair = vec![RangeEntry::Limit(low), RangeEntry::Limit(high)];
        self.of_joint("range", |joint| joint.range = Some(RangeDrawing(pair)))
    }

    /// Of the link before the joint drawn last, in place of the machine's.
    pub fn joint_tolerance(self, tolerance: Tolerance) -> Self {
        let drawing = ToleranceDrawing::of(&tolerance, Units::SI);
        self.of_joint("joint_tolerance", |joint| joint.tolerance = Some(drawing))
    }

    /// Of the links between the axes of the joint drawn last.
    pub fn inner_tolerance(self, tolerance: Tolerance) -> Self {
        let drawing = ToleranceDrawing::of(&tolerance, Units::SI);
        self.of_joint("inner_tolerance", |joint| joint.inner_tolerance = Some(drawing))
    }

    /// Of the links of the limb named last, in place of the machine's.
    pub fn limb_tolerance(self, tolerance: Tolerance) -> Self {
        let drawing = ToleranceDrawing::of(&tolerance, Units::SI);
        self.of_limb("limb_tolerance", |limb| limb.tolerance = Some(drawing))
    }

    /// Where the limb named last puts {T} at home, in place of the machine's tool.
    pub fn limb_tool(mut self, tool: Se3) -> Self {
        let drawing = self.pose(&tool);
        self.of_limb("limb_tool", |limb| limb.tool = Some(drawing))
    }

    /// Pose of {T} in {S} with all joints at home.
    pub fn tool(mut self, tool: Se3) -> Self {
        self.drawing.tool = Some(self.pose(&tool));
        self
    }

    /// Of every link that nothing nearer governs.
    pub fn tolerance(mut self, tolerance: Tolerance) -> Self {
        self.drawing.tolerance = Some(ToleranceDrawing::of(&tolerance, Units::SI));
        self
    }

    /// Of the last link of every limb.
    pub fn tool_tolerance(mut self, tolerance: Tolerance) -> Self {
        self.drawing.tool_tolerance = Some(ToleranceDrawing::of(&tolerance, Units::SI));
        self
    }

    /// Hard limits on every component of every link's deviation, rad and m; infinite where there is none.
    pub fn bounds(mut self, angle: f64, length: f64) -> Self {
        self.drawing.bounds = Some(BoundsDrawing::of((angle, length), Units::SI));
        self
    }

    /// One rigid motion in front of every first link: where the whole machine stands in {S}.
    pub fn placement(mut self, tolerance: Tolerance) -> Self {
        self.drawing.placement = Some(ToleranceDrawing::of(&tolerance, Units::SI));
        self
    }

    /// One rigid motion behind every last link: how the tool is mounted.
    pub fn tool_mounting(mut self, tolerance: Tolerance) -> Self {
        self.drawing.tool_mounting = Some(ToleranceDrawing::of(&tolerance, Units::SI));
        self
    }

    /// The machine, m and rad.
    ///
    /// # Errors
    /// What a file would be refused for (docs/files.md), named by limb and joint; a link without tolerance; a machine that is
    /// over-constrained, under-actuated, singular or open at home.
    pub fn build(self) -> Result<Mechanism, FileError> {
        let file = Place::file(IN_CODE);
        let at = file.key("mechanism");
        if let Some(fault) = self.refused {
            return Err(at.error(fault));
        }
        let drawn = self.drawing.read(Units::SI, &at)?;
        if let Some(place) = drawn.without_tolerance {
            return Err(FileError { location: Box::new(place), fault: Fault::NoTolerance });
        }
        mobility::check(&drawn.mechanism, &drawn.mechanism.nominal())
            .map_err(|why| at.error(Fault::NoMachine(Box::new(why))))?;
        Ok(drawn.mechanism)
    }

    fn one_axis(
        self,
        kind: &str,
        name: &str,
        point: impl Into<Vector3<f64>>,
        axis: impl Into<Vector3<f64>>,
    ) -> Self {
        let axis = axis.into().into();
        self.joint(kind, name, point, |joint| joint.axis = Some(axis))
    }

    fn several_axes(self, kind: &str, name: &str, point: impl Into<Vector3<f64>>, axes: &[[f64; 3]]) -> Self {
        self.joint(kind, name, point, |joint| joint.axes = Some(axes.to_vec()))
    }

    fn joint(
        self,
        kind: &str,
        name: &str,
        point: impl Into<Vector3<f64>>,
        with: impl FnOnce(&mut JointDrawing),
    ) -> Self {
        let mut joint = JointDrawing {
            name: Some(name.to_owned()),
            kind: kind.to_owned(),
            point: point.into().into(),
            ..JointDrawing::default()
        };
        with(&mut joint);
        self.of_limb(name, |limb| limb.joints.push(joint))
    }

    fn of_limb(mut self, what: &str, change: impl FnOnce(&mut LimbDrawing)) -> Self {
        match self.drawing.limbs.last_mut() {
            Some(limb) => change(limb),
            None => self.misplace(what, "limb"),
        }
        self
    }

    fn of_joint(mut self, what: &str, change: impl FnOnce(&mut JointDrawing)) -> Self {
        match self.drawing.limbs.last_mut().and_then(|limb| limb.joints.last_mut()) {
            Some(joint) => change(joint),
            None => self.misplace(what, "joint"),
        }
        self
    }

    fn misplace(&mut self, what: &str, before: &'static str) {
        self.refused.get_or_insert_with(|| Fault::Misplaced { what: what.to_owned(), before });
    }

    /// Files hold rotation vectors, which are rotations whatever their numbers; a matrix need not be one.
    fn pose(&mut self, pose: &Se3) -> PoseDrawing {
        let off = (pose.r * pose.r.transpose() - Matrix3::identity()).amax();
        if !(off <= ORTHOGONAL && pose.r.determinant() > 0.0) {
            self.refused.get_or_insert(Fault::NoRotationMatrix);
        }
        PoseDrawing::of(pose, Units::SI)
    }
}
