//! A limit on the number of notices: a faulty device cannot flood terminals, pages and recordings.

use std::time::{Duration, Instant};

/// Lets a number of notices pass in each interval and counts the others.
#[derive(Debug)]
pub(super) struct NoticeLimit {
    most: u32,
    interval: Duration,
    begun: Option<Instant>,
    passed: u32,
    omitted: u64,
}

impl NoticeLimit {
    /// At most this many notices in an interval.
    pub(super) fn new(most: u32, interval: Duration) -> Self {
        NoticeLimit { most, interval, begun: None, passed: 0, omitted: 0 }
    }

    /// Whether a notice passes now; else it is counted.
    pub(super) fn passes(&mut self, now: Instant) -> bool {
        if self.is_over(now) {
            (self.begun, self.passed) = (Some(now), 0);
        }
        let passes = self.passed < self.most;
        if passes {
            self.passed += 1;
        } else {
            self.omitted += 1;
        }
        passes
    }

    /// The number of omitted notices that are not reported yet, once in an interval or at the end; none is `None`.
    pub(super) fn take_omitted(&mut self, now: Instant, is_end: bool) -> Option<u64> {
        let is_due = self.omitted > 0 && (is_end || self.is_over(now));
        is_due.then(|| std::mem::take(&mut self.omitted))
    }

    fn is_over(&self, now: Instant) -> bool {
        self.begun.is_none_or(|begun| now.saturating_duration_since(begun) >= self.interval)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_few_pass_in_each_interval_and_the_others_are_counted() {
        let begun = Instant::now();
        const INTERVAL: Duration = Duration::from_secs(10);
        let mut limit = NoticeLimit::new(3, INTERVAL);
        let passed = |limit: &mut NoticeLimit, at| (0..10).filter(|_| limit.passes(at)).count();
        assert_eq!(passed(&mut limit, begun), 3);
        assert_eq!(limit.take_omitted(begun, false), None);
        let later = begun + INTERVAL;
        assert_eq!(limit.take_omitted(later, false), Some(7));
        assert_eq!(limit.take_omitted(later, false), None);
        assert_eq!(passed(&mut limit, later), 3);
        assert_eq!(limit.take_omitted(later, true), Some(7));
    }
}
