//! Frames of readings: the trait of what reads them, and a scanner that reads slot by slot.

use crate::table::TimedSlot;
use crate::timing::{frame_ns, shared_slot_ns};
use dermis_wire::Slot;

/// Timing of a board, ns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Duration of a slot beside its settling: switching and conversion.
    pub overhead_ns: u32,
    /// Time between two frames.
    pub frame_ns: u32,
    /// The longest settling that the board can time.
    pub longest_wait_ns: u32,
}

/// The frames that a scanner reads.
#[derive(Debug, Clone, Copy)]
pub struct Plan<'a> {
    /// The slots of a frame; a slot settles at least as long as it states.
    pub slots: &'a [TimedSlot],
    /// Shortest duration of a slot, with everything, ns: the frame's time divided among the slots. A slot that needs
    /// more lasts longer.
    pub shared_slot_ns: u64,
    /// From the start of a frame to the start of the next, ns.
    pub period_ns: u64,
}

impl Plan<'_> {
    /// The settling time of a slot of this plan, ns.
    pub fn wait_ns(&self, timed: &TimedSlot, limits: Limits) -> u32 {
        let shared = self.shared_slot_ns.saturating_sub(u64::from(limits.overhead_ns));
        timed.wait_ns.max(shared.min(u64::from(limits.longest_wait_ns)) as u32)
    }
}

/// A frame as it was read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Scanned<'a> {
    /// Time at which its first slot was begun, us since power-up.
    pub time_us: u64,
    /// Frames before it that were due but not read.
    pub missed: u32,
    /// The readings, counts.
    pub readings: &'a [i16],
}

/// A failure of the front end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HardwareFault(
    /// Description as text.
    pub &'static str,
);

/// What reads frames. No call waits longer than a frame.
pub trait Scanner {
    /// The timing of the board.
    fn limits(&self) -> Limits;

    /// Begins to read frames, the first one now. It copies what it needs of the plan.
    ///
    /// # Errors
    /// A front end that does not work.
    fn start(&mut self, plan: &Plan<'_>, now_us: u64) -> Result<(), HardwareFault>;

    /// The oldest frame that was finished since the last call; `None` if there is none.
    ///
    /// # Errors
    /// A front end that has stopped working.
    fn poll(&mut self, now_us: u64) -> Result<Option<Scanned<'_>>, HardwareFault>;

    /// Ends after the slot that is being read; unfinished frames are discarded.
    fn stop(&mut self);
}

/// Gain before the converter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gain {
    /// For readings without a driven electrode.
    Free,
    /// For readings with a driven electrode.
    Driven,
    /// For readings of the reference resistor.
    Reference,
}

/// Multiplexers, amplifier and converter of a board, as software operates them.
///
/// While the switches are open, the amplifier's inputs must be held within the supply by bias resistors: inputs without
/// a path for their current drift to a rail.
pub trait FrontEnd {
    /// Timing of a slot beside its settling.
    const LIMITS: Limits;

    /// A frame is read up to this long after its time, us; a later one is left out. 0 for real front ends: a late frame
    /// is another one. An emulated front end answers for the time that it is given.
    const MAX_LATE_US: u64 = 0;

    /// Begins the frame of a time, us since power-up.
    fn begin(&mut self, _time_us: u64) {}

    /// Opens all switches.
    fn open(&mut self);

    /// Sets addresses and gain for a slot, with all switches open.
    fn select(&mut self, slot: Slot, gain: Gain);

    /// Closes the switches of the selected slot.
    fn close(&mut self);

    /// Waits at least this long.
    fn wait_ns(&mut self, wait_ns: u32);

    /// Converts and waits until the conversion has ended. Returns counts.
    fn convert(&mut self) -> i16;
}

/// Reads slot by slot: break before make, settle, convert, and only then the next slot.
#[derive(Debug)]
pub struct SlotScanner<'a, F> {
    front_end: F,
    slots: &'a mut [TimedSlot],
    readings: &'a mut [i16],
    count: usize,
    /// Time of the first frame, us; period, ns; number of the next frame. `None` while stopped.
    running: Option<(u64, u64, u64)>,
}

impl<'a, F: FrontEnd> SlotScanner<'a, F> {
    /// A scanner with memory for the slots and the readings of the largest frame.
    pub fn new(front_end: F, slots: &'a mut [TimedSlot], readings: &'a mut [i16]) -> Self {
        SlotScanner { front_end, slots, readings, count: 0, running: None }
    }

    /// Its front end.
    pub fn front_end(&mut self) -> &mut F {
        &mut self.front_end
    }

    /// Time of frame `index`, us.
    fn due_us((began_us, period_ns, _): (u64, u64, u64), index: u64) -> u64 {
        began_us + (u128::from(index) * u128::from(period_ns) / 1000) as u64
    }

    fn read(&mut self, time_us: u64) {
        self.front_end.begin(time_us);
        for (timed, reading) in self.slots[..self.count].iter().zip(self.readings.iter_mut()) {
            self.front_end.open();
            self.front_end.select(timed.slot, Gain::of(timed.slot));
            self.front_end.close();
            self.front_end.wait_ns(timed.wait_ns);
            *reading = self.front_end.convert();
        }
    }
}

impl<F: FrontEnd> Scanner for SlotScanner<'_, F> {
    fn limits(&self) -> Limits {
        F::LIMITS
    }

    fn start(&mut self, plan: &Plan<'_>, now_us: u64) -> Result<(), HardwareFault> {
        if plan.slots.len() > self.slots.len().min(self.readings.len()) {
            return Err(HardwareFault("the scanner's memory is smaller than the scan table"));
        }
        self.count = plan.slots.len();
        for (place, timed) in self.slots.iter_mut().zip(plan.slots) {
            *place = TimedSlot { slot: timed.slot, wait_ns: plan.wait_ns(timed, F::LIMITS) };
        }
        self.running = Some((now_us, plan.period_ns, 0));
        Ok(())
    }

    fn poll(&mut self, now_us: u64) -> Result<Option<Scanned<'_>>, HardwareFault> {
        let Some(running) = self.running else { return Ok(None) };
        let (began_us, period_ns, next) = running;
        let due_us = Self::due_us(running, next);
        if due_us > now_us {
            return Ok(None);
        }
        // The newest frame that is due, once the next one is too late.
        let newest = (u128::from(now_us - began_us) * 1000 + 999) / u128::from(period_ns.max(1));
        let late = now_us - due_us > F::MAX_LATE_US.max(period_ns / 1000);
        let index = if late { newest as u64 } else { next };
        self.running = Some((began_us, period_ns, index + 1));
        let time_us = Self::due_us(running, index);
        self.read(time_us);
        let missed = (index - next).min(u64::from(u32::MAX)) as u32;
        Ok(Some(Scanned { time_us, missed, readings: &self.readings[..self.count] }))
    }

    fn stop(&mut self) {
        self.running = None;
    }
}

/// The plan of a table at a rate; `None` if its slots do not fit into the period.
pub(crate) fn plan(slots: &[TimedSlot], limits: Limits, period_ns: u64) -> Option<Plan<'_>> {
    let shared_slot_ns = shared_slot_ns(slots, limits, period_ns)?;
    debug_assert!(frame_ns(slots, limits) <= period_ns);
    Some(Plan { slots, shared_slot_ns, period_ns })
}
