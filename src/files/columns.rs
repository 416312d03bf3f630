//! Columns of a table: which of them hold what.

use super::error::{FileError, quoted};
use super::fault::Fault;
use super::place::Place;
use super::table::{OtherColumns, PoseColumns, TableRequest};
use serde::{Deserialize, Serialize};

const POSITION: [&str; 3] = ["x", "y", "z"];
const ROTATION: [&str; 3] = ["rx", "ry", "rz"];
const QUATERNION: [&str; 4] = ["qw", "qx", "qy", "qz"];
/// Standard deviations of predicted poses; nothing is read from them.
const STD: [&str; 6] = ["sx", "sy", "sz", "srx", "sry", "srz"];

/// Names of the columns of a table that does not use ours. Columns that are not named are left aside.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColumnsDrawing {
    /// One per actuator, in actuator order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub actuators: Option<Vec<String>>,
    /// Of the position.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position: Option<[String; 3]>,
    /// Of the rotation vector.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotation: Option<[String; 3]>,
    /// Of the quaternion `[w, x, y, z]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quaternion: Option<[String; 4]>,
    /// Of the second posture's actuators, in actuator order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub second: Option<Vec<String>>,
    /// Of the distance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distance: Option<String>,
    /// Of the height above the plane.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height: Option<String>,
    /// Of the sensed joints, in their order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joints: Option<Vec<String>>,
    /// Of the target's name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target: Option<String>,
    /// Of the fixed point's name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub point: Option<String>,
    /// Of the plane's name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plane: Option<String>,
    /// Of the gauge's name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gauge: Option<String>,
    /// Of the samples' weights.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weight: Option<String>,
}

impl ColumnsDrawing {
    /// Whether no column of a pose has a name of its own.
    fn names_no_pose(&self) -> bool {
        self.position.is_none() && self.rotation.is_none() && self.quaternion.is_none()
    }

    /// Refuses a column that is to hold two values.
    fn check_distinct(&self, at: &Place<'_>) -> Result<(), FileError> {
        let mut named: Vec<&String> = self
            .actuators
            .iter()
            .flatten()
            .chain(self.position.iter().flatten())
            .chain(self.rotation.iter().flatten())
            .chain(self.quaternion.iter().flatten())
            .chain(self.second.iter().flatten())
            .chain(self.joints.iter().flatten())
            .chain([&self.distance, &self.height, &self.target].into_iter().flatten())
            .chain([&self.point, &self.plane, &self.gauge, &self.weight].into_iter().flatten())
            .collect();
        named.sort_unstable();
        match named.windows(2).find(|pair| pair.first() == pair.last()).and_then(<[_]>::first) {
            Some(twice) => Err(at.error(Fault::ColumnTwice(quoted(twice)))),
            None => Ok(()),
        }
    }
}

/// Where in a row everything stands.
#[derive(Clone, Debug, Default)]
pub(super) struct Layout {
    pub actuators: Vec<usize>,
    pub position: Option<[usize; 3]>,
    pub rotation: Option<[usize; 3]>,
    pub quaternion: Option<[usize; 4]>,
    pub second: Vec<usize>,
    pub distance: Option<usize>,
    pub height: Option<usize>,
    pub joints: Vec<usize>,
    /// Columns of names: target, point, plane, gauge.
    pub names: [Option<usize>; 4],
    pub weight: Option<usize>,
    /// Columns that must hold a text for the row to count.
    pub filter: Vec<(usize, String)>,
}

struct Header<'a> {
    names: Vec<&'a str>,
    at: &'a Place<'a>,
}

