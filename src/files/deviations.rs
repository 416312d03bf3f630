//! The deviations of a result as a plain table: a row a link, in units of the result.

use super::result::ResultFile;
use crate::cells::field;

/// CSV: limb, link, rotation (rx, ry, rz) and translation (tx, ty, tz) in the frame of the joint that the link
/// carries, then the standard errors of the six, empty where they are not known.
pub fn deviations_text(result: &ResultFile) -> String {
    let mut text = "limb,link,rx,ry,rz,tx,ty,tz,std_rx,std_ry,std_rz,std_tx,std_ty,std_tz\n".to_owned();
    for link in &result.links {
        let cells = |d: &super::summary::Deviation| {
            d.rotation.iter().chain(&d.translation).map(|v| format!(",{v:?}")).collect::<String>()
        };
        let std = link.std.as_ref().map_or_else(|| ",".repeat(6), cells);
        text.push_str(&format!(
            "{},{}{}{std}\n",
            field(&link.limb),
            field(&link.link),
            cells(&link.deviation)
        ));
    }
    text
}
