//! The instrument: from the network between the electrodes to the readings of a frame.
//!
//! A constant voltage drives each pair of electrodes through a reference resistor and two multiplexers; two more
//! connect the amplifier's inputs to the electrodes. A frame is a list of slots: for each drive one slot for its
//! current across the reference resistor, then one for each of its values. A reading is the settled voltage of the
//! lines, plus mains hum, times the gain, plus white noise, rounded by the converter; a value is the reading over the
//! measured current,
//!
//! `v = reading / (reference reading / R_ref)`.
//!
//! Frame `i` starts at `i / frame_rate`, and its noise depends only on the seed and `i`. Before a frame starts the
//! multiplexers are in the position of its first slot, so that no frame depends on another.

mod options;
mod plan;
mod report;
mod settling;
mod slots;
#[cfg(test)]
mod tests;

pub use options::{AdcOptions, ElectronicsOptions, HumOptions};
pub(super) use options::{not_negative, out_of_range, positive};
pub use plan::SettlingPlan;
pub use report::{ElectronicsReport, ErrorPart};
pub use slots::{Connection, SlotReader, Switching};

use crate::elementary::sin;
use crate::noise::Noise;
use crate::random::{sample_rng, standard_normal};
use dermis::forward::ElectrodeNetwork;
use dermis::frame::Frame;
use dermis::protocol::{Pair, Protocol};
use rand::RngExt;
use settling::{Joined, MINUS, PLUS, SOURCE, Slot, Source};
use std::f64::consts::TAU;

/// The random stream of the instrument's multiplexers and of the phase of the hum. Frames have the streams of their
/// indices.
const BIRTH_STREAM: u64 = u64::MAX;

/// One instrument: its multiplexers drawn, its noise calibrated on the untouched skin.
#[derive(Debug, Clone)]
pub struct Electronics {
    options: ElectronicsOptions,
    protocol: Protocol,
    drives: Vec<Drive>,
    /// On-resistances of the four multiplexers (source, plus, minus, ground), one per electrode; those of the two
    /// inputs have one more, for the reference resistor. Ohm.
    on_ohm: [Vec<f64>; 4],
    hum_phase_rad: f64,
    seed: u64,
    noise: Option<Noise>,
    signal_ohm: f64,
}

/// One drive of a frame.
#[derive(Debug, Clone)]
struct Drive {
    pair: Pair,
    /// Its values, by their index in the frame.
    channels: Vec<usize>,
    /// The current for the definition of its noise: that through the untouched skin, A.
    calibration_a: f64,
    /// Its reference resistor, ohm; the instrument takes it for that of the options.
    reference_ohm: f64,
}

/// Index of the ground multiplexer; the others are in the order of the lines.
const GROUND: usize = 3;

/// The readings of a frame at the amplifier's input, after conversion.
#[derive(Debug, Clone)]
pub struct Readings {
    /// The readings of its values, in their order; V.
    pub values_v: Vec<f64>,
    /// The readings of the reference resistor for each drive, in the order of [`Protocol::drives`]; V.
    pub references_v: Vec<f64>,
    /// Number of readings that were out of the converter's range.
    pub saturated: usize,
}

/// The stages of the instrument; each stage includes those before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Stage {
    Ideal,
    Settling,
    Hum,
    Gain,
    Noise,
    Quantisation,
}

impl Electronics {
    /// An instrument for a protocol. Its noise is specified in dB of the frame of `untouched`, the untouched skin
    /// without faults.
    ///
    /// # Errors
    /// Options out of their ranges; a noise in dB if every value has a driven electrode.
    pub fn new(
        options: &ElectronicsOptions,
        protocol: &Protocol,
        untouched: &ElectrodeNetwork,
        seed: u64,
    ) -> crate::Result<Self> {
        options.check(protocol)?;
        let mut rng = sample_rng(seed, BIRTH_STREAM);
        let electrode_count = protocol.electrode_count();
        let on_ohm = [electrode_count, electrode_count + 1, electrode_count + 1, electrode_count].map(|count| {
            let spread = |_| options.on_resistance_spread_ohm * standard_normal(&mut rng);
            (0..count).map(spread).map(|off| (options.on_resistance_ohm + off).max(0.0)).collect()
        });
        let hum_phase_rad = rng.random::<f64>() * TAU;
        let (pairs, drive_of) = protocol.drives();
        let drive = |(index, &pair): (usize, &Pair)| Drive {
            pair,
            channels: (0..drive_of.len()).filter(|&channel| drive_of[channel] == index).collect(),
            calibration_a: 0.0,
            reference_ohm: options.reference_ohm,
        };
        let clean = untouched.frame(protocol);
        let noise = options.snr_db.map(|snr_db| Noise::at_snr_db(snr_db, &clean, protocol, options.reference_ohm));
        let mut electronics = Electronics {
            options: options.clone(),
            protocol: protocol.clone(),
            drives: pairs.iter().enumerate().map(drive).collect(),
            on_ohm,
            hum_phase_rad,
            seed,
            noise: noise.transpose()?,
            signal_ohm: protocol.undriven_rms(&clean),
        };
        for index in 0..electronics.drives.len() {
            electronics.drives[index].calibration_a = electronics.current_a(untouched, &electronics.drives[index]);
        }
        Ok(electronics)
    }

