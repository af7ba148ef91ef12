//! One clock for the processes of one machine, and what they take of its processors.

use std::time::Duration;

use tandem_link::Clock;

/// What the system's monotonic clock showed when this process's clock stood at zero, in nanoseconds: the difference of two
/// processes' origins is how far their stamps are apart.
///
/// # Errors
/// Where the system has no such clock for several processes.
#[cfg(unix)]
pub(super) fn origin_ns() -> anyhow::Result<i64> {
    use anyhow::Context as _;
    use nix::time::{ClockId, clock_gettime};

    let clock = Clock::of_process();
    let mut best = None;
    // The quickest of some tries, for one may be interrupted between the two clocks.
    for _ in 0..50 {
        let before = clock.now();
        let system = clock_gettime(ClockId::CLOCK_MONOTONIC).context("the system's monotonic clock")?;
        let took = clock.now().since(before);
        let ours = i64::try_from(before.0 + took / 2).context("a process's age")?;
        #[expect(clippy::useless_conversion, reason = "i32 on some systems")]
        let shown = i64::from(system.tv_sec()) * 1_000_000_000 + i64::from(system.tv_nsec());
        if best.is_none_or(|(quickest, _)| took < quickest) {
            best = Some((took, shown - ours));
        }
    }
    best.map(|(_, origin)| origin).context("a clock")
}

/// What this process has had of the processors until now.
///
/// # Errors
/// Where the system does not tell.
#[cfg(unix)]
pub(super) fn processor_time() -> anyhow::Result<Duration> {
    use anyhow::Context as _;
    use nix::time::{ClockId, clock_gettime};

    let shown = clock_gettime(ClockId::CLOCK_PROCESS_CPUTIME_ID).context("this process's processor time")?;
    Ok(Duration::from(shown))
}

/// See the other one.
///
/// # Errors
/// Always.
#[cfg(not(unix))]
pub(super) fn processor_time() -> anyhow::Result<Duration> {
    anyhow::bail!("this measurement needs a process's processor time, as Linux and macOS tell it")
}

/// See the other one.
///
/// # Errors
/// Always.
#[cfg(not(unix))]
pub(super) fn origin_ns() -> anyhow::Result<i64> {
    let _ = Clock::of_process();
    anyhow::bail!("this measurement needs a monotonic clock that two processes share, as Linux and macOS have")
}
