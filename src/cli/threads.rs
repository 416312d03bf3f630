//! How many threads a run uses.

use std::thread::available_parallelism;

/// More threads than this on each processor only wait for each other, and the system may not have so many.
const PER_PROCESSOR: usize = 4;

/// Makes the threads that the run shares: as many as `RAYON_NUM_THREADS` says, within reason, or one a processor.
pub fn prepare() {
    let processors = available_parallelism().map_or(1, usize::from);
    let asked = std::env::var("RAYON_NUM_THREADS").ok().and_then(|text| text.trim().parse().ok());
    let threads = match asked {
        None | Some(0) => processors,
        Some(threads) => threads.min(PER_PROCESSOR * processors),
    };
    // Fails where a program that uses the library has made its threads already: those serve.
    let _ = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
}
