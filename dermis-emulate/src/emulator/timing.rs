//! Frame rate and clock of the emulated device.

/// Times of the frames: the rate changes only at a start, and the clock continues meanwhile.
#[derive(Debug, Clone, Copy)]
pub(super) struct Timing {
    rate_millihertz: u32,
    asked_millihertz: u32,
    /// The first frame at this rate, and its time, us.
    since: (u64, f64),
}

impl Timing {
    /// At power-up.
    pub(super) fn new(rate_millihertz: u32) -> Self {
        Timing { rate_millihertz, asked_millihertz: rate_millihertz, since: (0, 0.0) }
    }

    /// The current rate, frames per 1000 s.
    pub(super) fn rate_millihertz(self) -> u32 {
        self.rate_millihertz
    }

    /// The requested rate, used from the next start on.
    pub(super) fn asked_millihertz(self) -> u32 {
        self.asked_millihertz
    }

    /// Requests another rate.
    pub(super) fn ask(&mut self, rate_millihertz: u32) {
        self.asked_millihertz = rate_millihertz;
    }

    /// Frame `index` is the first after a start.
    pub(super) fn start(&mut self, index: u64) {
        self.since = (index, self.time_us(index));
        self.rate_millihertz = self.asked_millihertz;
    }

    /// Time of frame `index`, us since power-up.
    pub(super) fn time_us(self, index: u64) -> f64 {
        self.since.1 + index.saturating_sub(self.since.0) as f64 * 1e9 / f64::from(self.rate_millihertz)
    }
}
