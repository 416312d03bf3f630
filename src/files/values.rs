//! Values of a joint that a problem file may write in more than one way.

use serde::de::value::SeqAccessDeserializer;
use serde::de::{self, Deserialize, Deserializer, IntoDeserializer, Visitor};
use serde::{Deserialize as DeriveDeserialize, Serialize};
use std::fmt;
use std::marker::PhantomData;

/// One value for a joint, or one per equivalent joint.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum OneOrEach<T> {
    /// One value.
    One(T),
    /// One per equivalent joint, in chain order.
    Each(Vec<T>),
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for OneOrEach<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(OneOrEachVisitor(PhantomData))
    }
}

struct OneOrEachVisitor<T>(PhantomData<T>);

impl<'de, T: Deserialize<'de>> Visitor<'de> for OneOrEachVisitor<T> {
    type Value = OneOrEach<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("one value, or a list with one per axis")
    }

    fn visit_bool<E: de::Error>(self, value: bool) -> Result<Self::Value, E> {
        T::deserialize(value.into_deserializer()).map(OneOrEach::One)
    }

    fn visit_f64<E: de::Error>(self, value: f64) -> Result<Self::Value, E> {
        T::deserialize(value.into_deserializer()).map(OneOrEach::One)
    }

    fn visit_i64<E: de::Error>(self, value: i64) -> Result<Self::Value, E> {
        T::deserialize(value.into_deserializer()).map(OneOrEach::One)
    }

    fn visit_u64<E: de::Error>(self, value: u64) -> Result<Self::Value, E> {
        T::deserialize(value.into_deserializer()).map(OneOrEach::One)
    }

    fn visit_seq<A: de::SeqAccess<'de>>(self, seq: A) -> Result<Self::Value, A::Error> {
        Vec::deserialize(SeqAccessDeserializer::new(seq)).map(OneOrEach::Each)
    }
}

/// Entry of a range as written: a limit, a pair of limits, or `null`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, DeriveDeserialize)]
#[serde(untagged, expecting = "a range is [lowest, highest], or a list with one of them or null per axis")]
pub enum RangeEntry {
    /// A limit, angle or length of the file.
    Limit(f64),
    /// Lowest and highest reading, angle or length of the file.
    Pair([f64; 2]),
    /// No range.
    Open(()),
}

/// Range of a joint: `[lowest, highest]`, or one pair or `null` per equivalent joint.
#[derive(Clone, Debug, PartialEq, Serialize, DeriveDeserialize)]
#[serde(transparent)]
pub struct RangeDrawing(pub Vec<RangeEntry>);

impl RangeDrawing {
    /// Its meaning, unless numbers and pairs are mixed.
    pub(super) fn meaning(&self) -> Option<OneOrEach<Option<[f64; 2]>>> {
        if let [RangeEntry::Limit(low), RangeEntry::Limit(high)] = self.0.as_slice() {
            return Some(OneOrEach::One(Some([*low, *high])));
        }
        let pairs = self.0.iter().map(|entry| match entry {
            RangeEntry::Limit(_) => None,
            RangeEntry::Pair(pair) => Some(Some(*pair)),
            RangeEntry::Open(()) => Some(None),
        });
        pairs.collect::<Option<Vec<_>>>().map(OneOrEach::Each)
    }
}
