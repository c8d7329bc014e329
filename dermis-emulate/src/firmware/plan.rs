//! What a reader's firmware must know of its skin and its electronics: hash, scales, and the settling time of each slot.

use crate::EmulateError;
use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::mesh::Mesh;
use dermis_firmware::{Instrument, Settling, TimedSlot};
use dermis_live::device::ScanTable;
use dermis_sim::twin::TwinOptions;
use dermis_sim::twin::electronics::{ElectronicsOptions, SettlingPlan, Switching};
use dermis_wire::Slot;
use std::fmt::Write;

/// Bits of the firmware's readings.
const MAX_BITS: u32 = 16;

/// The constants of a reader for a skin.
#[derive(Debug, Clone, PartialEq)]
pub struct ReaderPlan {
    design: String,
    twin: String,
    design_sha256: [u8; 32],
    electrode_count: u16,
    electronics: ElectronicsOptions,
    volts_per_count: [f64; 3],
    full_scale: u16,
    /// The slots of the scan table and their settling times.
    slots: Vec<TimedSlot>,
    otherwise_ns: u32,
}

impl ReaderPlan {
    /// The plan for a design and the electronics of a twin: each slot settles to half a step of the converter from any
    /// voltage within the supply, with a margin of a quarter of the time.
    ///
    /// # Errors
    /// Electronics without a converter, or with one of more than 16 bits; a design without a solution.
    pub fn new(design: &SkinDesign, twin: &TwinOptions, switching: Switching) -> Result<Self, EmulateError> {
        let electronics = &twin.electronics;
        let Some(adc) = electronics.adc.filter(|adc| adc.bits <= MAX_BITS) else {
            return Err(EmulateError::Given(format!(
                "the twin `{}` has no converter of at most {MAX_BITS} bits, which the firmware sends: state \
                 [electronics.adc] in its file",
                twin.name
            )));
        };
        let mesh = Mesh::generate(design).map_err(dermis::Error::from)?;
        let forward = ForwardModel::new(design, &mesh)?;
        let network = forward.network(forward.rest_conductivity()).map_err(dermis::Error::from)?;
        let plan = SettlingPlan::new(electronics, &design.protocol, &network, switching)?;
        let scan = ScanTable::new(&design.protocol)?;
        let timed = |(slot, wait_s): (&Slot, &f64)| TimedSlot { slot: *slot, wait_ns: nanoseconds(*wait_s) };
        let slots = scan.slots().iter().zip(&plan.waits_s).map(timed).collect();
        Ok(ReaderPlan {
            design: design.name.clone(),
            twin: twin.name.clone(),
            design_sha256: design.sha256(),
            electrode_count: design.electrodes.len() as u16,
            volts_per_count: plan.electronics.volts_per_count().unwrap_or([f64::NAN; 3]),
            full_scale: ((1u32 << (adc.bits - 1)) - 1) as u16,
            electronics: electronics.clone(),
            slots,
            otherwise_ns: nanoseconds(plan.otherwise_s),
        })
    }

    /// The slots of the scan table and their settling times.
    pub fn slots(&self) -> &[TimedSlot] {
        &self.slots
    }

    /// The constants of a device.
    pub fn instrument<'a>(&'a self, name: &'a str, serial: u32, boot: u32) -> Instrument<'a> {
        Instrument {
            design_sha256: self.design_sha256,
            electrode_count: self.electrode_count,
            reference_ohm: self.electronics.reference_ohm as f32,
            source_v: self.electronics.source_v as f32,
            volts_per_count: self.volts_per_count.map(|volts| volts as f32),
            full_scale: self.full_scale,
            settling: Settling { slots: &self.slots, otherwise_ns: self.otherwise_ns },
            rate_millihertz: (self.electronics.frame_rate_hz * 1e3).round() as u32,
            name,
            baud: 0,
            serial,
            boot,
        }
    }

