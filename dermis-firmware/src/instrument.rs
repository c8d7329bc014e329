//! The constants of a device: its skin, its electronics, and the settling time of its slots.

use crate::scanner::Gain;
use crate::table::TimedSlot;
use dermis_wire::Slot;

/// The constants of a device. The values before `name` are those that its hello states; all but the last four come from
/// `dermis scan-table --firmware`.
#[derive(Debug, Clone, Copy)]
pub struct Instrument<'a> {
    /// Identifier of the skin: SHA-256 of its body, electrodes and protocol.
    pub design_sha256: [u8; 32],
    /// Electrodes of the skin.
    pub electrode_count: u16,
    /// Resistor in series with the source, ohm.
    pub reference_ohm: f32,
    /// Voltage of the source, V.
    pub source_v: f32,
    /// Volts per count: of readings without a driven electrode, of those with one, of the reference resistor.
    pub volts_per_count: [f32; 3],
    /// Largest count of a reading, positive or negative; such a reading is out of range.
    pub full_scale: u16,
    /// Settling of the slots; its slots are the scan table at power-up.
    pub settling: Settling<'a>,
    /// Frames per 1,000 seconds at power-up, where the scan table allows them.
    pub rate_millihertz: u32,
    /// Name of the device.
    pub name: &'a str,
    /// Bits per second of its serial line; 0 if it has none.
    pub baud: u32,
    /// Its serial number.
    pub serial: u32,
    /// A new random number at every power-up.
    pub boot: u32,
}

/// The time that each slot settles before it is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Settling<'a> {
    /// The slots of the skin's scan table, in its order.
    pub slots: &'a [TimedSlot],
    /// Enough for any slot of this skin, ns.
    pub otherwise_ns: u32,
}

impl Settling<'_> {
    /// The settling time of a slot, ns. `expected` is the place in the skin's own table where it is looked for first.
    pub fn wait_ns(&self, slot: Slot, expected: usize) -> u32 {
        let at = |timed: &&TimedSlot| timed.slot == slot;
        let found = self.slots.get(expected).filter(at).or_else(|| self.slots.iter().find(at));
        found.map_or(self.otherwise_ns, |timed| timed.wait_ns)
    }
}

impl Instrument<'_> {
    /// Whether the skin has the electrodes of a slot.
    pub(crate) fn has(&self, slot: Slot) -> bool {
        let [plus, minus] = slot.measure.unwrap_or([0, 0]);
        [slot.source, slot.sink, plus, minus].into_iter().all(|electrode| electrode < self.electrode_count)
    }
}

impl Gain {
    /// The gain with which a slot is read.
    pub fn of(slot: Slot) -> Self {
        match slot.measure {
            None => Gain::Reference,
            Some(inputs) if inputs.contains(&slot.source) || inputs.contains(&slot.sink) => Gain::Driven,
            Some(_) => Gain::Free,
        }
    }
}
