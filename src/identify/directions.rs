//! What cannot be seen, in the words of limbs and joints.

use super::sparse::Support;
use crate::calibration::Coordinates;
use crate::lie::Se3;
use crate::model::Mechanism;
use crate::problem::Form;
use nalgebra::Vector3;

/// Cosine from which two lines count as one direction.
const PARALLEL: f64 = 1.0 - 1e-9;
/// Distance from a joint's point, relative to the tool's, within which a line of rotation goes through it.
const CENTRED: f64 = 1e-6;
/// Parts of a combination below this share of the largest are not spelled out.
const NEGLIGIBLE: f64 = 0.01;
/// Parts of a combination that are spelled out.
const SPELLED: usize = 6;

/// A combination of link deviations.
#[derive(Clone, Debug)]
pub struct Direction {
    /// Deviations of all links, six a link, in tolerances; a unit vector.
    pub deviations: Vec<f64>,
    /// `|J u|`: change of all readings together, in standard deviations, where the machine moves by one tolerance along
    /// it.
    pub change: f64,
}

/// Directions that are alike but for the limb.
#[derive(Clone, Debug, PartialEq)]
pub struct Likeness {
    /// Limbs that have it; empty where it runs over several limbs.
    pub limbs: Vec<String>,
    /// How many directions in each.
    pub count: usize,
    /// What it is.
    pub words: String,
    /// Smallest and largest change among them, in standard deviations.
    pub change: (f64, f64),
}

/// The machine's frames at home, by which directions are named.
pub struct Naming<'a> {
    mechanism: &'a Mechanism,
    /// Per limb, the frame behind each link at home.
    frames: Vec<Vec<Se3>>,
    /// Per limb, the tolerance of each component, rad and m.
    sigma: Vec<Vec<f64>>,
}

/// The rotation or the translation of one link.
#[derive(Clone, Copy, Debug)]
struct Part {
    limb: usize,
    link: usize,
    rotation: bool,
    /// In {S} at home, tolerances.
    vector: Vector3<f64>,
}

impl<'a> Naming<'a> {
    /// Of the machine as drawn.
    pub fn new(mechanism: &'a Mechanism) -> Self {
        let nominal = mechanism.nominal();
        let frames = (0..mechanism.limbs.len()).map(|i| nominal.home_frames(i)).collect();
        let coordinates = Coordinates::new(mechanism, Form::Complete);
        let sigma = coordinates.limbs.into_iter().map(|limb| limb.sigma).collect();
        Self { mechanism, frames, sigma }
    }

    /// Where combinations of few components are sought, in complete coordinates: rotation of every link, translation of
    /// every link, every link, every pair of neighbours, every limb.
    pub fn supports(&self, coordinates: &Coordinates) -> Vec<Support> {
        let (mut turns, mut shifts) = (Vec::new(), Vec::new());
        let (mut whole, mut pairs, mut limbs) = (Vec::new(), Vec::new(), Vec::new());
        for (i, limb) in coordinates.limbs.iter().enumerate() {
            let at = |wanted: &dyn Fn(usize) -> bool| -> Vec<usize> {
                let places = limb.free.iter().enumerate().filter(|(_, component)| wanted(**component));
                places.map(|(place, _)| limb.offset + place).collect()
            };
            limbs.push(Support { members: at(&|_| true), preferred: Vec::new() });
            for link in 0..self.frames[i].len() {
                for half in 0..2 {
                    let members = at(&|c| c / 3 == 2 * link + half);
                    let preferred = if members.len() == 3 { self.preferred(i, link) } else { Vec::new() };
                    if half == 0 { &mut turns } else { &mut shifts }.push(Support { members, preferred });
                }
                whole.push(Support { members: at(&|c| c / 6 == link), preferred: Vec::new() });
                pairs.push(Support {
                    members: at(&|c| c / 6 == link || c / 6 == link + 1),
                    preferred: Vec::new(),
                });
            }
        }
        let mut all = [turns, shifts, whole, pairs, limbs].concat();
        all.retain(|support| !support.members.is_empty());
        all
    }

    /// Directions in a link's frame that have a name: the axes of the limb's joints, those square to the link's own axis
    /// first, and that one last.
    fn preferred(&self, limb: usize, link: usize) -> Vec<Vec<f64>> {
        let turn = self.frames[limb][link].r.transpose();
        let axes = self.mechanism.limbs[limb].joints.iter().zip(&self.frames[limb]);
        let mut named: Vec<Vector3<f64>> = axes.map(|(_, frame)| turn * frame.r.column(2)).collect();
        named.retain(|v| v.z.abs() < 1.0 - 1e-9);
        named.sort_by_key(|v| v.z.abs() > 1e-9);
        named.push(Vector3::z());
        named.iter().map(|v| v.iter().copied().collect()).collect()
    }

