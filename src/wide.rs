//! Vector instructions of the processor at hand.

use std::ops::{Add, Mul, Sub};
use std::sync::LazyLock;

/// Runs `work` compiled for the widest vector instructions that this processor has and that stay exact: no result
/// depends on which they are. Only what is inlined into `work` gains. Leaves the registers [`narrow`].
#[inline(always)]
pub fn wide<T>(work: impl FnOnce() -> T) -> T {
    let done = ARCH.dispatch(work);
    narrow();
    done
}

/// Which vector instructions there are, asked for once.
static ARCH: LazyLock<pulp::Arch> = LazyLock::new(pulp::Arch::new);

/// Empties the wide halves of the vector registers, in one instruction.
///
/// Kernels of faer leave them filled, and on many processors code for narrow registers, which is all that is not in
/// [`wide`], then waits for halves that it does not use: up to six times as long (measured), until they are emptied.
/// To be called before such code runs for long.
#[inline(always)]
pub fn narrow() {
    #[cfg(target_arch = "x86_64")]
    if let Some(v3) = *HALVES {
        v3.avx._mm256_zeroupper();
    }
}

/// The wide registers, where there are any.
#[cfg(target_arch = "x86_64")]
static HALVES: LazyLock<Option<pulp::x86::V3>> = LazyLock::new(pulp::x86::V3::try_new);

/// A number, or some side by side with which vector instructions do the same.
pub trait Lanes: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// The same number in all lanes.
    fn splat(value: f64) -> Self;

    /// `f` of each lane and that of `other`.
    fn with(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self;

    /// `f` of each lane.
    #[inline(always)]
    fn map(self, f: impl Fn(f64) -> f64) -> Self {
        self.with(self, |a, _| f(a))
    }
}

impl Lanes for f64 {
    #[inline(always)]
    fn splat(value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn with(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        f(self, other)
    }
}

/// Four numbers, as many as vector instructions take at once.
#[derive(Clone, Copy, Debug, Default)]
pub struct Four(pub [f64; 4]);

impl Lanes for Four {
    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self([value; 4])
    }

    #[inline(always)]
    fn with(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        Self(std::array::from_fn(|i| f(self.0[i], other.0[i])))
    }
}

impl Add for Four {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.with(other, |a, b| a + b)
    }
}

impl Sub for Four {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.with(other, |a, b| a - b)
    }
}

impl Mul for Four {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.with(other, |a, b| a * b)
    }
}
