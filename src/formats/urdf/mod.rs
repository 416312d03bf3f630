//! URDF: a tree of links and joints, SI units, angles as roll, pitch and yaw about fixed axes
//! (<https://wiki.ros.org/urdf/XML>).

mod read;
mod template;
mod tree;
mod write;

pub use read::read;
pub use template::rewrite;
pub use write::write;

use super::xml::turn;
use crate::lie::Se3;
use nalgebra::Matrix3;

/// `Rz(yaw) Ry(pitch) Rx(roll)`, rad.
fn from_rpy([roll, pitch, yaw]: [f64; 3]) -> Matrix3<f64> {
    turn(2, yaw) * turn(1, pitch) * turn(0, roll)
}

/// Roll, pitch and yaw of a rotation, rad.
///
/// Pitch and roll are read off what remains once the yaw is undone, so that their sum is right where the pitch is
/// 90 degrees and neither has a meaning of its own.
fn to_rpy(r: &Matrix3<f64>) -> [f64; 3] {
    let yaw = r[(1, 0)].atan2(r[(0, 0)]);
    let rest = turn(2, -yaw) * r;
    [(-rest[(1, 2)]).atan2(rest[(1, 1)]), (-rest[(2, 0)]).atan2(rest[(0, 0)]), yaw]
}

/// The element of an origin. Rust's shortest text of a number reads back as the same number.
fn origin_element(origin: &Se3) -> String {
    let text = |v: [f64; 3]| v.map(|v| if v == 0.0 { "0".into() } else { format!("{v:?}") }).join(" ");
    format!("<origin xyz=\"{}\" rpy=\"{}\"/>", text(origin.p.into()), text(to_rpy(&origin.r)))
}

/// Text as it may stand in an attribute.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}
