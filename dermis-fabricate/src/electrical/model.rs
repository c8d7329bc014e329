//! The electrical model of an untouched skin and its reader: every table and the netlist are written from it.

use crate::electrical::reader::{self, LONGEST_WAIT_S, OVERHEAD_S, REFERENCE_TOLERANCE, SWITCHING};
use crate::electrical::spread::{Sensitivities, Value};
use crate::error::FabricateError;
use dermis::design::SkinDesign;
use dermis::forward::{ElectrodeNetwork, ForwardModel};
use dermis::mesh::Mesh;
use dermis::protocol::{MultiplexerInput, Pair, Protocol, ScanSlot};
use dermis_sim::twin::electronics::{ElectronicsOptions, SettlingPlan};

/// An untouched skin, its reader, and what it reads.
#[derive(Debug, Clone)]
pub struct Electrical {
    /// The mesh of the model.
    pub mesh: Mesh,
    /// The electronics.
    pub electronics: ElectronicsOptions,
    /// The skin between its electrodes.
    pub network: ElectrodeNetwork,
    /// The place of each electrode on the multiplexers.
    pub places: Vec<MultiplexerInput>,
    /// Multiplexers on each line.
    pub multiplexers: usize,
    /// The readings, in the order of the scan table.
    pub readings: Vec<Reading>,
}

/// A reading of the untouched skin.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// What is connected.
    pub slot: ScanSlot,
    /// The voltage over the drive's current, ohm; `None` for a reading of the reference resistor.
    pub ohm: Option<Value>,
    /// The voltage at the amplifier's input, V.
    pub volt: Value,
    /// How long its lines settle, s.
    pub wait_s: f64,
}

impl Electrical {
    /// The model of a design.
    ///
    /// # Errors
    /// A design that cannot be meshed or solved; a reading that does not settle within the longest wait of the reader.
    pub fn new(design: &SkinDesign) -> Result<Self, FabricateError> {
        let mesh = Mesh::generate(design)?;
        let model = ForwardModel::new(design, &mesh)?;
        let network = model.network(model.rest_conductivity()).map_err(dermis::Error::from)?;
        let electronics = reader::electronics(&design.protocol);
        let plan = SettlingPlan::new(&electronics, &design.protocol, &network, SWITCHING)?;
        check_waits(design, &plan.waits_s)?;
        let places = design.multiplexer_inputs();
        let needed = places.iter().map(|place| place.multiplexer + 1).max().unwrap_or(1);
        let readings = readings(design, &mesh, &electronics, &plan.waits_s)?;
        let multiplexers = design.fabrication_options().multiplexers.unwrap_or(needed);
        Ok(Electrical { mesh, electronics, network, places, multiplexers, readings })
    }

    /// Frames that the slots allow a second, Hz: at most those of the electronics.
    pub fn frame_rate_hz(&self) -> f64 {
        let frame_s: f64 = self.readings.iter().map(|reading| reading.wait_s + OVERHEAD_S).sum();
        self.electronics.frame_rate_hz.min(1.0 / frame_s)
    }
}

fn check_waits(design: &SkinDesign, waits_s: &[f64]) -> Result<(), FabricateError> {
    let slots = design.protocol.scan();
    let longest = waits_s.iter().zip(&slots).enumerate().max_by(|a, b| a.1.0.total_cmp(b.1.0));
    match longest {
        Some((slot, (&wait_s, ScanSlot { drive: [source, sink], .. }))) if wait_s > LONGEST_WAIT_S => {
            let message = format!(
                "with a sheet resistance of {:.0} ohm per square the reading of slot {slot} (electrodes {source} and {sink} \
                 driven) settles in {:.1} ms, and the reader waits {:.0} ms at most",
                1.0 / design.sheet.conductance,
                1e3 * wait_s,
                1e3 * LONGEST_WAIT_S
            );
            Err(FabricateError::part(message, "make `sheet_resistance_ohm` or the contact impedance smaller"))
        }
        _ => Ok(()),
    }
}

/// Channels that are differentiated at a time: the derivatives then take at most about 160 MB.
fn block(electrode_count: usize) -> usize {
    (20_000_000 / electrode_count).max(1)
}

fn readings(
    design: &SkinDesign,
    mesh: &Mesh,
    electronics: &ElectronicsOptions,
    waits_s: &[f64],
) -> Result<Vec<Reading>, FabricateError> {
    let protocol = &design.protocol;
    let options = design.fabrication_options();
    let drives: Vec<dermis::protocol::Channel> =
        protocol.drives().0.iter().map(|&pair| dermis::protocol::Channel { drive: pair, measure: pair }).collect();
    let of_drives = Sensitivities::of(design, mesh, drives)?;
    let mut of_channels = Vec::with_capacity(protocol.channel_count());
    for channels in protocol.channels().chunks(block(protocol.electrode_count())) {
        of_channels.extend(Sensitivities::of(design, mesh, channels.to_vec())?);
    }
    let number_of = |drive: Pair| protocol.drives().0.iter().position(|pair| *pair == drive);
    let mut reading = Vec::with_capacity(waits_s.len());
    let mut current: Option<(Pair, crate::electrical::spread::Loop)> = None;
    for (slot, &wait_s) in protocol.scan().into_iter().zip(waits_s) {
        if current.as_ref().is_none_or(|(drive, _)| *drive != slot.drive) {
            let number = number_of(slot.drive).expect("a slot's drive is one of the protocol's");
            current = Some((slot.drive, of_drives[number].in_loop(electronics)));
        }
        let (_, circuit) = current.as_ref().expect("set above");
        reading.push(match slot.measure {
            None => Reading { slot, ohm: None, volt: circuit.reference(&options, REFERENCE_TOLERANCE), wait_s },
            Some((_, channel)) => {
                let own = &of_channels[channel];
                let shown = |value: Value| if protocol.amplitude_only() { value.without_sign() } else { value };
                Reading {
                    slot,
                    ohm: Some(shown(own.ohm(&options, REFERENCE_TOLERANCE))),
                    volt: shown(circuit.voltage(own, &options, REFERENCE_TOLERANCE)),
                    wait_s,
                }
            }
        });
    }
    Ok(reading)
}

/// A protocol of some channels.
pub(super) fn protocol_of(design: &SkinDesign, channels: Vec<dermis::protocol::Channel>) -> Protocol {
    Protocol::new(design.electrodes.len(), channels).expect("pairs of a valid protocol")
}
