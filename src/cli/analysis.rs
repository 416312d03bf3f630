//! The analysis in words, and as JSON.

use super::details::digits;
use super::wording::{counted, reason};
use crate::calibration::{Coordinates, Sample};
use crate::design::Observability;
use crate::files::summary::Counts;
use crate::files::{Units, json};
use crate::identify::{Analysis, Likeness};
use crate::model::{Limb, Mechanism};
use crate::problem::Form;
use serde::Serialize;

/// Postures shown at either end.
const SHOWN: usize = 5;

/// An analysis and what it is of.
pub struct Report<'a> {
    /// Name of the problem.
    pub name: &'a str,
    /// Of the file.
    pub units: Units,
    /// The machine.
    pub mechanism: &'a Mechanism,
    /// The postures.
    pub samples: &'a [Sample],
    /// What they are, in words.
    pub what: &'a str,
    /// Where the machine was linearised, in words.
    pub point: String,
    /// What was found.
    pub found: &'a Analysis,
    /// Observability indices, where any direction beats its tolerance.
    pub observability: Option<Observability>,
    /// What the kinds of measurement cannot see.
    pub notes: Vec<String>,
}

#[derive(Serialize)]
struct AnalysisFile<'a> {
    counts: Counts,
    singular_values: &'a [f64],
    at: &'a str,
    structural: Vec<LimbSum>,
    no_first_order_effect: Vec<DirectionEntry>,
    weak: Vec<DirectionEntry>,
    seen_by_many_postures_only: usize,
    postures: Vec<PostureEntry<'a>>,
    near_singular: Vec<NearEntry<'a>>,
    set_aside: Vec<AsideEntry<'a>>,
    observability: Option<Indices>,
    notes: &'a [String],
}

/// Observability indices over the directions that beat the tolerances.
#[derive(Serialize)]
struct Indices {
    directions: usize,
    poses: usize,
    o1: f64,
    o2: f64,
    o3: f64,
    o4: f64,
    o5: f64,
}

impl From<Observability> for Indices {
    fn from(of: Observability) -> Self {
        let Observability { directions, poses, o1, o2, o3, o4, o5 } = of;
        Self { directions, poses, o1, o2, o3, o4, o5 }
    }
}

#[derive(Serialize)]
struct LimbSum {
    limb: String,
    count: usize,
    sum: String,
}

#[derive(Serialize)]
struct DirectionEntry {
    limbs: Vec<String>,
    directions_each: usize,
    words: String,
    /// Smallest and largest change of all readings together, in standard deviations, by one tolerance.
    change: [f64; 2],
}

#[derive(Serialize)]
struct PostureEntry<'a> {
    sample: &'a str,
    leverage: f64,
    bits: f64,
}

#[derive(Serialize)]
struct NearEntry<'a> {
    sample: &'a str,
    singular_values: [f64; 6],
}

#[derive(Serialize)]
struct AsideEntry<'a> {
    sample: &'a str,
    reason: String,
}

/// The analysis as JSON.
pub fn json_text(report: &Report<'_>) -> Result<Vec<u8>, serde_json::Error> {
    let found = report.found;
    let entry = |like: Likeness| DirectionEntry {
        limbs: like.limbs,
        directions_each: like.count,
        words: like.words,
        change: [like.change.0, like.change.1],
    };
    json::text(&AnalysisFile {
        counts: found.counts.into(),
        singular_values: &found.singular_values,
        at: &report.point,
        structural: report.sums(),
        no_first_order_effect: found.unseen_words(report.mechanism).into_iter().map(entry).collect(),
        weak: found.weak_words(report.mechanism).into_iter().map(entry).collect(),
        seen_by_many_postures_only: found.by_many,
        postures: found
            .postures
            .iter()
            .map(|p| PostureEntry { sample: &p.name, leverage: p.leverage, bits: p.bits })
            .collect(),
        near_singular: found
            .near_singular
            .iter()
            .map(|near| NearEntry { sample: &near.name, singular_values: near.singular_values })
            .collect(),
        set_aside: found
            .set_aside
            .iter()
            .map(|s| AsideEntry { sample: &s.name, reason: reason(&s.reason, report.units) })
            .collect(),
        observability: report.observability.map(Indices::from),
        notes: &report.notes,
    })
}

