//! Prediction errors of whatever was measured.

use crate::files::summary::PoseErrors;
use crate::files::{ResultFile, Units};
use crate::render::{Cell, Table};

/// Errors of one kind of measurement.
pub(super) struct Measured {
    /// What is measured.
    pub(super) name: &'static str,
    /// Whether it is an angle.
    angular: bool,
    /// Root mean square and largest, in units of the file.
    of: fn(&PoseErrors) -> (Option<f64>, Option<f64>),
}

impl Measured {
    /// Root mean square, in units of the file.
    pub(super) fn rms(&self, errors: &PoseErrors) -> Option<f64> {
        (self.of)(errors).0
    }

    /// Symbol of its unit.
    pub(super) fn unit(&self, units: Units) -> &'static str {
        if self.angular { units.angle_symbol() } else { units.length_symbol() }
    }
}

const MEASURED: [Measured; 6] = [
    Measured { name: "position", angular: false, of: |e| (e.position_rms, e.position_max) },
    Measured { name: "rotation", angular: true, of: |e| (e.rotation_rms, e.rotation_max) },
    Measured { name: "distance", angular: false, of: |e| (e.distance_rms, e.distance_max) },
    Measured { name: "height", angular: false, of: |e| (e.plane_rms, e.plane_max) },
    Measured { name: "joint angle", angular: true, of: |e| (e.joint_angle_rms, e.joint_angle_max) },
    Measured { name: "joint length", angular: false, of: |e| (e.joint_length_rms, e.joint_length_max) },
];

/// Rows of the result's errors: of which readings, by which machine.
fn rows(result: &ResultFile) -> Vec<(&'static str, &'static str, PoseErrors)> {
    let sets = [("used", result.fit), ("held out", result.holdout)];
    let pairs = sets.into_iter().filter_map(|(set, fit)| Some((set, fit?)));
    let mut rows: Vec<_> = pairs
        .flat_map(|(set, fit)| [(set, "as drawn", fit.before), (set, "identified", fit.after)])
        .collect();
    rows.extend(result.cross_validation.map(|cross| ("left out in turn", "identified", cross.errors)));
    rows
}

/// The kinds that the result has errors of.
pub(super) fn measured(result: &ResultFile) -> Vec<Measured> {
    let rows = rows(result);
    MEASURED.into_iter().filter(|m| rows.iter().any(|(_, _, errors)| m.rms(errors).is_some())).collect()
}

/// A row for each machine and set of readings, two columns for each kind of measurement.
pub(super) fn table(result: &ResultFile) -> Table {
    let measured = measured(result);
    let mut columns = vec!["readings".to_owned(), "machine".into()];
    for m in &measured {
        let unit = m.unit(result.units);
        columns.extend([format!("#{} rms / {unit}", m.name), format!("#{} max / {unit}", m.name)]);
    }
    columns.push("#in noise".into());
    let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
    let mut table = Table::new("errors", "Prediction errors.", &columns).captioned(
        "Predicted against measured; in noise is the root mean square in stated standard deviations.",
    );
    let shown = |v: Option<f64>| v.map_or_else(Cell::none, |v| Cell::number(v, 4));
    for (set, machine, errors) in rows(result) {
        let mut row = vec![Cell::text(set), Cell::text(machine)];
        for m in &measured {
            let (rms, max) = (m.of)(&errors);
            row.extend([shown(rms), shown(max)]);
        }
        row.push(shown(errors.weighted_rms));
        table.push(row);
    }
    table
}
