//! The machine at home, with its deviations magnified.

use super::study::Study;
use crate::files::Model;
use crate::lie::Se3;
use crate::model::{Geometry, Mechanism};
use crate::render::drawing::Stroke;
use crate::render::{Drawing, Part, Section};
use nalgebra::Vector3;

/// Size of the largest displacement as drawn, in machine sizes.
const DISPLACEMENT: f64 = 0.08;
/// Half length of a joint's axis, in machine sizes.
const AXIS: f64 = 0.09;

/// A drawing.
pub(super) fn section(study: &Result<Study, String>, model: &Model) -> Section {
    let section = Section::new("The machine");
    match study {
        Ok(study) => {
            let drawing = drawn(&study.placed, &study.placed.nominal(), Some(&study.geometry));
            section.with(Part::Drawing(drawing))
        }
        Err(why) => section
            .with(Part::Text(format!(
                "As identified only; where it deviates from the drawing needs the problem: {why}."
            )))
            .with(Part::Drawing(drawn(&model.mechanism, &model.mechanism.nominal(), None))),
    }
}

/// The largest of 1, 2, 5 times a power of ten, at least 1, that keeps `largest` within its share of `size`.
fn magnification(largest: f64, size: f64) -> f64 {
    let wanted = DISPLACEMENT * size / largest;
    if !wanted.is_finite() || wanted < 1.0 {
        return 1.0;
    }
    let power = 10_f64.powf(wanted.log10().floor());
    let found = [5.0, 2.0, 1.0].into_iter().find(|m| m * power <= wanted);
    found.unwrap_or(1.0) * power
}

fn drawn(mechanism: &Mechanism, nominal: &Geometry, found: Option<&Geometry>) -> Drawing {
    let size = mechanism.characteristic_length();
    let frames = |geometry: &Geometry| -> Vec<Vec<Se3>> {
        (0..geometry.limbs.len()).map(|i| geometry.home_frames(i)).collect()
    };
    let nominal = frames(nominal);
    let deviating = found.map(frames);
    let pairs = || nominal.iter().flatten().zip(deviating.iter().flatten().flatten());
    let largest = pairs().map(|(a, b)| (b.p - a.p).norm()).fold(0.0, f64::max);
    let times = magnification(largest, size);
    let mut drawing =
        Drawing { id: "machine".into(), title: "The machine at home".into(), ..Drawing::default() };
    let far = |p: Vector3<f64>| -> [f64; 3] { p.into() };
    let outline = |drawing: &mut Drawing, stroke: Stroke, limbs: &[Vec<Se3>]| {
        for limb in limbs {
            drawing.lines.push((stroke, limb.iter().map(|frame| far(frame.p)).collect()));
        }
        // Base and platform, where limbs span them.
        if limbs.len() > 2 {
            let ring = |of: &dyn Fn(&Vec<Se3>) -> Option<Vector3<f64>>| -> Vec<[f64; 3]> {
                let points: Vec<[f64; 3]> = limbs.iter().filter_map(of).map(far).collect();
                points.iter().chain(points.first()).copied().collect()
            };
            drawing.lines.push((stroke, ring(&|limb| limb.first().map(|frame| frame.p))));
            drawing.lines.push((stroke, ring(&|limb| limb.iter().rev().nth(1).map(|frame| frame.p))));
        }
    };
    let shown: Vec<Vec<Se3>> = match &deviating {
        Some(deviating) => {
            outline(&mut drawing, Stroke::Nominal, &nominal);
            let moved =
                |(a, b): (&Se3, &Se3)| Se3 { r: a.r + (b.r - a.r) * times, p: a.p + (b.p - a.p) * times };
            nominal.iter().zip(deviating).map(|(a, b)| a.iter().zip(b).map(moved).collect()).collect()
        }
        None => nominal.clone(),
    };
    outline(&mut drawing, Stroke::Found, &shown);
    for (limb, (frames, drawn)) in mechanism.limbs.iter().zip(shown.iter().zip(&nominal)) {
        for (joint, frame) in limb.joints.iter().zip(frames) {
            let half = frame.r.column(2) * (AXIS * size);
            drawing.lines.push((Stroke::Axis, vec![far(frame.p - half), far(frame.p + half)]));
            if joint.actuated {
                drawing.dots.push((Stroke::Found, far(frame.p)));
            }
        }
        if let Some(first) = drawn.first() {
            drawing.names.push((limb.name.clone(), far(first.p)));
        }
    }
    if let Some(tool) = nominal.first().and_then(|frames| frames.last()) {
        for i in 0..3 {
            let end = tool.p + tool.r.column(i) * (2.0 * AXIS * size);
            drawing.lines.push((Stroke::Frame(i), vec![far(tool.p), far(end)]));
        }
        drawing.names.push(("tool".into(), far(tool.p)));
    }
    joint_names(mechanism, &nominal, &mut drawing);
    drawing.caption = match found {
        Some(_) => format!(
            "Grey: as drawn. Blue: as identified, displacements and turns magnified {times} times, every joint at its home \
             value; passive joints are not moved to close the loops. Chain lines: joint axes; rings: actuated joints; at \
             the tool x red, y green, z blue. Isometric, z of {{S}} upwards."
        ),
        None => "Blue: as identified, true to scale. Chain lines: joint axes; rings: actuated joints; at the tool x red, y \
                 green, z blue. Isometric, z of {S} upwards."
            .into(),
    };
    drawing
}

/// Names of the joints of the first limb: the others are alike, or too many.
fn joint_names(mechanism: &Mechanism, nominal: &[Vec<Se3>], drawing: &mut Drawing) {
    let (Some(limb), Some(frames)) = (mechanism.limbs.first(), nominal.first()) else { return };
    let mut last = "";
    for (joint, frame) in limb.joints.iter().zip(frames) {
        let name = joint.name.split('.').next().unwrap_or(&joint.name);
        if name != last {
            drawing.names.push((name.to_owned(), frame.p.into()));
        }
        last = name;
    }
}

#[cfg(test)]
mod tests {
    use super::magnification;

    #[test]
    fn deviations_are_magnified_by_round_numbers_and_never_made_smaller() {
        assert_eq!(magnification(1e-3, 1.0), 50.0);
        assert_eq!(magnification(8e-5, 1.0), 1000.0);
        assert_eq!(magnification(3.0, 1.0), 1.0);
        assert_eq!(magnification(0.0, 1.0), 1.0);
    }
}
