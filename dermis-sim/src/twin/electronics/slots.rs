//! A frame that is read slot by slot, at times that the caller chooses: what the firmware of an instrument sees.
//!
//! [`Electronics::readings`] gives every slot the same duration and changes the multiplexers at once. Firmware decides
//! how long a slot settles, opens all switches before it closes others, and may change them too early: the converter
//! holds its input some time after the start of a conversion. Each closing switch injects a charge into its line.

use super::Electronics;
use super::settling::{MINUS, PLUS, Slot, Source};
use crate::elementary::{ln, sin};
use crate::random::sample_rng;
use dermis::forward::ElectrodeNetwork;
use dermis::protocol::Pair;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Errors of switches and converter that depend on the timing of the reader.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Switching {
    /// Charge that a closing switch injects into its line, C.
    pub charge_c: f64,
    /// Time from the start of a conversion until the converter holds its input, s.
    pub aperture_s: f64,
}

/// The connection of a slot: the drive, and the electrodes of the inputs; `None` for the reference resistor.
pub type Connection = (Pair, Option<Pair>);

/// A frame in progress.
#[derive(Debug)]
pub struct SlotReader<'a> {
    electronics: &'a Electronics,
    network: ElectrodeNetwork,
    switching: Switching,
    /// White noise of the frame's slots, V.
    noise_v: BTreeMap<Connection, f64>,
    /// Time since the frame began, and the time at which it began, s.
    elapsed_s: f64,
    began_s: f64,
    connection: Option<(Connection, Slot)>,
    lines_v: Option<[f64; 3]>,
}

impl Electronics {
    /// Begins frame `index` of a skin. With the slots of the protocol in their order, each `1 / slot_rate_hz` long, and
    /// no errors of the switches, its readings are those of [`readings`](Self::readings).
    pub(crate) fn slot_reader(&self, network: ElectrodeNetwork, index: u64, switching: Switching) -> SlotReader<'_> {
        SlotReader {
            noise_v: self.noise_of_slots(index),
            electronics: self,
            network,
            switching,
            elapsed_s: 0.0,
            began_s: self.time_s(index),
            connection: None,
            lines_v: None,
        }
    }

    /// The white noise of the slots of frame `index`, V.
    fn noise_of_slots(&self, index: u64) -> BTreeMap<Connection, f64> {
        let Some(noise) = self.noise else { return BTreeMap::new() };
        let (drives, channels) = (self.drives.len(), self.protocol.channels());
        let drawn = noise.readings(drives, channels.len(), &mut sample_rng(self.seed, index));
        let of_drive = |(number, drive): (usize, &super::Drive)| {
            let (pair, current_a) = (drive.pair, drive.calibration_a);
            let values: Vec<(Connection, f64)> = drive
                .channels
                .iter()
                .map(|&channel| ((pair, Some(channels[channel].measure)), current_a * drawn.values_ohm[channel]))
                .chain([((pair, None), current_a * drawn.references_ohm[number])])
                .collect();
            values
        };
        self.drives.iter().enumerate().flat_map(of_drive).collect()
    }

    /// The time after which a slot is settled, s: from any potentials of the lines within the supply, and with the
    /// charge of the switches, its reading is at most `error_v` off.
    pub(crate) fn settling_s(
        &self,
        network: &ElectrodeNetwork,
        connection: Connection,
        switching: Switching,
        error_v: f64,
    ) -> f64 {
        let capacitance_f = self.options.line_capacitance_f;
        if capacitance_f == 0.0 {
            return 0.0;
        }
        let farthest_v = self.options.source_v + switching.charge_c.abs() / capacitance_f;
        self.circuit(network, connection).settling_s(capacitance_f, error_v / farthest_v)
    }

    /// A settling time that is enough for any slot, whatever its electrodes, s: with the slowest time constant that the
    /// resistances between the electrodes allow, and errors of all three lines that add up, to half of the smallest
    /// step.
    pub(crate) fn longest_settling_s(&self, network: &ElectrodeNetwork, switching: Switching) -> f64 {
        let capacitance_f = self.options.line_capacitance_f;
        let Some(adc) = self.options.adc.filter(|_| capacitance_f > 0.0) else { return 0.0 };
        let s = &network.transfer_impedance;
        let electrodes = || 0..self.protocol.electrode_count();
        let between_ohm = |a: usize, b: usize| s.at(a, a) - s.at(a, b) - s.at(b, a) + s.at(b, b);
        let skin_ohm = electrodes().flat_map(|a| electrodes().map(move |b| between_ohm(a, b))).fold(0.0, f64::max);
        let on_ohm = self.on_ohm.iter().flatten().copied().fold(0.0, f64::max);
        // The trace of the lines' resistances bounds the largest time constant.
        let slowest_s = capacitance_f * 3.0 * (skin_ohm + 2.0 * on_ohm);
        let gain = adc.gain.max(adc.gain_driven).max(adc.gain_reference);
        let farthest_v = self.options.source_v + switching.charge_c.abs() / capacitance_f;
        // Norms of the difference of two lines and of the errors of three.
        slowest_s * ln(6f64.sqrt() * farthest_v / (0.5 * adc.step_v(gain)))
    }

    /// Half a step of the converter for a reading of a connection, V; `None` without a converter.
    pub fn half_step_v(&self, (drive, measure): Connection) -> Option<f64> {
        self.options.adc.map(|adc| 0.5 * adc.step_v(adc.gain_of(drive, measure)))
    }

    fn circuit(&self, network: &ElectrodeNetwork, (drive, measure): Connection) -> Slot {
        let source = Source { voltage_v: self.options.source_v, reference_ohm: self.options.reference_ohm };
        let joined = self.joined(drive, measure);
        match measure {
            None => Slot::referring(network, source, &joined),
            Some(_) => Slot::measuring(network, source, &joined),
        }
    }
}

