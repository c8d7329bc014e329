//! Statistics of arriving frames: lost, repeated, reordered.

/// Classification of an arriving frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arrival {
    /// The first frame, or a new frame after this number of missing frames.
    New {
        /// Missing frames before it.
        skipped: u32,
    },
    /// A frame that has arrived already.
    Repeated,
    /// A frame that arrives after later ones.
    Late,
}

/// Counts frames by their sequence numbers, which wrap around.
///
/// Every due frame is counted once, as received or as lost: `received + lost` is the number of frames from the first to
/// the newest, plus the late ones before the first. A number far from the newest is a restarted counter, and does not
/// count as a loss. A counter that restarted *near* the newest number cannot be distinguished from repeated frames:
/// call [`restart`](Self::restart) when a [`Hello`](crate::Hello) has another `boot`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Arrivals {
    /// Frames that arrived, each counted once.
    pub received: u64,
    /// Frames that did not arrive (reduced by one when a late frame arrives).
    pub lost: u64,
    /// Frames that arrived again.
    pub repeated: u64,
    /// Frames that arrived after later ones.
    pub reordered: u64,
    window: Option<Window>,
}

/// State of the newest frame and the 63 before it; the lowest bit is the newest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Window {
    newest: u32,
    /// The frames that have arrived.
    seen: u64,
    /// The frames after the first one: of these, a frame that has not arrived was counted as lost.
    due: u64,
}

/// A number this far behind the newest is not a late frame but a restarted counter.
const MAX_LATE: u32 = u64::BITS;

/// A number farther ahead of the newest than this is not a loss but a restarted counter: 2.3 hours at 2,000 frames per
/// second.
const MAX_AHEAD: u32 = 1 << 24;

impl Arrivals {
    /// Counts a frame by its number.
    pub fn take(&mut self, sequence: u32) -> Arrival {
        let Some(window) = self.window else { return self.start(sequence) };
        let behind = window.newest.wrapping_sub(sequence);
        let ahead = sequence.wrapping_sub(window.newest);
        if behind < MAX_LATE {
            return self.old(1 << behind, window);
        }
        if ahead > MAX_AHEAD {
            return self.start(sequence);
        }
        let shift = |bits: u64| bits.checked_shl(ahead).unwrap_or(0);
        let (seen, due) = (shift(window.seen) | 1, shift(window.due) | !shift(u64::MAX));
        self.window = Some(Window { newest: sequence, seen, due });
        self.received += 1;
        self.lost += u64::from(ahead - 1);
        Arrival::New { skipped: ahead - 1 }
    }

    /// Resets the numbers but not the counts, after the device was restarted.
    pub fn restart(&mut self) {
        self.window = None;
    }

    /// The first frame; the frames before it were never due.
    fn start(&mut self, sequence: u32) -> Arrival {
        self.window = Some(Window { newest: sequence, seen: 1, due: 1 });
        self.received += 1;
        Arrival::New { skipped: 0 }
    }

    /// The newest frame again, or an earlier one.
    fn old(&mut self, bit: u64, window: Window) -> Arrival {
        if window.seen & bit != 0 {
            self.repeated += 1;
            return Arrival::Repeated;
        }
        self.window = Some(Window { seen: window.seen | bit, ..window });
        self.received += 1;
        self.reordered += 1;
        if window.due & bit != 0 {
            self.lost = self.lost.saturating_sub(1);
        }
        Arrival::Late
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Received, lost, repeated, reordered.
    fn counts(arrivals: &Arrivals) -> [u64; 4] {
        [arrivals.received, arrivals.lost, arrivals.repeated, arrivals.reordered]
    }

    fn taken(numbers: impl IntoIterator<Item = u32>) -> Arrivals {
        let mut arrivals = Arrivals::default();
        numbers.into_iter().for_each(|number| {
            arrivals.take(number);
        });
        arrivals
    }

    fn after(numbers: impl IntoIterator<Item = u32>) -> [u64; 4] {
        counts(&taken(numbers))
    }

    #[test]
    fn numbers_wrap_round() {
        assert_eq!(after([u32::MAX - 1, u32::MAX, 0, 1]), [4, 0, 0, 0]);
        // 2^32 - 1 and 1 are missing; the former arrives late, then again.
        assert_eq!(after([u32::MAX - 1, 0, 2, u32::MAX, u32::MAX]), [4, 1, 1, 1]);
    }

    #[test]
    fn a_late_frame_is_not_lost_and_comes_once() {
        let mut arrivals = Arrivals::default();
        assert_eq!(arrivals.take(10), Arrival::New { skipped: 0 });
        assert_eq!(arrivals.take(13), Arrival::New { skipped: 2 });
        assert_eq!(counts(&arrivals), [2, 2, 0, 0]);
        assert_eq!(arrivals.take(11), Arrival::Late);
        assert_eq!(arrivals.take(11), Arrival::Repeated);
        assert_eq!(arrivals.take(13), Arrival::Repeated);
        assert_eq!(counts(&arrivals), [3, 1, 2, 1]);
    }

    #[test]
    fn a_frame_that_the_first_overtook_was_never_lost() {
        assert_eq!(after([5, 4, 6, 4, 3]), [4, 0, 1, 2]);
        // Nor does it replace a frame that was due.
        assert_eq!(after([5, 8, 4]), [3, 2, 0, 1]);
    }

    #[test]
    fn the_window_holds_64_numbers() {
        // 63 behind is late; one more is a restarted counter.
        assert_eq!(after([0, 2, 64, 1]), [4, 61, 0, 1]);
        let mut arrivals = taken([0, 2, 65]);
        assert_eq!(arrivals.take(1), Arrival::New { skipped: 0 });
        assert_eq!(counts(&arrivals), [4, 63, 0, 0]);
        // Each of the 63 before the newest can arrive late, once.
        let numbers = [100, 164].into_iter().chain((101..164).rev()).chain(101..164);
        assert_eq!(after(numbers), [65, 0, 63, 63]);
    }

    #[test]
    fn a_device_that_began_again_has_lost_nothing() {
        assert_eq!(after([1000, 1001, 0, 1]), [4, 0, 0, 0]);
        // Also if its last number was in the upper half of the range.
        assert_eq!(after([3_000_000_000, 0, 1]), [3, 0, 0, 0]);
        let mut arrivals = taken([7, 8]);
        arrivals.restart();
        assert_eq!(arrivals.take(8), Arrival::New { skipped: 0 });
        assert_eq!(counts(&arrivals), [3, 0, 0, 0]);
    }

    #[test]
    fn a_long_gap_is_lost_up_to_a_bound() {
        assert_eq!(after([0, MAX_AHEAD]), [2, u64::from(MAX_AHEAD) - 1, 0, 0]);
        assert_eq!(after([0, MAX_AHEAD + 1]), [2, 0, 0, 0]);
        assert_eq!(after([0, 64, 63, 0]), [4, 62, 0, 1]);
    }
}
