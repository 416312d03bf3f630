//! The machine that runs: what it is called, and how much memory the process has had.

use std::fs;

/// Where and how runs are made.
#[derive(Clone, Debug)]
pub struct Machine {
    /// System, architecture and processor.
    pub name: String,
    /// Runs at a time.
    pub threads: usize,
}

impl Machine {
    /// This machine, with as many runs at a time as the thread pool has threads.
    pub fn here() -> Self {
        let mut name = format!("{} {}", std::env::consts::OS, std::env::consts::ARCH);
        let about = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let model = about.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
        if let Some((_, model)) = model {
            name.push_str(", ");
            name.push_str(model.trim());
        }
        Self { name, threads: rayon::current_num_threads().max(1) }
    }
}

/// Largest resident memory of the process so far, bytes; `None` where the system does not say.
pub fn peak_memory() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kilobytes| 1024 * kilobytes)
}
