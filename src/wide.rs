//! Vector instructions of the processor at hand.

/// Runs `work` compiled for the widest vector instructions that this processor has and that stay exact: no result
/// depends on which they are. Only what is inlined into `work` gains.
#[inline(always)]
pub fn wide<T>(work: impl FnOnce() -> T) -> T {
    pulp::Arch::new().dispatch(work)
}
