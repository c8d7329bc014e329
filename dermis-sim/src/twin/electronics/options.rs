//! Options of an instrument, as in a twin's file.

use crate::twin::TwinError;
use dermis::protocol::{Pair, Protocol};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The instrument. Missing tables and keys mean no error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ElectronicsOptions {
    /// Voltage of the constant source, V.
    pub source_v: f64,
    /// Resistor in series with the source, across which each drive's current is measured, ohm.
    pub reference_ohm: f64,
    /// Resistance of a closed switch of the multiplexers, ohm.
    pub on_resistance_ohm: f64,
    /// Standard deviation of that resistance from switch to switch, ohm.
    pub on_resistance_spread_ohm: f64,
    /// Capacitance of the source line and of each input of the amplifier, to ground, F. With 0 they settle immediately.
    pub line_capacitance_f: f64,
    /// Readings per second, Hz: a slot has the inverse as its duration, and the reading is sampled at the slot's end.
    pub slot_rate_hz: f64,
    /// Frames per second, Hz.
    pub frame_rate_hz: f64,
    /// Relative error of the amplifier's gain against that of the reference reading.
    pub gain_error: f64,
    /// White noise of every reading: the signal-to-noise ratio in dB (20 log10 r/s, see the conventions).
    pub snr_db: Option<f64>,
    /// The converter.
    pub adc: Option<AdcOptions>,
    /// Mains hum in the skin.
    pub hum: Option<HumOptions>,
}

/// A converter behind an amplifier whose gain is switched with the multiplexers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AdcOptions {
    /// Bits of a reading, its sign included.
    pub bits: u32,
    /// The input range is from minus this to plus this, V.
    pub range_v: f64,
    /// Gain before the converter for readings without a driven electrode.
    pub gain: f64,
    /// Gain for readings with a driven electrode.
    pub gain_driven: f64,
    /// Gain for readings of the current.
    pub gain_reference: f64,
}

/// Mains hum in the skin between any two electrodes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HumOptions {
    /// Amplitude at the amplifier's input, V.
    pub amplitude_v: f64,
    /// Frequency of the mains, Hz.
    pub frequency_hz: f64,
}

impl AdcOptions {
    /// Voltage at the amplifier's input from one code to the next.
    pub(super) fn step_v(&self, gain: f64) -> f64 {
        self.range_v / gain / 2f64.powi(self.bits as i32 - 1)
    }

    /// The gain with which a drive is read between two inputs; `None` for the reference resistor.
    pub(super) fn gain_of(&self, drive: Pair, measure: Option<Pair>) -> f64 {
        match measure {
            None => self.gain_reference,
            Some(inputs) if inputs.iter().any(|input| drive.contains(input)) => self.gain_driven,
            Some(_) => self.gain,
        }
    }

    /// The voltage of a reading's code (from `-2^(bits - 1)` to `2^(bits - 1) - 1`), and whether it was out of range.
    pub(super) fn convert(&self, value_v: f64, gain: f64) -> (f64, bool) {
        let step_v = self.step_v(gain);
        let half = 2f64.powi(self.bits as i32 - 1);
        let code = (value_v / step_v).round_ties_even();
        let kept = code.clamp(-half, half - 1.0);
        (kept * step_v, kept != code)
    }
}

impl ElectronicsOptions {
    /// An instrument without errors: 1 V through 1 kohm, 120 frames per second.
    pub fn ideal() -> Self {
        ElectronicsOptions {
            source_v: 1.0,
            reference_ohm: 1000.0,
            on_resistance_ohm: 0.0,
            on_resistance_spread_ohm: 0.0,
            line_capacitance_f: 0.0,
            slot_rate_hz: 120e3,
            frame_rate_hz: 120.0,
            gain_error: 0.0,
            snr_db: None,
            adc: None,
            hum: None,
        }
    }

