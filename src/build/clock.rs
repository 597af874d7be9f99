//! What things cost: CPU seconds of the process or of one stage, and the most memory that the process held.

/// CPU seconds (user and system, all threads) of this process so far; 0 where the system does not tell.
#[cfg(unix)]
pub(crate) fn cpu_seconds() -> f64 {
    use nix::sys::resource::{UsageWho, getrusage};
    use nix::sys::time::TimeValLike;
    getrusage(UsageWho::RUSAGE_SELF)
        .map_or(0.0, |usage| (usage.user_time() + usage.system_time()).num_microseconds() as f64 * 1e-6)
}

/// CPU seconds of this process; not told by this system.
#[cfg(not(unix))]
pub(crate) fn cpu_seconds() -> f64 {
    0.0
}

/// CPU seconds of all threads of the pool that the caller is in; 0 where the system does not tell.
#[cfg(unix)]
fn pool_seconds() -> f64 {
    use nix::time::{ClockId, clock_gettime};
    let of_thread = |_: rayon::BroadcastContext<'_>| {
        clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID)
            .map_or(0.0, |time| time.tv_sec() as f64 + time.tv_nsec() as f64 * 1e-9)
    };
    rayon::broadcast(of_thread).iter().sum()
}

/// CPU seconds of a pool; not told by this system.
#[cfg(not(unix))]
fn pool_seconds() -> f64 {
    0.0
}

/// The most bytes that this process has held in memory so far; 0 where the system does not tell.
#[cfg(unix)]
pub(super) fn peak_bytes() -> u64 {
    use nix::sys::resource::{UsageWho, getrusage};
    // Linux and the BSDs count in KiB, macOS in bytes.
    let unit = if cfg!(target_vendor = "apple") { 1 } else { 1024 };
    getrusage(UsageWho::RUSAGE_SELF).map_or(0, |usage| u64::try_from(usage.max_rss()).unwrap_or(0) * unit)
}

/// The most bytes that this process has held; not told by this system.
#[cfg(not(unix))]
pub(super) fn peak_bytes() -> u64 {
    0
}

/// CPU seconds by stage, in the order in which stages began; a stage that begins twice is one. The seconds are those of
/// the pool of threads that the clock is used in: what other actions do at the same time does not count.
#[derive(Clone, Debug, Default)]
pub(crate) struct StageClock {
    stages: Vec<(&'static str, f64)>,
    running: Option<(&'static str, f64)>,
}

impl StageClock {
    /// Ends the running stage and begins `stage`.
    pub(crate) fn begin(&mut self, stage: &'static str) {
        self.end();
        self.running = Some((stage, pool_seconds()));
    }

    /// Ends the running stage.
    pub(crate) fn end(&mut self) {
        let Some((stage, start)) = self.running.take() else { return };
        let seconds = pool_seconds() - start;
        match self.stages.iter_mut().find(|(name, _)| *name == stage) {
            Some((_, sum)) => *sum += seconds,
            None => self.stages.push((stage, seconds)),
        }
    }

    /// The stages so far.
    pub(crate) fn stages(&self) -> &[(&'static str, f64)] {
        &self.stages
    }
}