    /// Other reference resistors than the options say, unknown to the instrument: each drive's over the expected one.
    pub(super) fn replace_references(&mut self, factor: impl Fn(usize) -> f64) {
        for (index, drive) in self.drives.iter_mut().enumerate() {
            drive.reference_ohm = factor(index) * self.options.reference_ohm;
        }
    }

    /// Its options.
    pub fn options(&self) -> &ElectronicsOptions {
        &self.options
    }

    /// The white noise of its readings, in ohm at the current through the untouched skin; `None` if there is none.
    pub fn noise(&self) -> Option<Noise> {
        self.noise
    }

    /// Start time of a frame, s.
    pub fn time_s(&self, index: u64) -> f64 {
        index as f64 / self.options.frame_rate_hz
    }

    /// Frame `index` of a skin, ohm.
    pub fn frame(&self, network: &ElectrodeNetwork, index: u64) -> Frame {
        self.values(&self.readings(network, index))
    }

    /// The readings of frame `index` of a skin.
    pub fn readings(&self, network: &ElectrodeNetwork, index: u64) -> Readings {
        self.through(network, index, Stage::Quantisation)
    }

    /// Converter step in volts, for readings without a driven electrode, for those with one, and for those of the
    /// reference resistor; `None` without a converter.
    pub fn volts_per_count(&self) -> Option<[f64; 3]> {
        self.options.adc.map(|adc| [adc.gain, adc.gain_driven, adc.gain_reference].map(|gain| adc.step_v(gain)))
    }

    /// The readings of a frame up to a stage.
    fn through(&self, network: &ElectrodeNetwork, index: u64, last: Stage) -> Readings {
        let settles = self.options.line_capacitance_f > 0.0 && last >= Stage::Settling;
        let mut readings = if settles { self.settling(network) } else { self.settled(network) };
        if let (Some(hum), true) = (self.options.hum, last >= Stage::Hum) {
            self.add_hum(hum, index, &mut readings);
        }
        if last >= Stage::Gain {
            readings.values_v.iter_mut().for_each(|value_v| *value_v *= 1.0 + self.options.gain_error);
        }
        if let (Some(noise), true) = (self.noise, last >= Stage::Noise) {
            self.add_noise(noise, index, &mut readings);
        }
        if let (Some(adc), true) = (self.options.adc, last >= Stage::Quantisation) {
            self.convert(adc, &mut readings);
        }
        readings
    }

    /// The readings over the measured currents. A current of zero (a broken wire with a coarse converter) counts as
    /// half a step of the converter, so that the values are large but finite.
    pub fn values(&self, readings: &Readings) -> Frame {
        let least_v = self.options.adc.map_or(f64::MIN_POSITIVE, |adc| 0.5 * adc.step_v(adc.gain_reference));
        let mut values = vec![0.0; self.protocol.channel_count()];
        for (drive, &reference_v) in self.drives.iter().zip(&readings.references_v) {
            let reference_v = if reference_v.abs() < least_v { least_v } else { reference_v };
            for &channel in &drive.channels {
                values[channel] = readings.values_v[channel] / reference_v * self.options.reference_ohm;
            }
        }
        Frame(values)
    }

    /// The current of a drive in the settled state, A.
    fn current_a(&self, network: &ElectrodeNetwork, drive: &Drive) -> f64 {
        let [source, sink] = drive.pair;
        let s = &network.transfer_impedance;
        let skin_ohm = (s.at(source, source) - s.at(source, sink)) - (s.at(sink, source) - s.at(sink, sink));
        let way_ohm = self.on_ohm[SOURCE][source] + self.on_ohm[GROUND][sink] + drive.reference_ohm;
        self.options.source_v / (way_ohm + skin_ohm)
    }

