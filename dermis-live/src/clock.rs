//! The host's clock.
//!
//! ```
//! let (first, second) = (dermis_live::clock::now(), dermis_live::clock::now());
//! assert!(second >= first);
//! ```

use dermis::pipeline::Timestamp;
use std::sync::{Mutex, PoisonError};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

/// The current time, never earlier than a returned time. After the system clock is set back, this clock runs 5 % slower
/// until the system clock has caught up; when it is set forward, this clock follows immediately.
pub fn now() -> Timestamp {
    static LAST: Mutex<Option<Reading>> = Mutex::new(None);
    let mut last = LAST.lock().unwrap_or_else(PoisonError::into_inner);
    let at = Instant::now();
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let system_ns = u64::try_from(since.as_nanos()).unwrap_or(u64::MAX);
    let unix_ns = last.map_or(system_ns, |last| last.next_ns(system_ns, at));
    *last = Some(Reading { unix_ns, at });
    Timestamp { unix_ns }
}

/// The last returned time. Tracking and the baseline use this clock: its rate must stay nearly constant, whatever
/// happens to the system clock.
#[derive(Debug, Clone, Copy)]
struct Reading {
    unix_ns: u64,
    at: Instant,
}

impl Reading {
    /// The rate while the system clock, which was set back, catches up.
    const SLOWED: f64 = 0.95;

    /// The next time when the system clock shows `system_ns`.
    fn next_ns(self, system_ns: u64, at: Instant) -> u64 {
        let least = at.saturating_duration_since(self.at).mul_f64(Self::SLOWED);
        system_ns.max(Timestamp { unix_ns: self.unix_ns }.after(least).unix_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    /// The time at each hundredth of a second, for a system clock that is set by `step_s` after one second.
    fn times_s(step_s: f64, seconds: f64) -> Vec<f64> {
        let (start, mut last) = (Instant::now(), None::<Reading>);
        let system_s = |time_s: f64| 1e6 + time_s + if time_s < 1.0 { 0.0 } else { step_s };
        (0..(seconds * 100.0) as u64)
            .map(|index| {
                let time_s = index as f64 * 0.01;
                let (at, system_ns) = (start + Duration::from_secs_f64(time_s), (system_s(time_s) * 1e9) as u64);
                let unix_ns = last.map_or(system_ns, |last| last.next_ns(system_ns, at));
                last = Some(Reading { unix_ns, at });
                unix_ns as f64 * 1e-9 - 1e6
            })
            .collect()
    }

    #[test]
    fn a_clock_that_is_set_back_makes_time_neither_stand_nor_run_back() {
        let times = times_s(-2.0, 60.0);
        for pair in times.windows(2) {
            let step_s = pair[1] - pair[0];
            assert!((0.0094..0.0101).contains(&step_s), "{step_s} s in a hundredth");
        }
        // 2 s are caught up after 40 s at a rate difference of one twentieth.
        assert!((times[3900] - 37.0).abs() > 0.05 && (times[5000] - 48.0).abs() < 1e-3, "{} s", times[5000]);
    }

    #[test]
    fn a_clock_that_is_set_forward_is_followed_immediately() {
        let times = times_s(3600.0, 2.0);
        assert!((times[99] - 0.99).abs() < 1e-6 && (times[100] - 3601.0).abs() < 1e-6);
    }
}