    /// Refuses invalid options, and a frame that is longer than the frame interval.
    ///
    /// # Errors
    /// The wrong field, its value and the fix.
    pub fn check(&self, protocol: &Protocol) -> Result<(), TwinError> {
        self.check_ranges()?;
        let slots = protocol.channel_count() + protocol.drives().0.len();
        let most_hz = self.slot_rate_hz / slots as f64;
        if self.frame_rate_hz > most_hz * (1.0 + 1e-9) {
            let must = format!("at most {most_hz:.3}: {slots} readings at {} a second", self.slot_rate_hz);
            let field = "electronics.frame_rate_hz";
            return Err(out_of_range(field, self.frame_rate_hz, must, "read faster, or take fewer frames a second"));
        }
        Ok(())
    }

    /// [`check`](Self::check) without the protocol.
    pub(in crate::twin) fn check_ranges(&self) -> Result<(), TwinError> {
        positive("electronics.source_v", self.source_v)?;
        positive("electronics.reference_ohm", self.reference_ohm)?;
        not_negative("electronics.on_resistance_ohm", self.on_resistance_ohm)?;
        not_negative("electronics.on_resistance_spread_ohm", self.on_resistance_spread_ohm)?;
        not_negative("electronics.line_capacitance_f", self.line_capacitance_f)?;
        positive("electronics.slot_rate_hz", self.slot_rate_hz)?;
        positive("electronics.frame_rate_hz", self.frame_rate_hz)?;
        if 3.0 * self.on_resistance_spread_ohm > self.on_resistance_ohm {
            let must = format!("at most a third of on_resistance_ohm, {}", self.on_resistance_ohm);
            let (field, value) = ("electronics.on_resistance_spread_ohm", self.on_resistance_spread_ohm);
            return Err(out_of_range(field, value, must, "no switch has a negative resistance"));
        }
        if self.line_capacitance_f > 1e-6 {
            let (must, fix) = ("at most 1e-6".to_string(), "the unit is farad: 150 pF are 150e-12");
            return Err(out_of_range("electronics.line_capacitance_f", self.line_capacitance_f, must, fix));
        }
        if self.gain_error.is_nan() || self.gain_error.abs() >= 1.0 {
            let (must, fix) = ("between -1 and 1".to_string(), "a relative error: 0.002 is 0.2 %");
            return Err(out_of_range("electronics.gain_error", self.gain_error, must, fix));
        }
        if let Some(snr_db) = self.snr_db.filter(|snr_db| !(-20.0..=200.0).contains(snr_db)) {
            let (must, fix) = ("between -20 and 200".to_string(), "leave the key out for readings without noise");
            return Err(out_of_range("electronics.snr_db", snr_db, must, fix));
        }
        self.adc.map_or(Ok(()), |adc| adc.check())?;
        self.hum.map_or(Ok(()), |hum| {
            not_negative("electronics.hum.amplitude_v", hum.amplitude_v)?;
            positive("electronics.hum.frequency_hz", hum.frequency_hz)
        })
    }
}

impl AdcOptions {
    fn check(&self) -> Result<(), TwinError> {
        if !(2..=32).contains(&self.bits) {
            let (must, fix) =
                ("2 to 32".to_string(), "leave the table [electronics.adc] out for readings without steps");
            return Err(out_of_range("electronics.adc.bits", f64::from(self.bits), must, fix));
        }
        positive("electronics.adc.range_v", self.range_v)?;
        positive("electronics.adc.gain", self.gain)?;
        positive("electronics.adc.gain_driven", self.gain_driven)?;
        positive("electronics.adc.gain_reference", self.gain_reference)
    }
}

pub(in crate::twin) fn out_of_range(field: &'static str, value: f64, must: String, fix: &str) -> TwinError {
    TwinError::OutOfRange { field, value, must, fix: fix.to_string() }
}

pub(in crate::twin) fn positive(field: &'static str, value: f64) -> Result<(), TwinError> {
    let good = value > 0.0 && value.is_finite();
    if good {
        Ok(())
    } else {
        Err(out_of_range(field, value, "positive and finite".into(), "units are SI, as in the name"))
    }
}

pub(in crate::twin) fn not_negative(field: &'static str, value: f64) -> Result<(), TwinError> {
    let good = value >= 0.0 && value.is_finite();
    if good { Ok(()) } else { Err(out_of_range(field, value, "zero or more, and finite".into(), "0 switches it off")) }
}