    /// The readings of lines that settle immediately.
    fn settled(&self, network: &ElectrodeNetwork) -> Readings {
        let mut values_v = network.frame(&self.protocol).0;
        let mut references_v = Vec::with_capacity(self.drives.len());
        for drive in &self.drives {
            let current_a = self.current_a(network, drive);
            references_v.push(current_a * drive.reference_ohm);
            drive.channels.iter().for_each(|&channel| values_v[channel] *= current_a);
        }
        Readings { values_v, references_v, saturated: 0 }
    }

    /// The readings at the ends of their slots.
    fn settling(&self, network: &ElectrodeNetwork) -> Readings {
        let (capacitance_f, slot_s) = (self.options.line_capacitance_f, 1.0 / self.options.slot_rate_hz);
        let channels = self.protocol.channels();
        let mut values_v = vec![0.0; channels.len()];
        let mut references_v = Vec::with_capacity(self.drives.len());
        let mut lines_v = None;
        for drive in &self.drives {
            let source = Source { voltage_v: self.options.source_v, reference_ohm: drive.reference_ohm };
            let slot = Slot::referring(network, source, &self.joined(drive.pair, None));
            let settled = slot.settle(lines_v.unwrap_or(slot.steady_v), capacitance_f, slot_s);
            references_v.push(settled[PLUS] - settled[MINUS]);
            let mut before = settled;
            for &channel in &drive.channels {
                let slot = Slot::measuring(network, source, &self.joined(drive.pair, Some(channels[channel].measure)));
                before = slot.settle(before, capacitance_f, slot_s);
                values_v[channel] = before[PLUS] - before[MINUS];
            }
            lines_v = Some(before);
        }
        Readings { values_v, references_v, saturated: 0 }
    }

    /// The connection of a slot to the skin; without a measure pair the inputs are on the reference resistor.
    fn joined(&self, [source, sink]: Pair, measure: Option<Pair>) -> Joined {
        let reference = self.protocol.electrode_count();
        let input = measure.unwrap_or([reference; 2]);
        Joined {
            electrodes: [source, input[0], input[1]],
            on_ohm: [self.on_ohm[SOURCE][source], self.on_ohm[PLUS][input[0]], self.on_ohm[MINUS][input[1]]],
            sink,
            sink_on_ohm: self.on_ohm[GROUND][sink],
        }
    }

    /// Adds the mains hum in the skin at the time of each reading. The reference resistor, on the board, has no hum.
    fn add_hum(&self, hum: HumOptions, index: u64, readings: &mut Readings) {
        let mut slot = 0;
        for drive in &self.drives {
            slot += 1;
            for &channel in &drive.channels {
                slot += 1;
                let time_s = self.time_s(index) + f64::from(slot) / self.options.slot_rate_hz;
                readings.values_v[channel] +=
                    hum.amplitude_v * sin(TAU * hum.frequency_hz * time_s + self.hum_phase_rad);
            }
        }
    }

    fn add_noise(&self, noise: Noise, index: u64, readings: &mut Readings) {
        let drawn = noise.readings(self.drives.len(), readings.values_v.len(), &mut sample_rng(self.seed, index));
        for (number, drive) in self.drives.iter().enumerate() {
            readings.references_v[number] += drive.calibration_a * drawn.references_ohm[number];
            for &channel in &drive.channels {
                readings.values_v[channel] += drive.calibration_a * drawn.values_ohm[channel];
            }
        }
    }

    /// Rounds every reading to the converter's steps.
    fn convert(&self, adc: AdcOptions, readings: &mut Readings) {
        let Readings { values_v, references_v, saturated } = readings;
        let mut convert = |value_v: &mut f64, gain: f64| {
            let (converted_v, out) = adc.convert(*value_v, gain);
            *value_v = converted_v;
            *saturated += usize::from(out);
        };
        references_v.iter_mut().for_each(|value_v| convert(value_v, adc.gain_reference));
        for (value_v, channel) in values_v.iter_mut().zip(self.protocol.channels()) {
            convert(value_v, if channel.touches_driven() { adc.gain_driven } else { adc.gain });
        }
    }
}
