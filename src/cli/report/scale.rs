//! Units that make numbers of a size that people read.

use crate::files::{AngleUnit, Units};

/// A unit of display.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scale {
    /// Its symbol.
    pub(super) symbol: &'static str,
    /// One m or rad in it.
    per: f64,
}

impl Scale {
    /// The unit of lengths of about `typical` m.
    pub(super) fn length(typical: f64) -> Self {
        match typical {
            v if v < 1e-3 => Self { symbol: "µm", per: 1e6 },
            v if v < 1.0 => Self { symbol: "mm", per: 1e3 },
            _ => Self { symbol: "m", per: 1.0 },
        }
    }

    /// The unit of angles of about `typical` rad: degrees where the file has degrees.
    pub(super) fn angle(typical: f64, units: Units) -> Self {
        match (units.angle, typical) {
            (AngleUnit::Degree, v) if v < 1e-3 => Self { symbol: "arcsec", per: 1_f64.to_degrees() * 3600.0 },
            (AngleUnit::Degree, _) => Self { symbol: "deg", per: 1_f64.to_degrees() },
            (AngleUnit::Radian, v) if v < 1e-3 => Self { symbol: "µrad", per: 1e6 },
            (AngleUnit::Radian, v) if v < 1.0 => Self { symbol: "mrad", per: 1e3 },
            (AngleUnit::Radian, _) => Self { symbol: "rad", per: 1.0 },
        }
    }

    /// A value in rad or m in this unit.
    pub(super) fn of(self, value: f64) -> f64 {
        value * self.per
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_keeps_its_size() {
        assert_eq!(Scale::length(2e-5).of(2e-5), 20.0);
        assert_eq!(Scale::length(0.02).symbol, "mm");
        let degrees = Units { angle: AngleUnit::Degree, ..Units::SI };
        assert!((Scale::angle(1e-4, degrees).of(std::f64::consts::PI) - 648_000.0).abs() < 1e-9);
        assert_eq!(Scale::angle(0.1, degrees).symbol, "deg");
    }
}
