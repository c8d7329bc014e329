//! The reader that the tables are for: that of `docs/firmware.md`, whose parts it names.

use dermis::protocol::Protocol;
use dermis_sim::twin::electronics::{AdcOptions, ElectronicsOptions, Switching};

/// Relative tolerance of the reference resistor.
pub const REFERENCE_TOLERANCE: f64 = 1e-3;
/// The reference resistor of `reader.toml`, ohm.
pub(crate) const USUAL_REFERENCE_OHM: f64 = 1000.0;
/// Charge of a closing switch, and no aperture: the timing of a slot has its own cycles for it.
pub(crate) const SWITCHING: Switching = Switching { charge_c: 1e-12, aperture_s: 0.0 };
/// The longest wait that a slot can have, s.
pub(crate) const LONGEST_WAIT_S: f64 = 0.010;
/// Time of a slot beside its wait: 188 cycles of 125 MHz, s.
pub(crate) const OVERHEAD_S: f64 = 188.0 / 125e6;
/// Frames a second where the slots allow it, and slots a second, Hz.
const FRAME_RATE_HZ: f64 = 120.0;
const SLOT_RATE_HZ: f64 = 108e3;

/// The electronics for a protocol, before the reference resistor is fitted to a skin. `dermis-firmware/boards/reader.toml`
/// has the same.
pub fn electronics(protocol: &Protocol) -> ElectronicsOptions {
    ElectronicsOptions {
        source_v: 5.0,
        reference_ohm: USUAL_REFERENCE_OHM,
        on_resistance_ohm: 4.0,
        on_resistance_spread_ohm: 0.3,
        line_capacitance_f: 250e-12,
        slot_rate_hz: SLOT_RATE_HZ,
        frame_rate_hz: FRAME_RATE_HZ.min(SLOT_RATE_HZ / protocol.scan().len() as f64),
        gain_error: 0.001,
        snr_db: None,
        adc: Some(AdcOptions { bits: 16, range_v: 5.0, gain: 10.0, gain_driven: 1.0, gain_reference: 1.0 }),
        hum: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis_sim::twin::TwinOptions;

    #[test]
    fn it_is_the_reader_of_the_firmware() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../dermis-firmware/boards/reader.toml");
        let reader = TwinOptions::load(path).unwrap();
        assert_eq!(electronics(&Protocol::adjacent(30).unwrap()), reader.electronics);
    }
}
