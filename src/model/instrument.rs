//! Constants of the measuring set-up that are identified together with the links: where a target sits on the tool,
//! where a fixed point or a plane is, the zero and the scale of a gauge.
//!
//! The model knows their values and what is known of them beforehand; [`crate::measure`] gives them their meaning.

use super::limb::Prior;

/// What a constant measures, and thereby its unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// rad.
    Angle,
    /// m.
    Length,
    /// No unit.
    Ratio,
}

/// One unknown number of the measuring set-up. It deviates by addition: value = nominal + d.
#[derive(Clone, Debug, PartialEq)]
pub struct Constant {
    /// What it belongs to, such as `point bar1`.
    pub element: String,
    /// Which number of it this is, such as `x`.
    pub component: &'static str,
    /// Its unit.
    pub quantity: Quantity,
    /// Value before anything is measured, rad, m or 1.
    pub nominal: f64,
    /// Prior of its deviation; a held number is no constant to identify and is not listed.
    pub prior: Prior,
    /// Hard limit on the size of its deviation, rad, m or 1.
    pub bounds: Option<f64>,
}

impl Constant {
    /// Name for people, such as `point bar1 x`.
    pub fn name(&self) -> String {
        format!("{} {}", self.element, self.component)
    }

    /// Unit inside the program.
    pub fn unit(&self) -> &'static str {
        match self.quantity {
            Quantity::Angle => "rad",
            Quantity::Length => "m",
            Quantity::Ratio => "",
        }
    }
}
