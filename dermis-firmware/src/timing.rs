//! Rates: the shortest frame of a table, and the share of each slot in a frame.

use crate::scanner::Limits;
use crate::table::TimedSlot;
use dermis_wire::{Frame, Status};

/// Bits per byte on a serial line: a start bit, eight data bits, a stop bit.
const BITS_PER_BYTE: u64 = 10;

/// Nanoseconds in 1,000 s: a period in ns is this over a rate in millihertz.
const NS_PER_1000_S: u64 = 1_000_000_000_000;

/// The shortest duration of a slot, ns.
fn needed_ns(timed: &TimedSlot, limits: Limits) -> u64 {
    u64::from(timed.wait_ns) + u64::from(limits.overhead_ns)
}

/// The shortest duration of a frame, ns.
pub fn frame_ns(slots: &[TimedSlot], limits: Limits) -> u64 {
    slots.iter().map(|timed| needed_ns(timed, limits)).sum::<u64>() + u64::from(limits.frame_ns)
}

/// The highest rate of a table, thousandths of a hertz: slots settle, and the serial line (`baud`, 0 for none) carries
/// frames and statuses. 0 without slots, and if the board cannot wait as long as a slot settles.
pub fn highest_rate_millihertz(slots: &[TimedSlot], limits: Limits, baud: u32) -> u32 {
    if slots.is_empty() || slots.iter().any(|timed| timed.wait_ns > limits.longest_wait_ns) {
        return 0;
    }
    let scanned = NS_PER_1000_S / frame_ns(slots, limits).max(1);
    let carried = if baud == 0 { u64::MAX } else { carried_millihertz(slots.len(), baud) };
    scanned.min(carried).min(u64::from(u32::MAX)) as u32
}

/// Frames that a serial line carries beside a status per second, thousandths of a hertz.
pub(crate) fn carried_millihertz(slot_count: usize, baud: u32) -> u64 {
    let bytes = u64::from(baud) / BITS_PER_BYTE;
    bytes.saturating_sub(Status::PACKET_BYTES as u64) * 1000 / Frame::packet_bytes(slot_count, 2) as u64
}

/// The period of a rate, ns.
pub(crate) fn period_ns(rate_millihertz: u32) -> u64 {
    NS_PER_1000_S / u64::from(rate_millihertz.max(1))
}

/// The longest duration D, ns, such that a frame whose slots last the longer of D and what they need fits into
/// `period_ns`. So the spare time of a frame goes to the slots that settle fastest, and all last the same where that is
/// enough. `None` if the slots do not fit.
pub fn shared_slot_ns(slots: &[TimedSlot], limits: Limits, period_ns: u64) -> Option<u64> {
    let budget = period_ns.checked_sub(u64::from(limits.frame_ns))?;
    let frame = |shared: u64| slots.iter().map(|timed| needed_ns(timed, limits).max(shared)).sum::<u64>();
    if slots.is_empty() || frame(0) > budget {
        return None;
    }
    let (mut low, mut high) = (0, budget);
    while low < high {
        let middle = low + (high - low).div_ceil(2);
        if frame(middle) <= budget { low = middle } else { high = middle - 1 }
    }
    Some(low.min(u64::from(limits.longest_wait_ns) + u64::from(limits.overhead_ns)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis_wire::Slot;

    const LIMITS: Limits = Limits { overhead_ns: 1000, frame_ns: 20_000, longest_wait_ns: 60_000 };

    fn slots<const N: usize>(waits_ns: [u32; N]) -> [TimedSlot; N] {
        waits_ns.map(|wait_ns| TimedSlot { slot: Slot { source: 0, sink: 1, measure: None }, wait_ns })
    }

    #[test]
    fn spare_time_goes_to_the_slots_that_settle_fastest() {
        let table = slots([1000, 9000, 2000]);
        // 45 us less 20 between frames: the slow slot takes 10, the others share 15.
        assert_eq!(shared_slot_ns(&table, LIMITS, 45_000), Some(7500));
        assert_eq!(shared_slot_ns(&table, LIMITS, 80_000), Some(20_000), "all the same where that is enough");
        assert_eq!(shared_slot_ns(&table, LIMITS, 35_000), Some(2000), "no spare time");
        assert_eq!(shared_slot_ns(&table, LIMITS, 34_999), None);
        assert_eq!(shared_slot_ns(&table, LIMITS, u64::MAX / 8), Some(61_000), "as long as the board can wait");
    }

    #[test]
    fn the_highest_rate_is_that_of_the_shortest_frame() {
        let table = slots([8260; 900]);
        // 900 slots of 9.26 us and 20 us between frames.
        assert_eq!(highest_rate_millihertz(&table, LIMITS, 0), 119_703);
        let fits = |rate| shared_slot_ns(&table, LIMITS, period_ns(rate)).is_some();
        assert!(fits(119_703) && !fits(119_720));
        assert_eq!(highest_rate_millihertz(&[], LIMITS, 0), 0);
        assert_eq!(highest_rate_millihertz(&slots([60_001, 5]), LIMITS, 0), 0, "the board cannot wait that long");
    }

    /// The rates that `docs/wire-protocol.md` tabulates for 900 readings of two bytes.
    #[test]
    fn a_serial_line_limits_the_rate() {
        let table = slots([0; 900]);
        let hertz = |baud| highest_rate_millihertz(&table, LIMITS, baud) / 1000;
        assert_eq!([115_200, 921_600, 2_000_000, 3_000_000].map(hertz), [6, 50, 109, 163]);
        assert_eq!(highest_rate_millihertz(&table, LIMITS, 100), 0);
    }
}
