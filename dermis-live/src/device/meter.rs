//! Conversion of readings to ohm.

use crate::device::{Role, ScanTable};
use dermis::pipeline::Measurement;
use dermis::protocol::Protocol;
use dermis_wire::{Hello, Readings};

/// Converts the readings of one device to the values of a frame.
///
/// The current of each drive is measured across the reference resistor, `I = V_ref / R_ref`; a value is the measured
/// voltage divided by this current.
#[derive(Debug, Clone)]
pub(crate) struct Meter {
    roles: Vec<Role>,
    /// For each channel, its drive and the volts per count.
    channels: Vec<(usize, f64)>,
    drive_count: usize,
    volts_per_reference_count: f64,
    reference_ohm: f64,
    source_v: f64,
    full_scale: i64,
    reading_bytes: u8,
    /// The design assumes an instrument that loses signs, as its linear models and networks do.
    amplitude_only: bool,
}

impl Meter {
    /// For the readings of a device.
    pub(super) fn new(hello: &Hello<'_>, scan: &ScanTable, protocol: &Protocol) -> Self {
        let (drives, drive_of) = protocol.drives();
        let [free, driven, reference] = hello.volts_per_count.map(f64::from);
        let volts = |channel: &dermis::protocol::Channel| if channel.touches_driven() { driven } else { free };
        Meter {
            roles: scan.roles().to_vec(),
            channels: drive_of.into_iter().zip(protocol.channels().iter().map(volts)).collect(),
            drive_count: drives.len(),
            volts_per_reference_count: reference,
            reference_ohm: f64::from(hello.reference_ohm),
            source_v: f64::from(hello.source_v),
            full_scale: i64::from(hello.full_scale),
            reading_bytes: hello.reading_bytes,
            amplitude_only: protocol.amplitude_only(),
        }
    }

    /// Whether readings have the number and the width that the hello of the device states.
    pub(crate) fn takes(&self, readings: &Readings<'_>) -> bool {
        readings.len() == self.roles.len() && readings.reading_bytes() == self.reading_bytes
    }

    /// The readings of a frame in ohm. A current of zero is replaced by the smallest that the converter resolves, so
    /// that the values of a drive with a broken wire are large but finite. With a protocol of amplitudes the values
    /// have no sign, whether or not the device sends one.
    ///
    /// # Panics
    /// If the number of readings differs from the number of slots.
    pub(super) fn measure(&self, readings: Readings<'_>) -> Measurement {
        assert_eq!(readings.len(), self.roles.len(), "a reading for each slot");
        let mut currents_a = vec![0.0; self.drive_count];
        let mut saturated = vec![false; self.drive_count];
        let mut measurement = Measurement {
            values_ohm: vec![0.0; self.channels.len()],
            loops_ohm: vec![0.0; self.drive_count],
            saturated: Vec::new(),
        };
        for (reading, role) in readings.iter().zip(&self.roles) {
            match *role {
                Role::Current(drive) => {
                    let counts = if reading == 0 { 0.5 } else { f64::from(reading) };
                    currents_a[drive] = counts * self.volts_per_reference_count / self.reference_ohm;
                    measurement.loops_ohm[drive] = self.source_v / currents_a[drive] - self.reference_ohm;
                    saturated[drive] = self.is_saturated(reading);
                }
                Role::Channel(channel) => {
                    let (_, volts_per_count) = self.channels[channel];
                    measurement.values_ohm[channel] = f64::from(reading) * volts_per_count;
                    if self.is_saturated(reading) {
                        measurement.saturated.push(channel);
                    }
                }
            }
        }
        for (channel, (value, &(drive, _))) in measurement.values_ohm.iter_mut().zip(&self.channels).enumerate() {
            *value /= currents_a[drive];
            if saturated[drive] {
                measurement.saturated.push(channel);
            }
            if self.amplitude_only {
                *value = value.abs();
            }
        }
        measurement.saturated.sort_unstable();
        measurement.saturated.dedup();
        measurement
    }

    /// The lowest code of a converter is farther from zero by one than the highest.
    fn is_saturated(&self, reading: i32) -> bool {
        i64::from(reading).abs() >= self.full_scale
    }
}
