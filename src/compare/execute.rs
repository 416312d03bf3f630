//! Runs on all cores.

use super::campaign::{Campaign, Cell};
use super::line::RunLine;
use super::machine::Machine;
use super::run::{Stage, run};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Makes the runs of the cells and hands on each line as its run ends, in whatever order; stops at the first error of
/// `done` and returns it.
///
/// As many runs at a time as the thread pool has threads, each on one thread of its own: times are those of one run,
/// and a run does not wait for parts of another.
pub fn execute<E: Send>(
    campaign: &Campaign,
    cells: &[Cell],
    done: impl Fn(RunLine) -> Result<(), E> + Sync,
) -> Result<(), E> {
    let machine = Machine::here();
    let (next, stopped) = (AtomicUsize::new(0), AtomicBool::new(false));
    let failure = Mutex::new(None);
    let work = || {
        while let Some(cell) = cells.get(next.fetch_add(1, Ordering::Relaxed)) {
            if stopped.load(Ordering::Relaxed) {
                return;
            }
            let problem = &campaign.subjects[cell.subject].problem;
            let Some((_, first)) = cell.runs.first() else { continue };
            let stage = Stage::set(problem, first);
            for (contestant, key) in &cell.runs {
                let identifier = campaign.contestants[*contestant].identifier.as_ref();
                let line = run(key.clone(), problem, identifier, &stage, &machine);
                if let Err(why) = done(line) {
                    stopped.store(true, Ordering::Relaxed);
                    let mut failure = failure.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
                    failure.get_or_insert(why);
                    return;
                }
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..machine.threads.min(cells.len()) {
            scope.spawn(|| match rayon::ThreadPoolBuilder::new().num_threads(1).build() {
                Ok(pool) => pool.install(work),
                // Without a pool of its own the run borrows threads from the common one: slower, no less right.
                Err(_) => work(),
            });
        }
    });
    failure.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner()).map_or(Ok(()), Err)
}
