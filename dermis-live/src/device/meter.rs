//! From readings to ohm.

use crate::device::{Role, ScanTable};
use dermis::pipeline::Measurement;
use dermis::protocol::Protocol;
use dermis_wire::{Hello, Readings};

/// Turns the readings of one device into the values of a frame.
///
/// Each drive's current is read across the reference resistor, `I = V_ref / R_ref`; a value is the voltage read over it.
#[derive(Debug, Clone)]
pub struct Meter {
    roles: Vec<Role>,
    /// For each channel its drive and the volts of a count.
    channels: Vec<(usize, f64)>,
    drive_count: usize,
    volts_per_reference_count: f64,
    reference_ohm: f64,
    source_v: f64,
    full_scale: i64,
    reading_bytes: u8,
    /// The design takes the instrument for one that loses signs, as its linear models and networks do.
    amplitude_only: bool,
}

impl Meter {
    /// For the readings of a device.
    pub fn new(hello: &Hello<'_>, scan: &ScanTable, protocol: &Protocol) -> Self {
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

    /// Whether readings are a frame of the device: as many, and as wide, as its hello says.
    pub fn takes(&self, readings: &Readings<'_>) -> bool {
        readings.len() == self.roles.len() && readings.reading_bytes() == self.reading_bytes
    }

    /// The readings of a frame as ohm. A current of zero counts as the least that the converter tells from it, so that the
    /// values of a drive through a torn wire are large but finite. Of a protocol of amplitudes the values have no sign, whether or
    /// not the device sends one.
    ///
    /// # Panics
    /// Where there is not a reading for each slot.
    pub fn measure(&self, readings: Readings<'_>) -> Measurement {
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

    /// The lowest code of a converter is one farther from zero than the highest.
    fn is_saturated(&self, reading: i32) -> bool {
        i64::from(reading).abs() >= self.full_scale
    }
}
