//! A limit on the rate of requests.

use std::time::Instant;

/// Lets some requests pass at once, and after them a number a second (a token bucket).
#[derive(Debug)]
pub(crate) struct RateLimit {
    burst: f64,
    per_second: f64,
    left: f64,
    at: Option<Instant>,
}

impl RateLimit {
    /// At most `burst` requests at once, and `per_second` over a longer time.
    pub(crate) fn new(burst: u32, per_second: f64) -> Self {
        RateLimit { burst: f64::from(burst), per_second, left: f64::from(burst), at: None }
    }

    /// Whether a request passes now; if not, the seconds until one would.
    pub(crate) fn passes(&mut self, now: Instant) -> Result<(), f64> {
        let since_s = self.at.map_or(0.0, |at| now.saturating_duration_since(at).as_secs_f64());
        self.left = (self.left + since_s * self.per_second).min(self.burst);
        self.at = Some(now);
        if self.left < 1.0 {
            return Err((1.0 - self.left) / self.per_second);
        }
        self.left -= 1.0;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn a_burst_passes_and_then_a_number_a_second() {
        let begun = Instant::now();
        let mut limit = RateLimit::new(3, 2.0);
        let passed = |limit: &mut RateLimit, at| (0..10).filter(|_| limit.passes(at).is_ok()).count();
        assert_eq!(passed(&mut limit, begun), 3);
        assert_eq!(limit.passes(begun), Err(0.5));
        assert_eq!(passed(&mut limit, begun + Duration::from_secs(1)), 2);
        assert_eq!(passed(&mut limit, begun + Duration::from_secs(100)), 3);
    }
}