    /// The plan as a module in Rust for a board's firmware.
    pub fn to_rust(&self) -> String {
        let Instrument { reference_ohm, source_v, volts_per_count, rate_millihertz, .. } = self.instrument("", 0, 0);
        let mut text = format!(
            "//! The skin `{}` read by the electronics of the twin `{}`, made by `dermis scan-table --firmware`.\n\n\
             use dermis_firmware::{{Instrument, Settling, TimedSlot}};\n\n\
             /// The constants of the skin and its electronics.\n#[rustfmt::skip]\n\
             pub const INSTRUMENT: Instrument<'static> = Instrument {{\n    design_sha256: [\n        {},\n        {},\n    ],\n    \
             electrode_count: {},\n    reference_ohm: {reference_ohm:?},\n    source_v: {source_v:?},\n    \
             volts_per_count: {volts_per_count:?},\n    full_scale: {},\n    \
             settling: Settling {{ slots: &SLOTS, otherwise_ns: {} }},\n    rate_millihertz: {rate_millihertz},\n    name: \"\",\n    \
             baud: 0,\n    serial: 0,\n    boot: 0,\n}};\n\n\
             /// Source, sink, plus and minus input (none: the reference resistor), settling time in ns.\n\
             const fn t(source: u16, sink: u16, inputs: Option<[u16; 2]>, wait_ns: u32) -> TimedSlot {{\n    \
             TimedSlot::new(source, sink, inputs, wait_ns)\n}}\n\n\
             #[rustfmt::skip]\nstatic SLOTS: [TimedSlot; {}] = [\n",
            self.design,
            self.twin,
            hex(&self.design_sha256[..16]),
            hex(&self.design_sha256[16..]),
            self.electrode_count,
            self.full_scale,
            self.otherwise_ns,
            self.slots.len(),
        );
        for TimedSlot { slot: Slot { source, sink, measure }, wait_ns } in &self.slots {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "    t({source}, {sink}, {measure:?}, {wait_ns}),");
        }
        text + "];\n"
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("0x{byte:02x}")).collect::<Vec<_>>().join(", ")
}

fn nanoseconds(time_s: f64) -> u32 {
    (time_s * 1e9).ceil() as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis_firmware::{Limits, frame_ns, highest_rate_millihertz};

    /// The Pico's.
    const LIMITS: Limits = Limits { overhead_ns: 1504, frame_ns: 0, longest_wait_ns: 10_000_000 };

    fn plan(sheet_resistance_ohm: f64) -> ReaderPlan {
        let mut design = SkinDesign::shipped("cylinder30").unwrap();
        design.sheet.conductance = 1.0 / sheet_resistance_ohm;
        let mut twin = TwinOptions::shipped("lab").unwrap();
        twin.electronics.adc =
            twin.electronics.adc.map(|adc| dermis_sim::twin::electronics::AdcOptions { bits: 16, ..adc });
        ReaderPlan::new(&design, &twin, Switching { charge_c: 1e-12, aperture_s: 0.0 }).unwrap()
    }

    /// 120 frames of 900 slots per second at 1 kohm per square, fewer where the lines settle more slowly.
    #[test]
    fn the_rate_falls_with_the_sheet_resistance() {
        let mut rates_hz = Vec::new();
        for sheet_resistance_ohm in [1e3, 5e3, 20e3] {
            let plan = plan(sheet_resistance_ohm);
            let longest_ns = plan.slots().iter().map(|timed| timed.wait_ns).max().unwrap();
            let rate_hz = f64::from(highest_rate_millihertz(plan.slots(), LIMITS, 0)) * 1e-3;
            println!(
                "{sheet_resistance_ohm:5.0} ohm per square: {:.2} ms a frame, longest slot {:.2} us, any slot {:.2} us, at most {rate_hz:.1} Hz",
                frame_ns(plan.slots(), LIMITS) as f64 * 1e-6,
                f64::from(longest_ns) * 1e-3,
                f64::from(plan.otherwise_ns) * 1e-3
            );
            assert!(plan.otherwise_ns >= longest_ns);
            rates_hz.push(rate_hz);
        }
        assert!(rates_hz[0] > 120.0 && rates_hz[2] < 120.0, "{rates_hz:?}");
        assert!(rates_hz.is_sorted_by(|a, b| a > b));
    }

    #[test]
    fn electronics_without_a_converter_are_refused() {
        let design = SkinDesign::shipped("cylinder30").unwrap();
        let twin = TwinOptions::shipped("ideal").unwrap();
        let error = ReaderPlan::new(&design, &twin, Switching::default()).unwrap_err();
        assert!(error.to_string().contains("[electronics.adc]"), "{error}");
    }
}
