//! A machine as a table: common normals between successive axes, from z of {S} to z of {T}.

use super::read::COLUMNS;
use super::row::{Convention, Row, RowKind, chain};
use crate::cells::field;
use crate::files::Units;
use crate::formats::xml::turn;
use crate::formats::{Chain, Wrong};
use crate::lie::Se3;
use crate::model::mechanism::pose_difference;
use crate::model::{Mechanism, Motion};
use nalgebra::Vector3;

/// Sine of the angle below which axes are parallel: rounding moves their common normal by as much as taking them
/// for parallel moves the tool.
const PARALLEL: f64 = 1e-9;
/// Angle below which axes were most likely meant to be parallel, rad.
const NEARLY_PARALLEL: f64 = 0.05;
/// Lengths (m) and angles (rad) below which a fixed row does nothing.
const NOTHING: f64 = 1e-13;
/// Numbers below this are rounding of zero, rad or m, and written so.
const ROUNDING: f64 = 1e-15;
/// Half of the range of an angular joint without one, rad.
const ANGULAR_RANGE: f64 = std::f64::consts::PI;
/// Half of the range of a prismatic joint without one, m.
const LINEAR_RANGE: f64 = 0.5;
/// Postures at which the table is compared with the machine.
const POSTURES: usize = 500;

/// A table and how far it is from the machine.
#[derive(Clone, Debug)]
pub struct Table {
    /// Its rows.
    pub rows: Vec<Row>,
    /// The order of their screws.
    pub convention: Convention,
    /// Largest rotation between the machine's pose and the table's over the joints' ranges, rad.
    pub rotation: f64,
    /// Largest displacement of the tool point likewise, m.
    pub position: f64,
    /// Pairs of neighbouring axes taken for parallel although they are not exactly so, with the angle, rad.
    pub taken_for_parallel: Vec<(String, f64)>,
    /// Neighbouring axes written as they are although their common normal is far from the machine: the pair, the angle
    /// between them (rad) and the distance along the first axis (m).
    pub nearly_parallel: Vec<(String, f64, f64)>,
}

/// Screws of one axis: `theta`, `d` along it, then `a`, `alpha` to the next.
struct Step {
    theta: f64,
    d: f64,
    a: f64,
    alpha: f64,
}

impl Step {
    fn motion(&self) -> Se3 {
        let z = Se3 { r: turn(2, self.theta), p: Vector3::new(0.0, 0.0, self.d) };
        z * Se3 { r: turn(0, self.alpha), p: Vector3::new(self.a, 0.0, 0.0) }
    }
}

/// The table of a serial machine.
///
/// Axes within `parallel` (rad) of each other are written as parallel. With `joint_rows_only` the fixed rows at base
/// and tool are left out, as for a controller that has no place for them. The errors say what either costs.
pub fn table(
    mechanism: &Mechanism,
    convention: Convention,
    parallel: f64,
    joint_rows_only: bool,
) -> Result<Table, Wrong> {
    let machine = Chain::of(mechanism, "a Denavit-Hartenberg table")?;
    let mut at = Se3::identity();
    let mut steps = Vec::new();
    let (mut taken_for_parallel, mut nearly_parallel) = (Vec::new(), Vec::new());
    let size = mechanism.characteristic_length();
    for (index, next) in machine.axes.iter().map(|axis| &axis.frame).chain([&machine.tool]).enumerate() {
        // The frame behind a prismatic joint may be anywhere along and beside its axis.
        let (step, angle) = step(&(at.inverse() * *next), parallel.sin().max(PARALLEL));
        let name = |i: usize| machine.axes.get(i).map_or("tool", |axis| axis.name.as_str());
        let pair = || format!("{} and {}", index.checked_sub(1).map_or("base", name), name(index));
        if angle > PARALLEL && step.alpha.sin() == 0.0 {
            taken_for_parallel.push((pair(), angle));
        } else if angle < NEARLY_PARALLEL && step.d.abs() > size {
            nearly_parallel.push((pair(), angle, step.d));
        }
        at = at * step.motion();
        steps.push(step);
    }
    let rest = at.inverse() * machine.tool;
    let end = (rest.r[(1, 0)].atan2(rest.r[(0, 0)]), rest.p.z);
    let mut rows = grouped(&machine, &steps, end, convention);
    if joint_rows_only {
        rows.retain(|row| row.kind != RowKind::Fixed);
    }
    let (rotation, position) = largest_error(&machine, &chain(&rows, convention));
    Ok(Table { rows, convention, rotation, position, taken_for_parallel, nearly_parallel })
}

/// The screws from frame 0, z along one axis, to the next axis (z of `next`), and the angle between the two.
fn step(next: &Se3, parallel: f64) -> (Step, f64) {
    let z = next.r.column(2);
    let sine = z.x.hypot(z.y);
    let angle = sine.atan2(z.z);
    if sine < parallel {
        // Any common normal will do: the one through the origin. None at all where the axes coincide.
        let a = next.p.x.hypot(next.p.y);
        let theta = if a > NOTHING { next.p.y.atan2(next.p.x) } else { 0.0 };
        let alpha = if z.z > 0.0 { 0.0 } else { std::f64::consts::PI };
        return (
            Step { theta, d: 0.0, a: if a > NOTHING { a } else { 0.0 }, alpha },
            angle.min(std::f64::consts::PI - angle),
        );
    }
    // x of the row is the common normal e3 x z; it meets the first axis where the second is nearest.
    let normal = Vector3::new(-z.y, z.x, 0.0) / sine;
    let mut a = normal.dot(&next.p);
    let along = (next.p.x * z.x + next.p.y * z.y) / (sine * sine);
    let d = next.p.z - along * z.z;
    let mut theta = normal.y.atan2(normal.x);
    let mut alpha = angle;
    // Of the two directions of x the one that turns less, or points to the next axis.
    let turned = theta.abs() > std::f64::consts::FRAC_PI_2 + NOTHING;
    if if a.abs() > NOTHING { a < 0.0 } else { turned } {
        theta -= std::f64::consts::PI.copysign(theta);
        (a, alpha) = (-a, -alpha);
    }
    (
        Step { theta, d, a: if a.abs() > NOTHING { a } else { 0.0 }, alpha },
        angle.min(std::f64::consts::PI - angle),
    )
}