impl Header<'_> {
    fn find(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|found| *found == name)
    }

    fn missing(&self, wanted: String) -> FileError {
        let found: Vec<String> = self.names.iter().take(20).map(|name| quoted(name)).collect();
        let more = if self.names.len() > found.len() { "..." } else { "" };
        self.at.error(Fault::NoColumn { wanted, found: format!("{}{more}", found.join(", ")) })
    }

    fn need(&self, name: &str) -> Result<usize, FileError> {
        self.find(name).ok_or_else(|| self.missing(quoted(name)))
    }

    /// All of the columns, or `None` where the first is missing.
    fn group<const N: usize>(&self, names: [&str; N]) -> Result<Option<[usize; N]>, FileError> {
        let mut found = [0; N];
        for (place, name) in found.iter_mut().zip(names) {
            *place = match self.find(name) {
                Some(column) => column,
                None if names.iter().any(|other| self.find(other).is_some()) => self.need(name)?,
                None => return Ok(None),
            };
        }
        Ok(Some(found))
    }

    /// The columns that a problem file names.
    fn named<const N: usize>(&self, names: &[String; N]) -> Result<[usize; N], FileError> {
        let mut found = [0; N];
        for (place, name) in found.iter_mut().zip(names) {
            *place = self.need(name)?;
        }
        Ok(found)
    }

    fn actuators(&self, request: &TableRequest<'_>) -> Result<Vec<usize>, FileError> {
        let wanted = request.actuators.len();
        if let Some(names) = request.columns.and_then(|columns| columns.actuators.as_ref()) {
            if names.len() != wanted {
                let expected = request.actuators.join(", ");
                let fault = Fault::ActuatorCount { found: names.len(), wanted, names: expected };
                return Err(self.at.error(fault));
            }
            return names.iter().map(|name| self.need(name)).collect();
        }
        let by_name = request.actuators.iter().any(|name| self.find(name).is_some());
        let columns = request.actuators.iter().enumerate().map(|(i, name)| {
            let number = format!("q{}", i + 1);
            let column = if by_name { self.find(name) } else { self.find(&number) };
            column.ok_or_else(|| self.missing(format!("{} (or `{number}`)", quoted(name))))
        });
        columns.collect()
    }

    /// A column of one kind of measurement: as the problem file names it, or by our name.
    fn one(&self, own: Option<&String>, name: &str) -> Result<usize, FileError> {
        self.need(own.map_or(name, String::as_str))
    }

    /// A list of columns: as the problem file names them, or by our names.
    fn list(&self, own: Option<&Vec<String>>, names: &[String]) -> Result<Vec<usize>, FileError> {
        let stated = own.map_or(names, Vec::as_slice);
        if stated.len() != names.len() {
            let (found, wanted) = (stated.len(), names.len());
            return Err(self.at.error(Fault::JointCount { found, wanted, names: names.join(", ") }));
        }
        stated.iter().map(|name| self.need(name)).collect()
    }

    /// What further kinds of measurement read.
    fn others(&self, request: &TableRequest<'_>, layout: &mut Layout) -> Result<(), FileError> {
        let (own, wanted) = (request.columns, &request.others);
        if wanted.second {
            let named = |prefix: &str| -> Vec<String> {
                request.actuators.iter().map(|name| format!("{prefix}{name}")).collect()
            };
            let short: Vec<String> = (1..=request.actuators.len()).map(|i| format!("second.q{i}")).collect();
            let by_number = short.iter().any(|name| self.find(name).is_some());
            let ours = if by_number { short } else { named("second.") };
            layout.second = self.list(own.and_then(|c| c.second.as_ref()), &ours)?;
        }
        if wanted.distance {
            layout.distance = Some(self.one(own.and_then(|c| c.distance.as_ref()), "distance")?);
        }
        if wanted.height {
            layout.height = match own.and_then(|c| c.height.as_ref()) {
                Some(name) => Some(self.need(name)?),
                None => self.find("height"),
            };
        }
        if !wanted.joints.is_empty() {
            layout.joints = self.list(own.and_then(|c| c.joints.as_ref()), wanted.joints)?;
        }
        if wanted.names {
            let stated = own.map(|c| [&c.target, &c.point, &c.plane, &c.gauge]);
            for (k, name) in ["target", "point", "plane", "gauge"].into_iter().enumerate() {
                layout.names[k] = match stated.and_then(|stated| stated[k].as_ref()) {
                    Some(own) => Some(self.need(own)?),
                    None => self.find(name),
                };
            }
        }
        Ok(())
    }

    /// Refuses columns that mean nothing, where the table uses our names.
    fn check_known(&self, layout: &Layout) -> Result<(), FileError> {
        let ours = POSITION.iter().chain(&ROTATION).chain(&QUATERNION).chain(&STD);
        let ours: Vec<&str> = ours.copied().collect();
        let unknown = self.names.iter().enumerate().find(|(i, name)| {
            !layout.actuators.contains(i)
                && !layout.second.contains(i)
                && !layout.joints.contains(i)
                && !layout.names.contains(&Some(*i))
                && ![layout.distance, layout.height, layout.weight].contains(&Some(*i))
                && !layout.filter.iter().any(|(column, _)| column == i)
                && !ours.contains(name)
        });
        match unknown {
            None => Ok(()),
            Some((_, name)) => Err(self.at.error(Fault::UnknownColumn {
                found: quoted(name),
                expected:
                    "columns are one per actuator, called `limb.joint` or q1, q2..., then x, y, z and rx, \
                           ry, rz or qw, qx, qy, qz, or what else the kind of measurement reads; data.columns names \
                           others"
                        .into(),
            })),
        }
    }
}