    /// The direction's rotations and translations, link by link.
    fn parts(&self, direction: &Direction) -> Vec<Part> {
        let mut parts = Vec::new();
        let mut numbers = direction.deviations.chunks_exact(3);
        for (limb, frames) in self.frames.iter().enumerate() {
            for (link, frame) in frames.iter().enumerate() {
                for rotation in [true, false] {
                    if let Some([x, y, z]) = numbers.next() {
                        let vector = frame.r * Vector3::new(*x, *y, *z);
                        parts.push(Part { limb, link, rotation, vector });
                    }
                }
            }
        }
        let largest = parts.iter().fold(0.0_f64, |m, part| m.max(part.vector.norm()));
        parts.retain(|part| part.vector.norm() > NEGLIGIBLE * largest);
        parts
    }

    /// Directions in words, those that are alike but for the limb together, in the order of the first of each.
    pub fn grouped(&self, directions: &[Direction]) -> Vec<Likeness> {
        let all: Vec<(Vec<Part>, f64)> = directions.iter().map(|d| (self.parts(d), d.change)).collect();
        let mut groups: Vec<Likeness> = Vec::new();
        let mut told = vec![false; all.len()];
        for (k, (parts, change)) in all.iter().enumerate() {
            if told[k] {
                continue;
            }
            // Both or all three directions of one link are told at once.
            let centre = self.centre(parts);
            let same = |other: &[Part]| match (parts.as_slice(), other) {
                _ if centre.is_some() => centre == self.centre(other),
                ([a], [b]) => (a.limb, a.link, a.rotation) == (b.limb, b.link, b.rotation),
                _ => false,
            };
            let mut mates = vec![k];
            mates.extend((k + 1..all.len()).filter(|&j| same(&all[j].0)));
            mates.iter().for_each(|&j| told[j] = true);
            let changes = mates.iter().map(|&j| all[j].1);
            let range = changes.fold((*change, *change), |(low, high), c| (low.min(c), high.max(c)));
            let own = |part: &Part| part.limb == parts[0].limb;
            let (limbs, words) = match (parts.first(), centre) {
                (None, _) => continue,
                (Some(part), Some((_, joint))) => {
                    let name = &self.mechanism.limbs[part.limb].joints[joint].name;
                    let name = name.split_once('.').map_or(name.as_str(), |(joint, _)| joint);
                    (vec![part.limb], format!("rotation of the tool about the centre of {name}"))
                }
                (Some(part), None) if mates.len() > 1 => {
                    let vectors: Vec<Vector3<f64>> = mates.iter().map(|&j| all[j].0[0].vector).collect();
                    (vec![part.limb], self.several(part, &vectors))
                }
                (Some(part), None) if parts.iter().all(own) => {
                    (vec![part.limb], self.combination(parts, false))
                }
                (Some(_), None) => (Vec::new(), self.combination(parts, true)),
            };
            let limbs: Vec<String> = limbs.iter().map(|&i| self.mechanism.limbs[i].name.clone()).collect();
            let alike = |group: &&mut Likeness| {
                group.words == words
                    && group.count == mates.len()
                    && !limbs.is_empty()
                    && !group.limbs.is_empty()
            };
            match groups.iter_mut().find(alike) {
                Some(group) => {
                    group.limbs.extend(limbs);
                    group.change = (group.change.0.min(range.0), group.change.1.max(range.1));
                }
                None => groups.push(Likeness { limbs, count: mates.len(), words, change: range }),
            }
        }
        groups
    }

    /// The limb, and the joint through whose point the tool turns, where the parts are just that.
    fn centre(&self, parts: &[Part]) -> Option<(usize, usize)> {
        let first = parts.first()?;
        if !self.is_tool(first) || parts.iter().any(|p| (p.limb, p.link) != (first.limb, first.link)) {
            return None;
        }
        let (mut w, mut v) = (Vector3::zeros(), Vector3::zeros());
        for part in parts {
            let unit = self.sigma[part.limb][6 * part.link + if part.rotation { 0 } else { 3 }];
            *if part.rotation { &mut w } else { &mut v } += part.vector * unit;
        }
        let frames = &self.frames[first.limb];
        let tool = frames[first.link].p;
        // The last joint of several that share a point names it.
        let found = (0..first.link).rev().find(|&j| {
            let lever = tool - frames[j].p;
            (v - w.cross(&lever)).norm() < CENTRED * w.norm() * lever.norm()
        })?;
        Some((first.limb, found))
    }