/// Rows from the screws: a fixed row for {S}, one a joint, a fixed row for {T}; fixed rows that do nothing are left out.
fn grouped(machine: &Chain, steps: &[Step], end: (f64, f64), convention: Convention) -> Vec<Row> {
    let z = |i: usize| steps.get(i).map_or(end, |step| (step.theta, step.d));
    let x = |i: Option<usize>| i.and_then(|i| steps.get(i)).map_or((0.0, 0.0), |step| (step.a, step.alpha));
    let mut rows = Vec::with_capacity(steps.len() + 1);
    for i in 0..=steps.len() {
        let joint = i.checked_sub(1).and_then(|j| machine.axes.get(j));
        let ((theta, d), (a, alpha)) = match convention {
            Convention::Standard => (z(i), x(Some(i))),
            Convention::Modified => (z(i), x(i.checked_sub(1))),
        };
        let name = match (i, joint) {
            (_, Some(axis)) => axis.name.clone(),
            (0, None) => "base".to_owned(),
            (_, None) => "tool".to_owned(),
        };
        let kind = match joint.map(|axis| axis.motion) {
            None => RowKind::Fixed,
            Some(Motion::Prismatic) => RowKind::Prismatic,
            Some(_) => RowKind::Revolute,
        };
        rows.push(Row { name, kind, theta, d, a, alpha, range: joint.and_then(|axis| axis.range) });
    }
    merged(rows, convention)
}

/// Joins the row of {T} (standard) with the joint row before it where that ends along z, drops what does nothing.
fn merged(mut rows: Vec<Row>, convention: Convention) -> Vec<Row> {
    if convention == Convention::Standard
        && let [.., before, last] = rows.as_mut_slice()
        && before.kind != RowKind::Fixed
        && before.a == 0.0
        && before.alpha == 0.0
    {
        before.theta += last.theta;
        before.d += last.d;
        (last.theta, last.d) = (0.0, 0.0);
    }
    let nothing = |row: &Row| [row.theta, row.d, row.a, row.alpha].iter().all(|v| v.abs() <= NOTHING);
    rows.retain(|row| row.kind != RowKind::Fixed || !nothing(row));
    rows
}

/// Largest rotation and displacement between two chains over the ranges of the first: at the ends of each joint's
/// range, and at postures of a low-discrepancy sequence (Roberts' R_n, from the roots of x^(n+1) = x + 1).
fn largest_error(machine: &Chain, table: &Chain) -> (f64, f64) {
    let ranges: Vec<(f64, f64)> = machine
        .axes
        .iter()
        .map(|axis| {
            let half = if axis.motion.is_angular() { ANGULAR_RANGE } else { LINEAR_RANGE };
            axis.range.unwrap_or((-half, half))
        })
        .collect();
    let n = ranges.len();
    let mut ratio = 2.0_f64;
    for _ in 0..60 {
        ratio = (1.0 + ratio).powf(1.0 / (n as f64 + 1.0));
    }
    let at = |fraction: &dyn Fn(usize) -> f64| -> Vec<f64> {
        ranges.iter().enumerate().map(|(i, (low, high))| low + fraction(i) * (high - low)).collect()
    };
    let sequence = (0..POSTURES).map(|k| at(&|i| (0.5 + k as f64 * ratio.powi(-(i as i32 + 1))).fract()));
    let ends = (0..2 * n).map(|k| at(&|i| if i == k / 2 { (k % 2) as f64 } else { 0.5 }));
    let (mut rotation, mut position) = (0.0_f64, 0.0_f64);
    for readings in sequence.chain(ends) {
        let (w, v) = pose_difference(&machine.pose(&readings), &table.pose(&readings));
        (rotation, position) = (rotation.max(w.norm()), position.max(v.norm()));
    }
    (rotation, position)
}

impl Table {
    /// The table as CSV with lengths and angles in `units`.
    pub fn text(&self, units: Units) -> String {
        let mut text = COLUMNS.join(",");
        text.push('\n');
        for row in &self.rows {
            let joint = |value: f64| match row.kind {
                RowKind::Prismatic => units.from_metres(value),
                RowKind::Revolute | RowKind::Fixed => units.from_radians(value),
            };
            let range = row
                .range
                .map_or_else(|| ",".to_owned(), |(low, high)| format!("{:?},{:?}", joint(low), joint(high)));
            let numbers = [
                units.from_radians(row.theta),
                units.from_metres(row.d),
                units.from_metres(row.a),
                units.from_radians(row.alpha),
            ]
            .map(|v| if v.abs() < ROUNDING { "0".to_owned() } else { format!("{v:?}") });
            text.push_str(&format!(
                "{},{},{},{range}\n",
                field(&row.name),
                row.kind.letter(),
                numbers.join(",")
            ));
        }
        text
    }
}
