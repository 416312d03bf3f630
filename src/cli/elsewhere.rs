//! What is said of postures that predictions miss.

use super::details::digits;
use super::wording::{counted, listed};
use crate::files::Units;
use crate::files::elsewhere::ElsewhereEntry;
use crate::identify::{MeasuredElsewhere, UndecidedPosture};
use crate::lie::{Se3, so3};

/// Logarithm of odds that are even.
const LEVEL: f64 = 0.5;
/// Logarithm of odds that a number still tells.
const MOST: f64 = 14.0;

/// Which postures of so many (`word`) were measured elsewhere than the path from home leads, and by how much it misses them.
pub(super) fn words(elsewhere: &[MeasuredElsewhere], of: usize, word: &str, units: Units) -> String {
    let all: Vec<&str> = elsewhere.iter().map(|one| one.name.as_str()).collect();
    let apart = || elsewhere.iter().filter_map(|one| one.apart);
    let length = apart().map(|(_, v)| v).fold(0.0, f64::max);
    let angle = apart().map(|(w, _)| w).fold(0.0, f64::max);
    let (verb, number) = match all.len() {
        1 => ("was", format!("1 of {}", counted(of, word))),
        many => ("were", format!("{many} of {}", counted(of, word))),
    };
    let missed = match apart().count() {
        0 => "does not reach them".to_owned(),
        _ => format!(
            "misses them by up to {} {} and {} {}",
            digits(units.from_metres(length)),
            units.length_symbol(),
            digits(units.from_radians(angle)),
            units.angle_symbol()
        ),
    };
    format!(
        "{number} {verb} measured in another assembly mode than that of home, or on another branch of a limb's joints: the \
         path from home, which predictions follow, {missed}: {}",
        listed(&all)
    )
}

/// What to draw where all postures were measured in another mode.
pub(super) fn cure(home: Option<Se3>, units: Units) -> String {
    let numbers = |v: [f64; 3]| v.map(digits).join(", ");
    let stands = home.map_or(String::new(), |home| {
        let (p, w) = (home.p, so3::log(&home.r));
        format!(
            ": there the tool stands at [{}] {}, rotation vector [{}] {}",
            numbers([p.x, p.y, p.z].map(|v| units.from_metres(v))),
            units.length_symbol(),
            numbers([w.x, w.y, w.z].map(|v| units.from_radians(v))),
            units.angle_symbol()
        )
    });
    format!("; draw the machine at home in the mode that was measured{stands}")
}

/// What is said of a posture that was closed in one of two ways.
pub(super) fn undecided_words(of: &UndecidedPosture) -> String {
    let odds = match of.gain {
        gain if gain.abs() < LEVEL => "explains the data as well".to_owned(),
        gain if gain < 0.0 => {
            format!("explains the data too, with odds of 1 to {}", digits((-gain).exp()))
        }
        gain if gain < MOST => format!("explains the data better, with odds of {} to 1", digits(gain.exp())),
        gain => format!("explains the data better, by {} in chi-square", digits(2.0 * gain)),
    };
    format!(
        "{}: how its loops were closed is not decided: another posture of the same readings {odds}, with another machine; \
         measure more postures like it, or leave it out",
        of.name
    )
}

/// Says on standard error how many samples of a result, whose machine is about to predict, it was stated to miss.
pub(super) fn warn_of_modes(file: &str, elsewhere: Option<ElsewhereEntry>) {
    if let Some(ElsewhereEntry { samples, of }) = elsewhere {
        eprintln!(
            "warning: {file}: {samples} of {} {} measured in another assembly mode or branch than the one that is followed \
             here from home: what is said of such postures is wrong",
            counted(of, "sample"),
            if samples == 1 { "was" } else { "were" }
        );
    }
}