impl Report<'_> {
    /// The analysis for people.
    pub fn words(&self) -> String {
        let (found, mechanism) = (self.found, self.mechanism);
        let (r, p) = mechanism.joint_counts();
        let rows: usize = self.samples.iter().map(|sample| sample.measurement.rows()).sum();
        let mut text = format!(
            "{}: {}, {r} angular and {p} prismatic joints, {} actuated; {} {}, {rows} readings\n\n",
            self.name,
            counted(mechanism.limbs.len(), "limb"),
            mechanism.actuator_count(),
            self.samples.len(),
            self.what,
        );
        let counts = found.counts;
        text.push_str(&format!(
            "{:>5}  structural: combinations of link deviations that no pose is blind to by the kind of joints\n",
            counts.structural
        ));
        for limb in self.sums() {
            text.push_str(&format!("         {}: {} = {}\n", limb.limb, limb.count, limb.sum));
        }
        if !mechanism.instrument.is_empty() {
            text.push_str(&format!(
                "         instrument: {} unknown constants\n",
                mechanism.instrument.len()
            ));
        }
        text.push_str(&format!(
            "{:>5}  first order: rank {} over these postures\n",
            counts.first_order, self.point
        ));
        let unseen = counts.structural - counts.first_order;
        match unseen {
            0 => text.push_str("         every combination has a first-order effect there\n"),
            _ => text.push_str(&format!(
                "         {unseen} combinations have no first-order effect there; they appear once the machine \
                 deviates:\n"
            )),
        }
        push(&mut text, found.unseen_words(mechanism), false);
        text.push_str(&format!(
            "{:>5}  practical: singular values above 1 {}, where these readings know more than the tolerances\n",
            counts.practical, self.point
        ));
        if found.by_many > 0 {
            text.push_str(&format!(
                "         {} of them only many postures together show: one tolerance moves every single pose by less \
                 than its noise\n",
                found.by_many
            ));
        }
        let weak = counts.first_order - counts.practical;
        if weak > 0 {
            text.push_str(&format!(
                "         {weak} {} weak (singular values up to 1): one tolerance along each of these moves every \
                 single pose by less\n         than its noise (change of all readings together in brackets, in \
                 standard deviations):\n",
                if weak == 1 { "is" } else { "are" }
            ));
            push(&mut text, found.weak_words(mechanism), true);
        }
        for note in &self.notes {
            text.push_str(&format!("       {note}\n"));
        }
        self.push_postures(&mut text);
        text.push_str(&format!(
            "\nwhitened singular values (signal-to-noise ratio of one tolerance), {}:\n",
            self.point
        ));
        for chunk in found.singular_values.chunks(10) {
            let line: Vec<String> = chunk.iter().map(|s| format!("{s:9.3e}")).collect();
            text.push_str(&format!("  {}\n", line.join(" ")));
        }
        if let Some(of) = self.observability {
            text.push_str(&format!(
                "\nobservability over the {} values above 1 ({} poses): O1 {:.4}, O2 {:.3e}, O3 {:.4}, O4 {:.3e}, O5 {:.4}\n",
                of.directions, of.poses, of.o1, of.o2, of.o3, of.o4, of.o5
            ));
        }
        text
    }

    fn push_postures(&self, text: &mut String) {
        let found = self.found;
        let ranked = found.ranked();
        text.push_str("\npostures by what they add to the others (information in bits, leverage):\n");
        let line = |p: &crate::identify::PostureInformation| {
            format!("  {:24} {:>8} bits {:>8}\n", p.name, digits(p.bits), digits(p.leverage))
        };
        ranked.iter().take(SHOWN).for_each(|p| text.push_str(&line(p)));
        if ranked.len() > 2 * SHOWN {
            text.push_str("  ...\n");
        }
        let last = ranked.len().saturating_sub(SHOWN).max(SHOWN.min(ranked.len()));
        ranked[last..].iter().for_each(|p| text.push_str(&line(p)));
        let idle: Vec<&str> = found.idle().into_iter().map(|p| p.name.as_str()).collect();
        text.push_str(&match idle.len() {
            0 => "  none adds next to nothing (less than a tenth of the median)\n".to_owned(),
            n => format!(
                "  {n} add next to nothing (less than a tenth of the median): {}{}\n",
                idle.iter().take(2 * SHOWN).copied().collect::<Vec<_>>().join(", "),
                if n > 2 * SHOWN { ", ..." } else { "" }
            ),
        });
        for near in &found.near_singular {
            text.push_str(&format!(
                "  {} is nearly singular: the wrench matrix has singular values {:.2e} to {:.2e}\n",
                near.name, near.singular_values[0], near.singular_values[5]
            ));
        }
        for aside in &found.set_aside {
            text.push_str(&format!(
                "  {} takes no part: {}\n",
                aside.name,
                reason(&aside.reason, self.units)
            ));
        }
    }

    /// Per limb, its part of the structural count and how it comes about.
    fn sums(&self) -> Vec<LimbSum> {
        let coordinates = Coordinates::new(self.mechanism, Form::Minimal);
        let counts = coordinates.structural_counts(self.mechanism);
        let limbs = self.mechanism.limbs.iter().zip(&coordinates.limbs).zip(counts);
        limbs
            .map(|((limb, own), count)| {
                let (components, free) = (own.sigma.len(), own.free.len());
                let sum = match components - free {
                    0 => general_sum(limb),
                    held => format!(
                        "{components} components - {held} held - {} that poses cannot tell apart (nothing held: {})",
                        free - count,
                        general_sum(limb)
                    ),
                };
                LimbSum { limb: limb.name.clone(), count, sum }
            })
            .collect()
    }
}

/// `4r + 2p + 6 - m` of a limb.
fn general_sum(limb: &Limb) -> String {
    let angular = limb.joints.iter().filter(|joint| joint.motion.is_angular()).count();
    let prismatic = limb.joints.len() - angular;
    let sum = format!("4*{angular} + 2*{prismatic} + 6 - {} passive", limb.passive_count());
    match limb.joints.iter().filter(|joint| joint.sensed).count() {
        0 => sum,
        sensed => format!("{sum} + {sensed} sensed"),
    }
}

fn push(text: &mut String, groups: Vec<Likeness>, with_change: bool) {
    for like in groups {
        let place = match like.limbs.as_slice() {
            [] => "across limbs: ".to_owned(),
            [one] => format!("in {one}: "),
            many => format!("in each of {}: ", many.join(", ")),
        };
        let count = if like.count > 1 { format!(" ({} directions)", like.count) } else { String::new() };
        let change = match (with_change, like.change) {
            (false, _) => String::new(),
            (true, (low, high)) if high - low < 0.005 => format!(" [{high:.2}]"),
            (true, (low, high)) => format!(" [{low:.2} to {high:.2}]"),
        };
        text.push_str(&format!("           {place}{}{count}{change}\n", like.words));
    }
}