    /// Two or three directions of one link's rotation or translation.
    fn several(&self, part: &Part, vectors: &[Vector3<f64>]) -> String {
        let axis = self.frames[part.limb][part.link].r.column(2).into_owned();
        let square = vectors.iter().all(|v| v.dot(&axis).abs() < 1e-6 * v.norm());
        let preposition = if part.rotation { "about" } else { "along" };
        let which = match (vectors.len(), square) {
            (2, true) if self.is_tool(part) => "the x and the y axis of the tool frame".to_owned(),
            (2, true) => "both directions square to its axis".to_owned(),
            (3, _) => "any direction".to_owned(),
            _ => {
                let named: Vec<String> = vectors.iter().map(|v| self.line(part, v).0).collect();
                named.join(&format!(" and {preposition} "))
            }
        };
        format!("{} {preposition} {which}", self.what(part))
    }

    /// A combination, largest part first; the others relative to it.
    fn combination(&self, parts: &[Part], with_limbs: bool) -> String {
        let mut parts = parts.to_vec();
        parts.sort_by(|a, b| {
            let order = b.vector.norm().total_cmp(&a.vector.norm());
            if (a.vector.norm() / b.vector.norm() - 1.0).abs() < 1e-6 {
                std::cmp::Ordering::Equal
            } else {
                order
            }
        });
        let single = parts.len() == 1;
        // Sizes relative to the largest part, which counts as positive.
        let first = parts.first().map_or(1.0, |part| self.line(part, &part.vector).1 * part.vector.norm());
        let words = parts.iter().enumerate().map(|(k, part)| {
            let (line, sign) = self.line(part, &part.vector);
            let ratio = sign * part.vector.norm() / first;
            let size = match (single, k) {
                (true, _) => String::new(),
                (false, 0) => format!("{ratio:.2} "),
                _ => format!("{} {:.2} ", if ratio < 0.0 { "-" } else { "+" }, ratio.abs()),
            };
            let limb = &self.mechanism.limbs[part.limb].name;
            let limb = if with_limbs { format!("{limb}, ") } else { String::new() };
            let preposition = if part.rotation { "about" } else { "along" };
            format!("{size}{limb}{} {preposition} {line}", self.what(part))
        });
        let words: Vec<String> = words.collect();
        match words.len().saturating_sub(SPELLED) {
            0 => words.join(" "),
            more => format!("{} and {more} smaller parts", words[..SPELLED].join(" ")),
        }
    }

    fn is_tool(&self, part: &Part) -> bool {
        part.link == self.mechanism.limbs[part.limb].joints.len()
    }

    /// What moves: a joint's axis, with all behind it, or the tool.
    fn what(&self, part: &Part) -> String {
        let kind = if part.rotation { "rotation" } else { "translation" };
        if self.is_tool(part) {
            return format!("{kind} of the tool");
        }
        let name = &self.mechanism.limbs[part.limb].joints[part.link].name;
        let ordinal = |n: &str| match n {
            "1" => Some("first"),
            "2" => Some("second"),
            "3" => Some("third"),
            _ => None,
        };
        match name.rsplit_once('.').and_then(|(joint, n)| Some((joint, ordinal(n)?))) {
            Some((joint, ordinal)) => format!("{kind} of {joint}'s {ordinal} axis"),
            None => format!("{kind} of {name}'s axis"),
        }
    }

    /// A line in {S} at home, in words, and whether the vector points along it (1) or against it (-1).
    fn line(&self, part: &Part, vector: &Vector3<f64>) -> (String, f64) {
        let unit = vector.normalize();
        let is = |axis: &Vector3<f64>| unit.dot(axis).abs() > PARALLEL;
        let frames = &self.frames[part.limb];
        let axis = |j: usize| frames[j].r.column(2).into_owned();
        let joints = &self.mechanism.limbs[part.limb].joints;
        if !self.is_tool(part) && is(&axis(part.link)) {
            return ("itself".into(), unit.dot(&axis(part.link)).signum());
        }
        // The nearest joint that lies on the line names it.
        let mut order: Vec<usize> = (0..joints.len()).collect();
        order.sort_by_key(|j| j.abs_diff(part.link));
        if let Some(j) = order.into_iter().find(|&j| is(&axis(j))) {
            return (format!("the axis of {}", joints[j].name), unit.dot(&axis(j)).signum());
        }
        let ours = [("x", Vector3::x()), ("y", Vector3::y()), ("z", Vector3::z())];
        if let Some((name, axis)) = ours.iter().find(|(_, axis)| is(axis)) {
            return (format!("{name} of {{S}}"), unit.dot(axis).signum());
        }
        let sign = unit.iter().find(|v| v.abs() > 1e-6).map_or(1.0, |v| v.signum());
        let [x, y, z] = [0, 1, 2].map(|i| {
            let rounded = (100.0 * sign * unit[i]).round() / 100.0;
            if rounded == 0.0 { 0.0 } else { rounded }
        });
        (format!("[{x:.2}, {y:.2}, {z:.2}] in {{S}}"), sign)
    }
}