impl Layout {
    /// Finds the columns of `request` in the header.
    pub(super) fn find(
        names: Vec<&str>,
        request: &TableRequest<'_>,
        at: &Place<'_>,
    ) -> Result<Layout, FileError> {
        let mut sorted = names.clone();
        sorted.sort_unstable();
        if let Some(twice) =
            sorted.windows(2).find_map(|pair| (pair.first() == pair.last()).then(|| pair.first()))
        {
            let name = twice.copied().unwrap_or_default();
            return Err(at.error(Fault::TwoColumns(quoted(name))));
        }
        let header = Header { names, at };
        if let Some(columns) = request.columns {
            columns.check_distinct(at)?;
        }
        let mut layout = Layout { actuators: header.actuators(request)?, ..Layout::default() };
        for (name, text) in request.filter.into_iter().flatten() {
            layout.filter.push((header.need(name)?, text.clone()));
        }
        header.others(request, &mut layout)?;
        layout.weight = match request.columns.and_then(|c| c.weight.as_ref()) {
            Some(name) => Some(header.need(name)?),
            None => header.find("weight"),
        };
        // Where only readings are wanted, other columns do no harm.
        let only_readings =
            request.poses == PoseColumns::Ignored && request.others == OtherColumns::default();
        if request.columns.is_none() && !only_readings {
            header.check_known(&layout)?;
        }
        if request.poses == PoseColumns::Ignored {
            return Ok(layout);
        }
        let own = request.columns;
        let ours = POSITION.iter().chain(&ROTATION).chain(&QUATERNION);
        if own.is_none_or(ColumnsDrawing::names_no_pose)
            && !ours.into_iter().any(|name| header.find(name).is_some())
        {
            // Readings alone: planned postures.
            return Ok(layout);
        }
        layout.position = Some(match own.and_then(|columns| columns.position.as_ref()) {
            Some(names) => header.named(names)?,
            None => header.group(POSITION)?.ok_or_else(|| header.missing("`x`, `y`, `z`".into()))?,
        });
        if request.poses == PoseColumns::Position {
            return Ok(layout);
        }
        let rotation = own.and_then(|columns| columns.rotation.as_ref());
        let quaternion = own.and_then(|columns| columns.quaternion.as_ref());
        if rotation.is_none() && quaternion.is_none() {
            layout.rotation = header.group(ROTATION)?;
            layout.quaternion = header.group(QUATERNION)?;
        } else {
            layout.rotation = rotation.map(|names| header.named(names)).transpose()?;
            layout.quaternion = quaternion.map(|names| header.named(names)).transpose()?;
        }
        match (&layout.rotation, &layout.quaternion) {
            (None, None) => Err(at.error(Fault::NoRotation)),
            (Some(_), Some(_)) => Err(at.error(Fault::TwoRotations)),
            _ => Ok(layout),
        }
    }
}