impl SlotReader<'_> {
    /// Opens the switches and closes those of a slot. The first slot of a frame is connected in the settled state: the
    /// multiplexers have been there since the frame before.
    ///
    /// # Panics
    /// If the skin does not have the electrodes.
    pub fn connect(&mut self, connection: Connection) {
        let circuit = self.electronics.circuit(&self.network, connection);
        let injected_v = match self.electronics.options.line_capacitance_f {
            capacitance_f if capacitance_f > 0.0 => self.switching.charge_c / capacitance_f,
            _ => 0.0,
        };
        let lines_v = self.lines_v.map(|lines_v| lines_v.map(|line_v| line_v + injected_v));
        self.lines_v = Some(lines_v.unwrap_or(circuit.steady_v));
        self.connection = Some((connection, circuit));
    }

    /// Lets the lines settle.
    pub fn wait(&mut self, duration_s: f64) {
        self.elapsed_s += duration_s;
        if let (Some((_, circuit)), Some(lines_v)) = (&self.connection, self.lines_v) {
            self.lines_v = Some(match self.electronics.options.line_capacitance_f {
                capacitance_f if capacitance_f > 0.0 => circuit.settle(lines_v, capacitance_f, duration_s),
                _ => circuit.steady_v,
            });
        }
    }

    /// The voltage between the amplifier's inputs, V; 0 before the first connection.
    pub(crate) fn input_v(&self) -> f64 {
        self.lines_v.map_or(0.0, |lines_v| lines_v[PLUS] - lines_v[MINUS])
    }

    /// Starts a conversion, which holds its input after the aperture time. Returns the reading at the amplifier's input
    /// as [`Readings`](super::Readings) has it, V, and whether it is out of range.
    pub fn convert(&mut self) -> (f64, bool) {
        self.wait(self.switching.aperture_s);
        let Some(((drive, measure), _)) = self.connection else { return (0.0, false) };
        let options = &self.electronics.options;
        let mut value_v = self.input_v();
        if measure.is_some() {
            // The reference resistor is on the board, where there is no hum; its gain is the measure of the others.
            let hum_v = options.hum.map_or(0.0, |hum| {
                let time_s = self.began_s + self.elapsed_s;
                hum.amplitude_v * sin(TAU * hum.frequency_hz * time_s + self.electronics.hum_phase_rad)
            });
            value_v = (value_v + hum_v) * (1.0 + options.gain_error);
        }
        value_v += self.noise_v.get(&(drive, measure)).copied().unwrap_or(0.0);
        options.adc.map_or((value_v, false), |adc| adc.convert(value_v, adc.gain_of(drive, measure)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin::TwinOptions;
    use crate::twin::electronics::AdcOptions;
    use dermis::design::SkinDesign;
    use dermis::forward::ForwardModel;
    use dermis::mesh::Mesh;
    use std::sync::LazyLock;

    static SKIN: LazyLock<(SkinDesign, ForwardModel)> = LazyLock::new(|| {
        let design = SkinDesign::shipped("cylinder30").unwrap();
        let mesh = Mesh::generate(&design).unwrap();
        let forward = ForwardModel::new(&design, &mesh).unwrap();
        (design, forward)
    });

    fn network(sheet_resistance_ohm: f64) -> ElectrodeNetwork {
        SKIN.1.network(&vec![1.0 / sheet_resistance_ohm; SKIN.1.mesh().cell_count()]).unwrap()
    }

    /// The laboratory's instrument, with a converter of so many bits.
    fn instrument(bits: u32) -> Electronics {
        let mut options = TwinOptions::shipped("lab").unwrap().electronics;
        options.adc = options.adc.map(|adc| AdcOptions { bits, ..adc });
        Electronics::new(&options, &SKIN.0.protocol, &network(1e3), 3).unwrap()
    }

    /// Reads all slots, each after a time that depends on its connection.
    fn read(
        reader: &mut SlotReader<'_>,
        electronics: &Electronics,
        wait_s: impl Fn(Connection) -> f64,
    ) -> (Vec<f64>, Vec<f64>) {
        let channels = electronics.protocol.channels();
        let (mut values_v, mut references_v) = (vec![0.0; channels.len()], Vec::new());
        let mut slot = |connection| {
            reader.connect(connection);
            reader.wait(wait_s(connection));
            reader.convert().0
        };
        for drive in &electronics.drives {
            references_v.push(slot((drive.pair, None)));
            for &channel in &drive.channels {
                values_v[channel] = slot((drive.pair, Some(channels[channel].measure)));
            }
        }
        (values_v, references_v)
    }

    #[test]
    fn slots_of_the_usual_duration_give_the_usual_readings() {
        for (sheet_resistance_ohm, hum) in [(1e3, false), (20e3, false), (1e3, true)] {
            let network = network(sheet_resistance_ohm);
            let mut electronics = instrument(12);
            electronics.options.hum = hum.then_some(super::super::HumOptions { amplitude_v: 0.01, frequency_hz: 50.0 });
            let usual = electronics.readings(&network, 5);
            let mut reader = electronics.slot_reader(network, 5, Switching::default());
            let slot_s = 1.0 / electronics.options.slot_rate_hz;
            let (values_v, references_v) = read(&mut reader, &electronics, |_| slot_s);
            assert_eq!(values_v, usual.values_v);
            assert_eq!(references_v, usual.references_v);
        }
    }

    /// After its settling time a reading is within half a step of the settled one, and half that time is not enough.
    #[test]
    fn settled_slots_are_within_half_a_step() {
        let charge = Switching { charge_c: 1e-12, aperture_s: 0.0 };
        for sheet_resistance_ohm in [1e3, 5e3, 20e3] {
            let (network, mut electronics) = (network(sheet_resistance_ohm), instrument(16));
            let slots: Vec<Connection> = electronics.noise_of_slots(0).into_keys().collect();
            let half_steps_v: BTreeMap<Connection, f64> =
                slots.iter().map(|&slot| (slot, electronics.half_step_v(slot).unwrap())).collect();
            let settling_s = |&slot: &Connection| electronics.settling_s(&network, slot, charge, half_steps_v[&slot]);
            let wait_s: BTreeMap<Connection, f64> = slots.iter().map(|slot| (*slot, settling_s(slot))).collect();
            (electronics.options.adc, electronics.noise, electronics.options.gain_error) = (None, None, 0.0);
            let settled = electronics.settled(&network);
            let worst_at = |share: f64| {
                let mut reader = electronics.slot_reader(network.clone(), 0, charge);
                let (values_v, references_v) = read(&mut reader, &electronics, |slot| share * wait_s[&slot]);
                let mut worst = 0.0f64;
                for (number, drive) in electronics.drives.iter().enumerate() {
                    let off_v = references_v[number] - settled.references_v[number];
                    worst = worst.max((off_v / half_steps_v[&(drive.pair, None)]).abs());
                    for &channel in &drive.channels {
                        let off_v = values_v[channel] - settled.values_v[channel];
                        let measure = electronics.protocol.channels()[channel].measure;
                        worst = worst.max((off_v / half_steps_v[&(drive.pair, Some(measure))]).abs());
                    }
                }
                worst
            };
            let (full, half) = (worst_at(1.0), worst_at(0.4));
            let mut all: Vec<f64> = wait_s.values().copied().collect();
            all.sort_by(f64::total_cmp);
            println!(
                "{:4.0} ohm per square: slots settle in {:.2} us (median), {:.2} us (longest), {:.2} ms in all; error {full:.2} \
                 of half a step, {half:.0} after 0.4 of the time",
                sheet_resistance_ohm,
                1e6 * all[450],
                1e6 * all[899],
                1e3 * all.iter().sum::<f64>()
            );
            assert!(full <= 1.0 && half > 1.0, "{full} and {half} half steps");
        }
    }

    #[test]
    fn charge_and_a_late_hold_are_felt() {
        let (network, mut electronics) = (network(1e3), instrument(16));
        (electronics.options.adc, electronics.noise) = (None, None);
        let slots = [([0, 1], None), ([0, 1], Some([4, 5])), ([0, 1], Some([10, 11]))];
        let last_v = |switching, wait_s| {
            let mut reader = electronics.slot_reader(network.clone(), 0, switching);
            let mut read_v = 0.0;
            for slot in slots {
                reader.connect(slot);
                reader.wait(wait_s);
                read_v = reader.convert().0;
            }
            read_v
        };
        let none = Switching::default();
        let settled_v = last_v(none, 1.0);
        // 1 pC on 150 pF are 6.7 mV on both inputs, which differ in their time constants; 0.2 us later much is left.
        let off_v = (last_v(Switching { charge_c: 1e-12, ..none }, 2e-7) - last_v(none, 2e-7)).abs();
        assert!(off_v > 1e-6 && off_v < 6.7e-3, "{off_v} V");
        // The converter that holds later has settled further.
        let early_v = (last_v(none, 2e-7) - settled_v).abs();
        let held_v = (last_v(Switching { aperture_s: 2e-7, ..none }, 2e-7) - settled_v).abs();
        assert!(held_v < 0.7 * early_v, "{held_v} after {early_v}");
    }
}
