//! Times of measurement.

use serde::{Deserialize, Serialize};
use std::time::Duration;

/// A time in nanoseconds since 1970 (Unix time). In JSON it is this integer.
///
/// The pipeline reads no clock: it uses the times of its frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(transparent)]
pub struct Timestamp {
    /// Nanoseconds since 1970.
    pub unix_ns: u64,
}

impl Timestamp {
    /// Seconds since 1970.
    pub fn seconds(self) -> f64 {
        self.unix_ns as f64 * 1e-9
    }

    /// Seconds from `earlier` to this time; negative if `earlier` is later.
    pub fn seconds_since(self, earlier: Timestamp) -> f64 {
        (i128::from(self.unix_ns) - i128::from(earlier.unix_ns)) as f64 * 1e-9
    }

    /// This time plus a duration.
    #[must_use]
    pub fn after(self, duration: Duration) -> Self {
        Timestamp { unix_ns: self.unix_ns.saturating_add(u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)) }
    }
}
