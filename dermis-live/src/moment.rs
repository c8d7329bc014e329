//! Moments on the host's clock.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// A moment, in nanoseconds since 1970 (Unix time). In JSON it is that whole number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Moment {
    /// Nanoseconds since 1970.
    pub unix_ns: u64,
}

impl Moment {
    /// Now.
    pub fn now() -> Self {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Moment { unix_ns: u64::try_from(since.as_nanos()).unwrap_or(u64::MAX) }
    }

    /// Seconds since 1970.
    pub fn seconds(self) -> f64 {
        self.unix_ns as f64 * 1e-9
    }

    /// Seconds from `earlier` to this moment; negative where it is later.
    pub fn seconds_since(self, earlier: Moment) -> f64 {
        (i128::from(self.unix_ns) - i128::from(earlier.unix_ns)) as f64 * 1e-9
    }

    /// This moment and some time.
    #[must_use]
    pub fn after(self, time: Duration) -> Self {
        Moment { unix_ns: self.unix_ns.saturating_add(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)) }
    }
}
