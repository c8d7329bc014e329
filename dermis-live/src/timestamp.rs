//! Moments on the host's clock.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// A moment, in nanoseconds since 1970 (Unix time). In JSON it is that whole number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Timestamp {
    /// Nanoseconds since 1970.
    pub unix_ns: u64,
}

impl Timestamp {
    /// Now. It is never earlier than it was before: where the system's clock is set back, time goes on 5 % slower until that
    /// clock has caught up; where it is set forward, time follows at once.
    pub fn now() -> Self {
        static STEADY: Mutex<Option<Steady>> = Mutex::new(None);
        let mut steady = STEADY.lock().unwrap_or_else(PoisonError::into_inner);
        let at = Instant::now();
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let system_ns = u64::try_from(since.as_nanos()).unwrap_or(u64::MAX);
        let unix_ns = steady.map_or(system_ns, |steady| steady.later_ns(system_ns, at));
        *steady = Some(Steady { unix_ns, at });
        Timestamp { unix_ns }
    }

    /// Seconds since 1970.
    pub fn seconds(self) -> f64 {
        self.unix_ns as f64 * 1e-9
    }

    /// Seconds from `earlier` to this moment; negative where it is later.
    pub fn seconds_since(self, earlier: Timestamp) -> f64 {
        (i128::from(self.unix_ns) - i128::from(earlier.unix_ns)) as f64 * 1e-9
    }

    /// This moment and some time.
    #[must_use]
    pub fn after(self, time: Duration) -> Self {
        Timestamp { unix_ns: self.unix_ns.saturating_add(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)) }
    }
}

/// The last moment that was told. Contacts are followed and the baseline drifts in time: it must go on, at about its own pace,
/// whatever happens to the system's clock.
#[derive(Debug, Clone, Copy)]
struct Steady {
    unix_ns: u64,
    at: Instant,
}

impl Steady {
    /// How fast time goes on while the system's clock, which was set back, catches up.
    const CATCHES_UP: f64 = 0.95;

    /// Now, where the system's clock says `system_ns`.
    fn later_ns(self, system_ns: u64, at: Instant) -> u64 {
        let least = at.saturating_duration_since(self.at).mul_f64(Self::CATCHES_UP);
        system_ns.max(Timestamp { unix_ns: self.unix_ns }.after(least).unix_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is told at each hundredth of a second of a system's clock that is set by `step_s` after a second.
    fn told_s(step_s: f64, seconds: f64) -> Vec<f64> {
        let (begun, mut steady) = (Instant::now(), None::<Steady>);
        let system_s = |time_s: f64| 1e6 + time_s + if time_s < 1.0 { 0.0 } else { step_s };
        (0..(seconds * 100.0) as u64)
            .map(|index| {
                let time_s = index as f64 * 0.01;
                let (at, system_ns) = (begun + Duration::from_secs_f64(time_s), (system_s(time_s) * 1e9) as u64);
                let unix_ns = steady.map_or(system_ns, |steady| steady.later_ns(system_ns, at));
                steady = Some(Steady { unix_ns, at });
                unix_ns as f64 * 1e-9 - 1e6
            })
            .collect()
    }

    #[test]
    fn a_clock_that_is_set_back_makes_time_neither_stand_nor_run_back() {
        let told = told_s(-2.0, 60.0);
        for pair in told.windows(2) {
            let step_s = pair[1] - pair[0];
            assert!((0.0094..0.0101).contains(&step_s), "{step_s} s in a hundredth");
        }
        // 2 s at a twentieth are caught up after 40 s.
        assert!((told[3900] - 37.0).abs() > 0.05 && (told[5000] - 48.0).abs() < 1e-3, "{} s", told[5000]);
    }

    #[test]
    fn a_clock_that_is_set_forward_is_followed_at_once() {
        let told = told_s(3600.0, 2.0);
        assert!((told[99] - 0.99).abs() < 1e-6 && (told[100] - 3601.0).abs() < 1e-6);
    }
}
