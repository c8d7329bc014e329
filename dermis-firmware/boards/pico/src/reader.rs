//! The scanner of the device: words for the front end, and the frames that come back.

use crate::MAX_SLOTS;
use crate::front_end::{
    BUFFERS, CYCLES_PER_US, DONE, EMPTY, FILLED, JOBS, Job, OVERHEAD_CYCLES, STOP, SlotWords, WAIT_CYCLES,
};
use dermis_firmware::{Gain, HardwareFault, Limits, Plan, Scanned, Scanner, TimedSlot};
use static_cell::ConstStaticCell;

static WORDS: ConstStaticCell<[u32; 2 * MAX_SLOTS]> = ConstStaticCell::new([0; 2 * MAX_SLOTS]);
static READINGS: ConstStaticCell<[[u16; MAX_SLOTS]; BUFFERS]> = ConstStaticCell::new([[0; MAX_SLOTS]; BUFFERS]);

/// Input of the amplifier's multiplexers that is on the reference resistor; electrodes have the inputs 0 to 30.
const ON_REFERENCE: u32 = 31;

/// Cycles to nanoseconds, rounded up.
const fn ns(cycles: u32) -> u32 {
    (cycles * 1000).div_ceil(CYCLES_PER_US)
}

/// The scanner.
pub struct Reader {
    /// The words, unless the front end has them.
    words: Option<&'static mut [u32]>,
    readings: [i16; MAX_SLOTS],
    running: Option<Running>,
}

#[derive(Clone, Copy)]
struct Running {
    slot_count: usize,
    /// Cycles of a frame.
    frame_cycles: u64,
    /// Number of the next frame.
    next: u64,
}

impl Reader {
    pub fn new() -> Self {
        for buffer in READINGS.take() {
            // The queue has room for all of them.
            let _ = EMPTY.try_send(&mut buffer[..]);
        }
        Reader { words: Some(&mut WORDS.take()[..]), readings: [0; MAX_SLOTS], running: None }
    }

    /// Takes back what the front end no longer needs.
    fn reclaim(&mut self) {
        if let Ok(job) = DONE.try_receive() {
            self.words = Some(job.words);
        }
        if self.running.is_none() {
            while let Ok(filled) = FILLED.try_receive() {
                let _ = EMPTY.try_send(filled.readings);
            }
        }
    }
}

/// The pins of a slot: the addresses of source, sink, plus and minus, then the gain.
fn pins(timed: &TimedSlot) -> u32 {
    let slot = timed.slot;
    let [plus, minus] = slot.measure.map_or([ON_REFERENCE; 2], |inputs| inputs.map(u32::from));
    let gain = match Gain::of(slot) {
        Gain::Free => 0b01,
        Gain::Driven | Gain::Reference => 0b00,
    };
    u32::from(slot.source) | u32::from(slot.sink) << 5 | plus << 10 | minus << 15 | gain << 20
}

impl Scanner for Reader {
    fn limits(&self) -> Limits {
        // One cycle more: the settling of a slot is rounded up to whole cycles.
        Limits { overhead_ns: ns(OVERHEAD_CYCLES + 1), frame_ns: 0, longest_wait_ns: 10_000_000 }
    }

    fn start(&mut self, plan: &Plan<'_>, _now_us: u64) -> Result<(), HardwareFault> {
        self.reclaim();
        let Some(words) = self.words.take() else { return Err(HardwareFault("the front end has not stopped")) };
        let (slots, limits) = (plan.slots, self.limits());
        let settle = |timed: &TimedSlot| {
            let wait = plan.wait_ns(timed, limits) as u64 * u64::from(CYCLES_PER_US);
            (wait.div_ceil(1000) as u32).max(WAIT_CYCLES)
        };
        let used: u64 = slots.iter().map(|timed| u64::from(settle(timed) + OVERHEAD_CYCLES)).sum();
        // Cycles that whole nanoseconds have left over: one more for each of the first slots.
        let spare = (plan.period_ns * u64::from(CYCLES_PER_US) / 1000).saturating_sub(used);
        let (every, more) = (spare / slots.len().max(1) as u64, spare % slots.len().max(1) as u64);
        let (pairs, _) = words.as_chunks_mut();
        for ((place, timed), index) in pairs.iter_mut().zip(slots).zip(0u64..) {
            let extra = every + u64::from(index < more);
            let word: SlotWords = [pins(timed), settle(timed) + extra as u32 - WAIT_CYCLES];
            *place = word;
        }
        self.running = Some(Running { slot_count: slots.len(), frame_cycles: used + spare, next: 0 });
        let _ = JOBS.try_send(Job { words, slot_count: slots.len() });
        Ok(())
    }

    fn poll(&mut self, _now_us: u64) -> Result<Option<Scanned<'_>>, HardwareFault> {
        self.reclaim();
        let Some(running) = &mut self.running else { return Ok(None) };
        let Ok(filled) = FILLED.try_receive() else { return Ok(None) };
        let count = running.slot_count;
        // The bits of a reading are a number with a sign.
        self.readings.iter_mut().zip(filled.readings.iter()).take(count).for_each(|(to, from)| *to = *from as i16);
        let _ = EMPTY.try_send(filled.readings);
        let missed = filled.index.saturating_sub(running.next);
        running.next = filled.index + 1;
        let since_us = u128::from(filled.index) * u128::from(running.frame_cycles) / u128::from(CYCLES_PER_US);
        let time_us = filled.began_us + since_us as u64;
        Ok(Some(Scanned { time_us, missed: missed as u32, readings: &self.readings[..count] }))
    }

    fn stop(&mut self) {
        self.running = None;
        STOP.signal(());
    }
}
