//! The front end of a reader, simulated by a digital twin.

use crate::EmulateError;
use crate::firmware::FirmwareDevice;
use dermis_firmware::{FrontEnd, Gain, Limits};
use dermis_sim::twin::ContactHistory;
use dermis_sim::twin::electronics::SlotReader;
use dermis_wire::Slot;

/// Multiplexers, amplifier and converter in front of a twin.
pub(super) struct TwinFrontEnd<'a> {
    device: &'a FirmwareDevice,
    history: ContactHistory,
    frame: Option<SlotReader<'a>>,
    selected: Option<Slot>,
    /// Why the twin has failed.
    pub(super) failure: Option<EmulateError>,
}

impl<'a> TwinFrontEnd<'a> {
    pub(super) fn new(device: &'a FirmwareDevice) -> Self {
        TwinFrontEnd { device, history: ContactHistory::default(), frame: None, selected: None, failure: None }
    }
}

impl FrontEnd for TwinFrontEnd<'_> {
    /// Those of the Pico's front end.
    const LIMITS: Limits = Limits { overhead_ns: 1504, frame_ns: 0, longest_wait_ns: 10_000_000 };

    /// The twin answers for the time that it is given.
    const MAX_LATE_US: u64 = 250_000;

    fn begin(&mut self, time_us: u64) {
        match self.device.frame_at(time_us, &mut self.history) {
            Ok(frame) => self.frame = Some(frame),
            Err(error) => self.failure = Some(error),
        }
    }

    fn open(&mut self) {
        self.selected = None;
    }

    fn select(&mut self, slot: Slot, _gain: Gain) {
        // The twin chooses the gain of a slot by the same rule.
        self.selected = Some(slot);
    }

    fn close(&mut self) {
        if let (Some(frame), Some(slot)) = (&mut self.frame, self.selected) {
            let drive = [usize::from(slot.source), usize::from(slot.sink)];
            frame.connect((drive, slot.measure.map(|inputs| inputs.map(usize::from))));
        }
    }

    fn wait_ns(&mut self, wait_ns: u32) {
        if let Some(frame) = &mut self.frame {
            frame.wait(f64::from(wait_ns) * 1e-9);
        }
    }

    fn convert(&mut self) -> i16 {
        let Some(frame) = &mut self.frame else { return 0 };
        let value_v = frame.convert().0;
        frame.wait(f64::from(Self::LIMITS.overhead_ns) * 1e-9);
        let gain = self.selected.map_or(0, |slot| match Gain::of(slot) {
            Gain::Free => 0,
            Gain::Driven => 1,
            Gain::Reference => 2,
        });
        self.device.counts(value_v, gain)
    }
}
