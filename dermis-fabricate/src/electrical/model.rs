//! The electrical model of an untouched skin and its reader: every table and the netlist are written from it.

use crate::electrical::neighbours::{Neighbours, neighbours};
use crate::electrical::range::{self, Range};
use crate::electrical::reader::{self, LONGEST_WAIT_S, OVERHEAD_S, REFERENCE_TOLERANCE, SWITCHING};
use crate::electrical::spread::{Sensitivities, Value};
use crate::error::FabricateError;
use dermis::design::{FabricationOptions, SkinDesign};
use dermis::forward::{ElectrodeNetwork, ForwardModel};
use dermis::geom::Point3;
use dermis::mesh::Mesh;
use dermis::protocol::{Channel, MultiplexerInput, Protocol, ScanSlot};
use dermis_sim::twin::electronics::{ElectronicsOptions, SettlingPlan};

/// An untouched skin, its reader, and what it reads.
#[derive(Debug, Clone)]
pub struct Electrical {
    /// The mesh of the model.
    pub(crate) mesh: Mesh,
    /// The electronics: those of `reader.toml`, with a reference resistor that fits the skin.
    pub(crate) electronics: ElectronicsOptions,
    /// The channels against the range of the electronics; `None` without a converter.
    pub(crate) range: Option<Range>,
    /// The skin between its electrodes.
    pub(crate) network: ElectrodeNetwork,
    /// The place of each electrode on the multiplexers.
    pub(crate) places: Vec<MultiplexerInput>,
    /// Multiplexers on each line.
    pub(crate) multiplexers: usize,
    /// The readings, in the order of the scan table.
    pub(crate) readings: Vec<Reading>,
    /// The resistances between neighbouring electrodes.
    pub(crate) neighbours: Vec<Neighbours>,
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
    /// The model of a design whose electrodes have these centres.
    ///
    /// # Errors
    /// A design that cannot be meshed or solved; a reading that does not settle within the longest wait of the reader.
    pub(crate) fn new(design: &SkinDesign, centres_m: &[Point3]) -> Result<Self, FabricateError> {
        let mesh = Mesh::generate(design)?;
        let model = ForwardModel::new(design, &mesh)?;
        let network = model.network(model.rest_conductivity()).map_err(dermis::Error::from)?;
        let skin = SkinSensitivities::of(design, &mesh)?;
        let (electronics, range) = range::fitted(design, &skin, reader::electronics(&design.protocol));
        let plan = SettlingPlan::new(&electronics, &design.protocol, &network, SWITCHING)?;
        check_waits(design, &plan.waits_s)?;
        let places = design.multiplexer_inputs();
        let needed = places.iter().map(|place| place.multiplexer + 1).max().unwrap_or(1);
        let readings = skin.readings(design, &electronics, &plan.waits_s);
        let multiplexers = design.fabrication_options().multiplexers.unwrap_or(needed);
        let neighbours = neighbours(design, &mesh, centres_m)?;
        Ok(Electrical { mesh, electronics, range, network, places, multiplexers, readings, neighbours })
    }

    /// Frames that the slots allow a second, Hz: at most those of the electronics.
    pub(crate) fn frame_rate_hz(&self) -> f64 {
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

/// The resistances of a skin that its readings depend on.
pub(super) struct SkinSensitivities {
    /// Between the driven electrodes, in the order of the drives.
    pub(super) drives: Vec<Sensitivities>,
    /// Of the channels, in their order.
    channels: Vec<Sensitivities>,
}

impl SkinSensitivities {
    fn of(design: &SkinDesign, mesh: &Mesh) -> Result<Self, FabricateError> {
        let protocol = &design.protocol;
        let drives = protocol.drives().0.iter().map(|&pair| Channel { drive: pair, measure: pair }).collect();
        let mut of_channels = Vec::with_capacity(protocol.channel_count());
        for channels in protocol.channels().chunks(block(protocol.electrode_count())) {
            of_channels.extend(Sensitivities::of(design, mesh, channels.to_vec())?);
        }
        Ok(SkinSensitivities { drives: Sensitivities::of(design, mesh, drives)?, channels: of_channels })
    }

    /// The voltages of the channels.
    pub(super) fn volts(
        &self,
        protocol: &Protocol,
        electronics: &ElectronicsOptions,
        options: &FabricationOptions,
    ) -> Vec<Value> {
        let circuits: Vec<_> = self.drives.iter().map(|skin| skin.in_loop(electronics)).collect();
        let volt = |(own, &drive): (&Sensitivities, &usize)| {
            let value = circuits[drive].voltage(own, options, REFERENCE_TOLERANCE);
            shown(protocol, value)
        };
        self.channels.iter().zip(&protocol.drives().1).map(volt).collect()
    }

    /// The readings, in the order of the scan table.
    fn readings(&self, design: &SkinDesign, electronics: &ElectronicsOptions, waits_s: &[f64]) -> Vec<Reading> {
        let (protocol, options) = (&design.protocol, design.fabrication_options());
        let volts = self.volts(protocol, electronics, &options);
        let mut drives = self.drives.iter();
        let reading = |(slot, &wait_s): (ScanSlot, &f64)| match slot.measure {
            Some((_, channel)) => {
                let ohm = Some(shown(protocol, self.channels[channel].ohm(&options, REFERENCE_TOLERANCE)));
                Reading { slot, ohm, volt: volts[channel], wait_s }
            }
            None => {
                // The first slot of a drive; drives follow in their order.
                let own = drives.next().expect("a reading of the current for each drive").in_loop(electronics);
                Reading { slot, ohm: None, volt: own.reference(&options, REFERENCE_TOLERANCE), wait_s }
            }
        };
        protocol.scan().into_iter().zip(waits_s).map(reading).collect()
    }
}

/// A value as the instrument shows it.
fn shown(protocol: &Protocol, value: Value) -> Value {
    if protocol.amplitude_only() { value.without_sign() } else { value }
}

/// A protocol of some channels.
pub(super) fn protocol_of(design: &SkinDesign, channels: Vec<Channel>) -> Protocol {
    Protocol::new(design.electrodes.len(), channels).expect("pairs of a valid protocol")
}
