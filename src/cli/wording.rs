//! Words that several messages share: numbers with their nouns, lists, and why a posture does not close.

use crate::design::{Reached, Unfit};
use crate::files::Units;
use crate::identify::IdentifyError;
use crate::model::NotClosed;
use crate::model::command::NotReached;
pub use crate::render::text::counted;
use crate::render::text::digits;

/// Names that a list shows before it breaks off.
const SHOWN: usize = 10;

/// The first names, and how many more there are.
pub fn listed<T: AsRef<str>>(names: &[T]) -> String {
    let shown: Vec<&str> = names.iter().take(SHOWN).map(AsRef::as_ref).collect();
    match names.len().saturating_sub(SHOWN) {
        0 => shown.join(", "),
        more => format!("{} and {more} more", shown.join(", ")),
    }
}

/// Why a posture does not close, in units of the file.
pub fn reason(why: &NotClosed, units: Units) -> String {
    match why {
        NotClosed::Apart { rotation, translation, iterations } => format!(
            "the limbs do not meet: {:.3e} {} and {:.3e} {} apart ({})",
            units.from_radians(*rotation),
            units.angle_symbol(),
            units.from_metres(*translation),
            units.length_symbol(),
            counted(*iterations, "Newton step"),
        ),
        other => other.to_string(),
    }
}

/// Why a pose cannot be commanded, in units of the file.
pub fn not_reached(why: &NotReached, units: Units) -> String {
    match why {
        NotReached::Start(why) => {
            format!("the posture from which the pose is sought does not close: {}", reason(why, units))
        }
        NotReached::Away { rotation, translation } => format!(
            "out of reach: the closest posture is {} {} and {} {} away",
            digits(units.from_radians(*rotation), 4),
            units.angle_symbol(),
            digits(units.from_metres(*translation), 4),
            units.length_symbol(),
        ),
        NotReached::OtherMode => why.to_string(),
    }
}

/// Why nothing could be identified, in units of the file.
pub fn not_identified(why: &IdentifyError, units: Units) -> String {
    match why {
        IdentifyError::NoneCloses(first) => {
            format!(
                "no posture closes with the nominal machine (gough check looks for mistakes of units, signs and order); \
                 {}: {}",
                first.name,
                reason(&first.reason, units)
            )
        }
        other => other.to_string(),
    }
}

/// Why a posture cannot be planned, in units of the file.
pub fn unfit(why: &Unfit, units: Units) -> String {
    match why {
        Unfit::NotClosed(why) => reason(why, units),
        other => other.to_string(),
    }
}

/// How many real machines reach the postures of a plan.
pub fn share_reached(reached: &Reached) -> String {
    let Reached { machines, mean, least } = reached;
    if *machines == 0 {
        return "fewer than two machines drawn from the tolerances close at home: which postures real machines reach is not known"
            .into();
    }
    format!(
        "of {machines} machines drawn from the tolerances, none of which chose the postures, {:.1} % reach each posture, \
         {:.1} % the worst one",
        100.0 * mean,
        100.0 * least
    )
}

#[cfg(test)]
mod tests {
    use super::{counted, listed};

    #[test]
    fn one_is_singular_and_long_lists_break_off() {
        assert_eq!([0, 1, 2].map(|n| counted(n, "limb")), ["0 limbs", "1 limb", "2 limbs"]);
        let names: Vec<String> = (1..=12).map(|n| n.to_string()).collect();
        assert_eq!(listed(&names), "1, 2, 3, 4, 5, 6, 7, 8, 9, 10 and 2 more");
        assert_eq!(listed(&names[..2]), "1, 2");
    }
}
