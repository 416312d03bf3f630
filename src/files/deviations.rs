//! The deviations of a result as a plain table: a row a link, in units of the result.

use super::result::ResultFile;
use super::summary::Deviation;
use crate::cells::field;

/// CSV: limb, link, rotation (rx, ry, rz) and translation (tx, ty, tz) in the frame of the joint that the link
/// carries, then the standard errors of the six, empty where they are not known. Before the links, without a limb, stand
/// `placement` and `tool_mounting` where base or tool are free, position in place of translation; links deviate beside
/// these.
pub fn deviations_text(result: &ResultFile) -> String {
    let mut text = "limb,link,rx,ry,rz,tx,ty,tz,std_rx,std_ry,std_rz,std_tx,std_ty,std_tz\n".to_owned();
    for (name, mount) in [("placement", &result.placement), ("tool_mounting", &result.tool_mounting)] {
        let Some(mount) = mount else { continue };
        let pose = Deviation { rotation: mount.rotation, translation: mount.position };
        text.push_str(&row("", name, &pose, mount.std.as_ref()));
    }
    for link in &result.links {
        let (deviation, std) = link.own();
        text.push_str(&row(&link.limb, &link.link, deviation, std));
    }
    text
}

fn row(limb: &str, link: &str, deviation: &Deviation, std: Option<&Deviation>) -> String {
    let cells = |d: &Deviation| {
        d.rotation.iter().chain(&d.translation).map(|v| format!(",{v:?}")).collect::<String>()
    };
    let std = std.map_or_else(|| ",".repeat(6), cells);
    format!("{},{}{}{std}\n", field(limb), field(link), cells(deviation))
}
