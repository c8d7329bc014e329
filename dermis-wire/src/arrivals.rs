//! Frames as they arrive: what was lost, repeated, reordered.

/// How a frame arrived.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arrival {
    /// The first one, or the next one after this many that have not come.
    New {
        /// Frames left out before it.
        skipped: u32,
    },
    /// A frame that has come already.
    Repeated,
    /// A frame that was overtaken by later ones.
    Late,
}

/// Counts frames by their sequence numbers, which wrap round.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Arrivals {
    /// Frames that came, each once.
    pub received: u64,
    /// Frames that have not come (a late one comes off this again).
    pub lost: u64,
    /// Frames that came again.
    pub repeated: u64,
    /// Frames that came after later ones.
    pub reordered: u64,
    /// The newest number, and which of the 64 before and at it have come (the newest is the lowest bit).
    newest: Option<(u32, u64)>,
}

/// A number this far behind the newest is no late frame but a counter that began again.
const MOST_LATE: u32 = 64;

impl Arrivals {
    /// Takes a frame's number in.
    pub fn take(&mut self, sequence: u32) -> Arrival {
        let Some((newest, seen)) = self.newest else { return self.start(sequence) };
        let ahead = sequence.wrapping_sub(newest);
        let behind = newest.wrapping_sub(sequence);
        if behind < MOST_LATE {
            return self.old(sequence, newest, seen);
        }
        if ahead > u32::MAX / 2 {
            return self.start(sequence);
        }
        let seen = if ahead < MOST_LATE { seen << ahead } else { 0 };
        self.newest = Some((sequence, seen | 1));
        self.received += 1;
        self.lost += u64::from(ahead - 1);
        Arrival::New { skipped: ahead - 1 }
    }

    /// Forgets the numbers but not the counts: the device was powered up again.
    pub fn restart(&mut self) {
        self.newest = None;
    }

    /// The first frame; those before it were never due.
    fn start(&mut self, sequence: u32) -> Arrival {
        self.newest = Some((sequence, u64::MAX));
        self.received += 1;
        Arrival::New { skipped: 0 }
    }

    fn old(&mut self, sequence: u32, newest: u32, seen: u64) -> Arrival {
        let bit = 1u64 << newest.wrapping_sub(sequence);
        if seen & bit != 0 {
            self.repeated += 1;
            return Arrival::Repeated;
        }
        self.newest = Some((newest, seen | bit));
        self.received += 1;
        self.lost -= 1;
        self.reordered += 1;
        Arrival::Late
    }
}
